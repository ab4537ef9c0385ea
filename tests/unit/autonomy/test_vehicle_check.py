"""A vehicle on the link, judged by what was heard of it."""

import struct
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from autonomy.config import Config
from autonomy.finding import Finding, Fix
from autonomy.px4_health import Event, SensorReport, event_id
from autonomy.vehicle_check import Listener, Look, judged, mend, undo
from hal.clock import SimClock
from hal.config import six_beams
from hal.readings import (
    Attitude,
    FixType,
    FlightMode,
    GnssFix,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Request, RequestKind
from hal.sim.autopilot import Autopilot
from hal.sim.scenario import Scenario, VehicleSimulation
from tests.support.link import SpokenLink
from tests.support.simulated_drivers import DrivenVehicle
from tests.unit.autonomy.test_px4_advice import GOOD

FACTS = VehicleFacts("PX4", "1.19.0", 1, {})
STATUS = VehicleStatus(
    3.0, False, FlightMode.HOLD, LandedState.ON_GROUND, 0.05, battery_remaining=0.9
)


def look(status: VehicleStatus = STATUS, **changes: object) -> Look:
    """Three seconds of a healthy vehicle that stands still."""
    healthy = Look(
        seconds=3.0,
        positions=[LocalPosition(k / 30, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)) for k in range(90)],
        attitudes=[Attitude(k / 50, 0.0, 0.0, 0.0, 0.0) for k in range(150)],
        readings=[
            RangeReading(k / 20, mount.name, RangeStatus.VALID, 0.5, 1e-4, 0.02, 1.0)
            for k in range(60)
            for mount in six_beams()
        ],
        fix=GnssFix(2.9, FixType.FIX_3D, 47.0, 8.0, 400.0, 0.9, 1.5, 11),
        status=status,
        ended_s=3.0,
        sensors=SensorReport(0x0300C02F, 0x0301C02F, 0x1320C83F),
    )
    for name, value in changes.items():
        setattr(healthy, name, value)
    return healthy


def wrong(of: Look) -> list[Finding]:
    return [finding for finding in judged(Config(), FACTS, GOOD, of) if not finding.good]


def only(found: list[Finding]) -> Finding:
    assert len(found) == 1, found
    return found[0]


def changed(**fields: object) -> VehicleStatus:
    return msgspec.structs.replace(STATUS, **fields)


def test_a_healthy_vehicle_has_nothing_to_mend() -> None:
    assert wrong(look()) == []
    told = " / ".join(str(finding) for finding in judged(Config(), FACTS, GOOD, look()))
    for words in ("ready to arm in hold", "30 Hz, 0.0 cm", "11 satellites, 0.9 m", "90%"):
        assert words in told
    assert "beam front: 20.0 Hz, 50 ms old, 0.50 m with 0 mm of noise" in told


def test_why_it_will_not_arm_is_told_in_words_by_its_events() -> None:
    modes = struct.pack("<IB", 1 << 4, 0)
    events = [Event(event_id("check_modes_global_pos"), 0x63, tuple(modes))]
    status = changed(armable=False, not_armable_because="Resolve system health failures first")
    finding = only(wrong(look(status, events=events)))
    assert finding.bad
    assert finding.sentence.startswith("it will not arm in hold: no valid global position")


def test_what_keeps_it_down_in_hold_alone_is_no_hindrance() -> None:
    hold_only = Event(
        event_id("check_modes_global_pos"), 0x63, tuple(struct.pack("<IB", 1 << 4, 0))
    )
    everywhere = Event(
        event_id("check_mag_missing"), 0x63, tuple(struct.pack("<IB", 0xFFFFFFFF, 0))
    )
    status = changed(armable=False, global_position=False)
    found = wrong(look(status, events=[hold_only]))
    assert not any(finding.bad for finding in found if finding.subject == "arming")
    assert any("arms it in Takeoff" in finding.sentence for finding in found)
    found = wrong(look(status, events=[hold_only, everywhere]))
    assert any("a compass is missing" in finding.sentence and finding.bad for finding in found)


