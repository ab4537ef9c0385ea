import contextlib
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.documents import validate_document
from hal.errors import DocumentError
from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import FaultWindow, fault_kinds, parse_fault
from hal.sim.scenario import Scenario

NEEDED: dict[str, dict[str, float | str]] = {
    "battery": {"remaining": 0.1},
    "beam_crosstalk": {"other": "left"},
}


def document(**fault: object) -> FaultWindow:
    """The fault as a scenario file says it."""
    data = {"name": "test", "faults": [fault]}
    return validate_document(data, Scenario, "test.yaml").faults[0]


@pytest.mark.parametrize("kind", fault_kinds())
def test_a_line_and_a_file_mean_the_same(kind: str) -> None:
    keys = NEEDED.get(kind, {})
    rest = ",".join(f"{key}={value}" for key, value in keys.items())
    line = f"{kind}@liftoff+2.5/3" + (f":{rest}" if rest else "")
    assert parse_fault(line) == document(
        kind=kind, after="liftoff", start_s=2.5, duration_s=3.0, **keys
    )


@pytest.mark.parametrize(
    ("line", "window"),
    [
        ("link_loss", ("start", 0.0, None)),
        ("link_loss@12", ("start", 12.0, None)),
        ("link_loss@12.5/3", ("start", 12.5, 3.0)),
        ("link_loss@arming", ("arming", 0.0, None)),
        ("link_loss@liftoff+4/0.5", ("liftoff", 4.0, 0.5)),
        (" link_loss@start+1 ", ("start", 1.0, None)),
    ],
)
def test_when_and_how_long(line: str, window: tuple[str, float, float | None]) -> None:
    fault = parse_fault(line)
    assert (fault.after, fault.start_s, fault.duration_s) == window


def test_values_are_numbers_truths_and_texts() -> None:
    fault = parse_fault("arming_refused:reason=Preflight Fail: no compass,times=2,announced=false")
    assert fault.model_dump(include={"reason", "times", "announced"}) == {
        "reason": "Preflight Fail: no compass",
        "times": 2,
        "announced": False,
    }


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("nope", "there is no kind 'nope'; use one of beam_dropout, "),
        ("", "there is no kind ''"),
        ("link_loss@soon", "@WHEN/SECONDS has numbers of seconds, or start, arming or liftoff"),
        ("link_loss@liftoff+", "@WHEN/SECONDS has numbers"),
        ("link_loss@3/", "@WHEN/SECONDS has numbers"),
        ("link_loss@1.2.3", "@WHEN/SECONDS has numbers"),
        ("link_loss@3/-1", "duration_s: input should be greater than 0"),
        ("link_loss:sideways", "'sideways' is not KEY=VALUE"),
        ("link_loss:width=1", "link_loss has no key width; it has start_s, duration_s, after,"),
        ("link_loss:direction=sideways", "direction: input should be 'both', 'up' or 'down'"),
        ("battery", "battery needs remaining=..."),
        ("battery:remaining=half", "remaining: should be a number"),
        ("battery:remaining=1.5", "remaining: input should be less than or equal to 1"),
        ("offboard_refused:times=0", "times: input should be greater than or equal to 1"),
    ],
)
def test_a_bad_line_gets_one_sentence(line: str, sentence: str) -> None:
    with pytest.raises(DocumentError, match=re.escape(sentence)) as caught:
        parse_fault(line)
    assert str(caught.value).startswith(f"fault {line!r}: ")
    assert "\n" not in str(caught.value)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=40) | st.from_regex(r"link_\w+@?[\w+./]*:?[\w=,.]*", fullmatch=True))
def test_no_line_whatsoever_raises_anything_else(line: str) -> None:
    with contextlib.suppress(DocumentError):
        assert parse_fault(line).start_s >= 0.0


def test_the_clock_counts_from_the_first_time_of_each_moment() -> None:
    clock = FaultClock(since_s=10.0)
    begun, armed, flying = (
        parse_fault(f"link_loss@{when}+2/3") for when in ("start", "arming", "liftoff")
    )
    assert clock.active((begun, armed, flying), 13.0) == (begun,)
    for now_s, arm, air in ((20.0, True, False), (24.0, True, True), (90.0, True, True)):
        clock.note(now_s, armed=arm, airborne=air)
    assert clock.active((begun, armed, flying), 22.5) == (armed,)
    assert clock.active((begun, armed, flying), 26.5) == (flying,)
    assert clock.active((begun, armed, flying), 29.5) == ()
    assert clock.began_s(flying, 30.0) == 4.0
