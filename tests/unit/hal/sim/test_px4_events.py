import json
import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink

from hal.sim import px4_events
from hal.sim.mock_px4_housekeeping import event_message
from hal.sim.mock_px4_messages import LAYOUTS, ExtraMessage, Layout, unpack
from hal.sim.px4_events import AutopilotEvent, EventKind, event_id

GOLDEN = Path(__file__).parents[3] / "golden" / "px4" / "events.json"
NAMES: dict[str, str] = json.loads(GOLDEN.read_text())["names"]
KINDS = [kind for kind in vars(px4_events).values() if isinstance(kind, EventKind)]


def codec() -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=1, srcComponent=1)


@pytest.mark.parametrize(("number", "name"), NAMES.items())
def test_the_measured_ids_follow_from_the_names(number: str, name: str) -> None:
    assert event_id(name) == int(number)


def test_numbers_of_all_kinds_differ() -> None:
    assert len({kind.number for kind in KINDS}) == len(KINDS)


def test_an_event_survives_the_wire_with_arguments_and_levels() -> None:
    event = AutopilotEvent.of(12.5, 77, px4_events.FAILSAFE, 0x00060000, 6)
    back = unpack(event_message(event).pack(codec()))
    assert back is not None
    assert back.get_type() == "EVENT"
    fields = vars(back)
    assert (fields["id"], fields["sequence"]) == (31382480, 77)
    assert fields["event_time_boot_ms"] == 12500
    assert (fields["log_levels"] >> 4, fields["log_levels"] & 15) == (4, 2)
    assert struct.unpack("<IB", fields["arguments"][:5]) == (0x00060000, 6)


def test_a_damaged_frame_is_none_of_them() -> None:
    event = AutopilotEvent.of(1.0, 1, px4_events.LANDING_DETECTED)
    frame = bytearray(event_message(event).pack(codec()))
    frame[12] ^= 1
    assert unpack(bytes(frame)) is None
    known = mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(codec())
    assert unpack(bytes(known)) is None


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=lambda layout: layout.name)
def test_every_layout_comes_back_as_it_was_sent(layout: Layout) -> None:
    def value(kind: str) -> object:
        if kind.endswith("s"):
            return b"abc"
        one = 3.0 if kind.endswith("f") else 3
        return one if len(kind) == 1 else (one,) * int(kind[:-1])

    fields = {name: value(kind) for name, kind in layout.fields}
    back = unpack(ExtraMessage(layout, **fields).pack(codec()))
    assert back is not None
    for name, sent in fields.items():
        came = getattr(back, name)
        assert (came.rstrip(b"\0") if isinstance(came, bytes) else came) == sent


# Whole frames recorded from PX4 main bb59c637cd, SIH quadrotor, 2026-11.
RECORDED = (
    "fd1a00001c01010800000082498900000000995b000000000000871e0e00512600007f01058d",
    (
        "fd2e0000e5010122010060fb47890000000000000000000000000000000000000000000000000000"
        "0000000088138813881388130004000f70b6"
    ),
    "fd040000e6010123010060fb47899047",
    "fd1400006c01017c010000000000ffffffffffffffffffffffffffffffff5a9f",
    "fd1e00007f01019a0100e093a801782b23004b01000088000000100080000000b03a7f80b03a7f80c206",
    "fd020000d801019b01004901850f",
    (
        "fd3400001001010202000000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000"
        "c07f0000c07f01010000010101000001000000010101253b"
    ),
)


@pytest.mark.parametrize("frame", RECORDED, ids=lambda f: f[:20])
def test_recorded_frames_are_understood_and_written_again_byte_by_byte(frame: str) -> None:
    recorded = bytes.fromhex(frame)
    message = unpack(recorded)
    assert message is not None
    writer = codec()
    writer.seq = recorded[4]
    assert message.pack(writer) == recorded