def test_without_events_its_texts_say_why_and_without_texts_its_status() -> None:
    status = changed(armable=False, not_armable_because="it does not say which")
    texts = ["Preflight Fail: compass 0 uncalibrated", "Preflight Fail: compass 0 uncalibrated"]
    assert "compass 0 uncalibrated" in only(wrong(look(status, texts=texts))).sentence
    assert "it does not say which" in only(wrong(look(status))).sentence


@pytest.mark.parametrize(
    ("changes", "words", "grave"),
    [
        ({"positions": []}, "optical flow", True),
        ({"positions": look().positions[::10]}, "3.0 Hz only", True),
        ({"positions": look().positions[:60]}, "1.0 s old", True),
        ({"sensors": SensorReport(0x7, 0x7, 0x3)}, "compass", True),
        (
            {"fix": GnssFix(2.9, FixType.NO_FIX, 0.0, 0.0, 0.0, 99.0, 99.0, 2)},
            "no position (no_fix)",
            False,
        ),
        ({"readings": [r for r in look().readings if r.beam != "up"]}, "beam up sends", True),
        ({"readings": look().readings[:240]}, "last heard 1.1 s ago", True),
    ],
)
def test_each_thing_that_is_wrong_is_a_sentence(
    changes: dict[str, object], words: str, grave: bool
) -> None:
    found = wrong(look(STATUS, **changes))
    assert any(words in finding.sentence for finding in found), found
    assert all(finding.bad for finding in found) is grave


def test_what_was_not_believed_is_told_and_what_others_say_is_not() -> None:
    dropped = {("ODOMETRY", "its time leapt"): 7, ("HEARTBEAT", "another sender"): 3}
    found = judged(Config(), FACTS, GOOD, look(dropped=dropped))
    (finding,) = (f for f in found if "not believed" in str(f))
    assert str(finding).endswith("not believed: ODOMETRY 7 times (its time leapt)")
    assert not finding.bad


def test_a_position_that_wanders_or_jumps_is_noted() -> None:
    wandering = [
        LocalPosition(k / 30, (0.01 * k, 0.0, 0.0), (0.3, 0.0, 0.0), int(k > 45)) for k in range(90)
    ]
    sentences = [finding.sentence for finding in wrong(look(positions=wandering))]
    assert any("wanders" in sentence for sentence in sentences)
    assert any("jumped" in sentence for sentence in sentences)


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (changed(armed=True), "it is armed"),
        (changed(battery_remaining=0.2), "at 20%: charge it"),
    ],
)
def test_a_vehicle_that_must_not_be_flown_is_bad(status: VehicleStatus, words: str) -> None:
    finding = only(wrong(look(status)))
    assert finding.bad
    assert words in finding.sentence


def test_what_cannot_be_done_without_a_global_position_is_noted() -> None:
    found = wrong(look(changed(global_position=False), fix=None))
    assert any("Hold is refused" in finding.sentence for finding in found)


def test_the_way_back_is_a_command() -> None:
    fixes = [f.fix for f in judged(Config(), FACTS, GOOD | {"NAV_DLL_ACT": 2.0}, look()) if f.fix]
    assert undo("udpin://0.0.0.0:14540", fixes) == (
        "autonomy check --connection udpin://0.0.0.0:14540 --set NAV_DLL_ACT=2"
    )


def test_only_the_autopilot_speaks_of_its_health() -> None:
    link = SpokenLink()
    listener = Listener(link)
    sensors = {f"onboard_control_sensors_{what}": 1 for what in ("present", "enabled", "health")}
    for component_id in (191, 1):
        link.say("SYS_STATUS", 1.0, component_id, **sensors)
        link.say("EVENT", 1.0, component_id, id=component_id, log_levels=3, arguments=[])
        assert (listener.sensors is None) == (component_id != 1)
    link.say_json("EVENT", 1.0, '{"id": "a word"}')
    assert [event.id for event in listener.events] == [1]


# ---------------------------------------------------------------- setting parameters

FIXES = (Fix("COM_OBL_RC_ACT", 0.0, 5.0, integer=True), Fix("MPC_XY_VEL_MAX", 12.0, 1.0, False))


