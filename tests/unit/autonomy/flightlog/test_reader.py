"""Reading logs of this program, refusing others, and telling where a replay differs."""

import math
from pathlib import Path

import msgspec
import pytest
from mcap.writer import Writer

from autonomy.errors import NotReplayable
from autonomy.flightlog.reader import FlightLog, compare, replay
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.flightlog.schema import FORMAT, METADATA, PROFILE, FlightHeader
from autonomy.model import Command, Decision, Environment, Event, Inputs, MissionState, NoPlan
from hal.readings import VehicleFacts
from tests.unit.autonomy.flightlog.records import plain_inputs, plain_step


def recorded(path: Path, ticks: int) -> FlightLog:
    with FlightRecorder(path, FlightHeader(config_json="{}")) as recorder:
        for index in range(ticks):
            inputs = plain_inputs(index / 20.0)
            recorder.tick(inputs, plain_step(inputs), 0.0)
    return FlightLog.open(path)


def test_a_replay_of_the_same_pilot_is_exact(tmp_path: Path) -> None:
    result = replay(recorded(tmp_path / "a.mcap", 40), plain_step)
    assert result.exact
    assert result.ticks == 40


def test_a_replay_names_the_first_field_that_differs(tmp_path: Path) -> None:
    def other(inputs: Inputs) -> Command:
        command = plain_step(inputs)
        if inputs.now_s < 1.0 or command.decision.setpoint is None:
            return command
        setpoint = msgspec.structs.replace(
            command.decision.setpoint, velocity_ned_m_s=(0.5 / 3.0, 0.25, 0.0)
        )
        decision = msgspec.structs.replace(command.decision, setpoint=setpoint)
        return msgspec.structs.replace(command, decision=decision)

    result = replay(recorded(tmp_path / "a.mcap", 40), other)
    assert result.ticks == 21
    assert result.first_difference == (
        f"tick 20 at 1.000 s: decision.setpoint.velocity_ned_m_s[1]: {0.5 / 3.0 / 7.0!r} != 0.25"
    )
    assert not result.exact


DECISION = Decision(now_s=1.0, state=MissionState.CRUISE, fused=None, setpoint=None)


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({}, None),
        ({"state": MissionState.HOLD}, "state: <MissionState.CRUISE: 'cruise'> != "),
        ({"clearance_m": -0.0}, "clearance_m: 0.0 != -0.0"),
        ({"clearance_m": math.nan}, "clearance_m: 0.0 != nan"),
        ({"clearance_m": 5e-324}, "clearance_m: 0.0 != 5e-324"),
        ({"stops": True}, "stops: 0 != True"),
        ({"events": (Event(1.0, "a", "b"),)}, "events: 0 items != 1 items"),
        (
            {"plan": NoPlan("closed", (), Environment.FREE, ())},
            "plan: None != a NoPlan",
        ),
    ],
)
def test_the_smallest_difference_is_found(
    change: dict[str, object], difference: str | None
) -> None:
    other = msgspec.structs.replace(DECISION, **change)
    found = compare(DECISION, other)
    if difference is None:
        assert found is None
    else:
        assert found is not None
        assert found.startswith(difference)


def test_a_number_that_is_none_is_the_same_as_itself() -> None:
    one = msgspec.structs.replace(DECISION, clearance_m=math.nan)
    two = msgspec.structs.replace(DECISION, clearance_m=-math.nan)
    assert compare(one, two) is None


def test_parameters_are_compared_one_by_one_and_to_the_bit() -> None:
    facts = VehicleFacts("PX4", "1.17.0", 1, {"MPC_XY_P": math.nan, "NAV_DLL_ACT": 0.0})
    assert compare(facts, VehicleFacts("PX4", "1.17.0", 1, dict(facts.parameters))) is None
    zero = VehicleFacts("PX4", "1.17.0", 1, {"MPC_XY_P": math.nan, "NAV_DLL_ACT": -0.0})
    assert compare(facts, zero) == "parameters['NAV_DLL_ACT']: 0.0 != -0.0"
    fewer = VehicleFacts("PX4", "1.17.0", 1, {"MPC_XY_P": math.nan})
    assert compare(facts, fewer) is not None


def test_a_log_without_ticks_cannot_be_replayed(tmp_path: Path) -> None:
    log = recorded(tmp_path / "a.mcap", 0)
    with pytest.raises(NotReplayable, match="holds no complete tick"):
        replay(log, plain_step)
    with pytest.raises(NotReplayable, match="no route was recorded"):
        log.route()


@pytest.mark.parametrize("content", [b"", b"not a log", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01"])
def test_what_is_not_a_log_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(NotReplayable, match="is not a flight log of this program"):
        FlightLog.open(tmp_path / "a.mcap")


def test_a_missing_log_is_told(tmp_path: Path) -> None:
    with pytest.raises(NotReplayable, match="No such file"):
        FlightLog.open(tmp_path / "a.mcap")
    with pytest.raises(NotReplayable, match="Is a directory"):
        FlightLog.open(tmp_path)


def foreign(path: Path, profile: str, header: bytes | None) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile, library="another")
        if header is not None:
            writer.add_metadata(METADATA, {"header": header.decode()})
        writer.finish()
    return path


def test_logs_of_other_programs_and_versions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(NotReplayable, match="is not a flight log of this program"):
        FlightLog.open(foreign(tmp_path / "a.mcap", "ros2", None))
    with pytest.raises(NotReplayable, match="its header cannot be read"):
        FlightLog.open(foreign(tmp_path / "b.mcap", PROFILE, b'{"seed": 1}'))
    newer = f'{{"config_json": "", "format": {FORMAT + 1}}}'.encode()
    with pytest.raises(NotReplayable, match=f"has format {FORMAT + 1}, this program reads"):
        FlightLog.open(foreign(tmp_path / "c.mcap", PROFILE, newer))


def test_a_record_that_does_not_fit_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=PROFILE)
        writer.add_metadata(METADATA, {"header": '{"config_json": "{}"}'})
        schema = writer.register_schema("Inputs", "jsonschema", b"{}")
        channel = writer.register_channel("inputs", "json", schema)
        writer.add_message(channel, 0, b'{"now_s": 1.0}', 0, 3)
        writer.finish()
    with pytest.raises(NotReplayable, match="tick 3, inputs: was written by another version"):
        list(FlightLog.open(path))
