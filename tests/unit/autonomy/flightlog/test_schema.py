"""A record comes back from its bytes exactly as it was."""

import json
import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings

from autonomy.flightlog.reader import compare
from autonomy.flightlog.schema import TOPICS, decode, encode, json_schema
from autonomy.model import Command, GuardReport, Inputs
from tests.unit.autonomy.flightlog.records import commands, inputs, plain_inputs


@settings(deadline=None, max_examples=60)
@given(inputs)
def test_inputs_come_back_bit_for_bit(record: Inputs) -> None:
    restored = decode(encode(record), Inputs)
    assert compare(record, restored) is None


@settings(deadline=None, max_examples=60)
@given(commands)
def test_commands_come_back_bit_for_bit(record: Command) -> None:
    restored = decode(encode(record), Command)
    assert compare(record, restored) is None


def test_what_json_cannot_say_is_written_as_words() -> None:
    text = encode(GuardReport(("Infinity",), math.inf, -math.inf)).decode()
    assert json.loads(text) == {
        "limits": ["Infinity"],
        "speed_limit_m_s": "inf",
        "free_distance_m": "-inf",
    }


def test_a_number_that_is_not_a_plain_float_is_refused() -> None:
    with pytest.raises(TypeError):
        encode(GuardReport((), np.float64(0.1), 0.0))


def test_another_kind_of_record_is_refused() -> None:
    with pytest.raises(msgspec.MsgspecError):
        decode(encode(plain_inputs(1.0)), Command)
    with pytest.raises(msgspec.MsgspecError):
        decode(b'{"now_s": "yesterday"}', Inputs)


@pytest.mark.parametrize("topic", sorted(TOPICS))
def test_every_topic_describes_itself(topic: str) -> None:
    schema = json.loads(json_schema(TOPICS[topic]))
    name = TOPICS[topic].__name__
    assert schema["$ref"] == f"#/$defs/{name}"
    assert set(TOPICS[topic].__struct_fields__) == set(schema["$defs"][name]["properties"])