class Asked:
    """Somebody who agrees to everything."""

    def __init__(self) -> None:
        self.for_fixes: list[Sequence[Fix]] = []

    def __call__(self, fixes: Sequence[Fix]) -> bool:
        self.for_fixes.append(fixes)
        return True


class Stubborn(DrivenVehicle):
    """Takes no parameter."""

    async def write_parameter(self, name: str, value: float) -> float | None:
        """Does nothing; COM_OBL_RC_ACT is told, the others not."""
        del value
        held = await self.read_parameters({name: float})
        return held[name] if name == "COM_OBL_RC_ACT" else None


class Unheard(DrivenVehicle):
    """Was last heard three seconds ago."""

    def status(self) -> VehicleStatus:
        """As it was then."""
        return msgspec.structs.replace(super().status(), link_age_s=3.0)


def vehicle(kind: type[DrivenVehicle] = DrivenVehicle) -> DrivenVehicle:
    world = Scenario(name="x", vehicle=VehicleSimulation(parameters={"COM_OBL_RC_ACT": 0.0}))
    simulated = kind(Autopilot(world, np.random.default_rng(1)), SimClock(50.0))
    simulated.advance(6.0)
    return simulated


def held(of: DrivenVehicle) -> tuple[float, float]:
    parameters = of.autopilot.parameters
    return float(parameters["COM_OBL_RC_ACT"]), float(parameters["MPC_XY_VEL_MAX"])


async def test_parameters_are_set_after_agreement_and_read_back() -> None:
    on = vehicle()
    asked = Asked()
    found = await mend(on, FIXES, asked)
    assert asked.for_fixes == [FIXES]
    assert [finding.good for finding in found] == [True, True]
    assert "COM_OBL_RC_ACT: 0 -> 5, read back" in found[0].sentence
    assert held(on) == (5.0, 1.0)


async def test_without_agreement_nothing_is_set() -> None:
    on = vehicle()
    (finding,) = await mend(on, FIXES, lambda _: False)
    assert not finding.bad
    assert held(on) == (0.0, 12.0)


async def test_an_armed_vehicle_is_left_as_it_is_and_nobody_is_asked() -> None:
    on = vehicle()
    assert on.execute_now(Request(RequestKind.ARM)).accepted
    asked = Asked()
    (finding,) = await mend(on, FIXES, asked)
    assert finding.bad
    assert "disarmed only" in finding.sentence
    assert asked.for_fixes == []
    assert held(on) == (0.0, 12.0)


async def test_a_vehicle_that_is_armed_while_somebody_thinks_is_left_as_it_is() -> None:
    on = vehicle()
    found = await mend(on, FIXES, lambda _: on.execute_now(Request(RequestKind.ARM)).accepted)
    assert all(finding.bad for finding in found)
    assert held(on) == (0.0, 12.0)


async def test_a_vehicle_that_is_not_heard_is_left_as_it_is() -> None:
    on = vehicle(Unheard)
    (finding,) = await mend(on, FIXES, lambda _: True)
    assert finding.bad
    assert "last heard 3 s ago" in finding.sentence
    assert held(on) == (0.0, 12.0)


async def test_a_fraction_is_no_value_of_a_parameter_of_whole_numbers() -> None:
    on = vehicle()
    (finding,) = await mend(on, (Fix("COM_OBL_RC_ACT", 0.0, 4.7, integer=True),), lambda _: True)
    assert finding.bad
    assert "whole numbers, not 4.7" in finding.sentence
    assert held(on) == (0.0, 12.0)


async def test_what_was_set_can_be_undone_also_when_not_all_was() -> None:
    fixes = (FIXES[0], Fix("COM_RCL_EXCEPT", 0.0, 0.5, integer=True))
    found = await mend(vehicle(), fixes, lambda _: True)
    assert [(finding.good, finding.fix) for finding in found] == [(True, FIXES[0]), (False, None)]


async def test_a_value_that_was_not_taken_is_told() -> None:
    found = await mend(vehicle(Stubborn), FIXES, lambda _: True)
    assert "asked for 5, the vehicle holds 0" in found[0].sentence
    assert "asked for 1, the vehicle holds nothing" in found[1].sentence
    assert all(finding.bad for finding in found)
