"""What an autopilot is heard to say: its own word alone, in order, and nothing absurd."""

import json
from typing import Any

import pytest

from hal.clock import SimClock
from hal.drops import Drops
from hal.interfaces import WireMessage
from hal.readings import FlightMode, LandedState
from hal.vehicle.telemetry import Telemetry

ODOMETRY: dict[str, Any] = {
    "frame_id": 1,
    "child_frame_id": 1,
    "x": 1.0,
    "y": 2.0,
    "z": -1.0,
    "q": [1.0, 0.0, 0.0, 0.0],
    "vx": 0.1,
    "vy": 0.0,
    "vz": 0.0,
    "reset_counter": 3,
}
POSITION: dict[str, Any] = {"x": 0.5, "y": 0.0, "z": 0.0, "vx": 0.0, "vy": 0.0, "vz": 0.0}
HEARTBEAT = {"autopilot": 12, "base_mode": 128, "custom_mode": 6 << 16, "system_status": 4}


class Ear:
    """An autopilot of system 1, its clock 90 s behind ours, that begins to speak at 100 s."""

    def __init__(self) -> None:
        self.clock = SimClock(100.0)
        self.drops = Drops()
        self.restarts = 0
        self.telemetry = Telemetry(self.clock, 1, self.drops, self._restarted)

    def _restarted(self) -> None:
        self.restarts += 1

    def say(self, name: str, fields: dict[str, Any], system: int = 1, component: int = 1) -> None:
        text = json.dumps(fields)
        self.telemetry.takers[name](WireMessage(self.clock.now_s(), system, component, text))

    def fly(self, seconds: float = 0.5, **changes: Any) -> None:
        """Position and odometry at 50 Hz."""
        for _ in range(round(seconds * 50.0)):
            self.clock.advance(0.02)
            boot_s = self.clock.now_s() - 90.0
            self.say("LOCAL_POSITION_NED", POSITION | {"time_boot_ms": round(boot_s * 1e3)})
            self.say("ODOMETRY", ODOMETRY | {"time_usec": round(boot_s * 1e6)} | changes)

    @property
    def x(self) -> float:
        position = self.telemetry.local_position()
        assert position is not None
        return position.position_ned_m[0]


def dropped(ear: Ear, source: str, reason: str) -> int:
    return ear.drops.dropped().get((source, reason), 0)


def test_the_position_is_the_odometrys_while_the_estimate_is_valid() -> None:
    ear = Ear()
    ear.fly()
    position = ear.telemetry.local_position()
    assert position is not None
    assert (position.position_ned_m, position.reset_counter) == ((1.0, 2.0, -1.0), 3)
    assert position.stamp_s == pytest.approx(ear.clock.now_s(), abs=1e-3)
    assert ear.drops.dropped() == {}


@pytest.mark.parametrize(("system", "component"), [(2, 1), (1, 158), (0, 0), (255, 190)])
def test_others_are_not_the_autopilot(system: int, component: int) -> None:
    ear = Ear()
    ear.say("HEARTBEAT", HEARTBEAT, system, component)
    assert not ear.telemetry.heard_heartbeat
    assert dropped(ear, "HEARTBEAT", "another sender") == 1
    ear.clock.advance(1.0)
    assert ear.telemetry.status().link_age_s == pytest.approx(1.0)
    ear.say("HEARTBEAT", HEARTBEAT)
    assert ear.telemetry.mode is FlightMode.OFFBOARD


@pytest.mark.parametrize(
    "changes",
    [
        {"x": None},
        {"vx": 1e38},
        {"z": -3.4e38},
        {"q": [1.0]},
        {"q": [None] * 4},
        {"time_usec": -1, "x": "1"},
        {"x": 1e400},
    ],
)
def test_an_absurd_estimate_changes_nothing_and_is_counted(changes: dict[str, Any]) -> None:
    ear = Ear()
    ear.fly()
    before = ear.telemetry.local_position()
    boot_s = ear.clock.now_s() - 89.99
    ear.say("ODOMETRY", ODOMETRY | {"time_usec": round(boot_s * 1e6)} | changes)
    assert ear.telemetry.local_position() is before
    assert dropped(ear, "ODOMETRY", "unreadable") == 1


def test_repeated_and_reordered_messages_change_nothing_and_are_counted() -> None:
    ear = Ear()
    ear.fly()
    newest_us = round((ear.clock.now_s() - 90.0) * 1e6)
    for behind_us in (0, 20_000, 900_000):
        ear.say("ODOMETRY", ODOMETRY | {"x": 9.0, "time_usec": newest_us - behind_us})
    assert ear.x == 1.0
    assert dropped(ear, "ODOMETRY", "older than the newest") == 3


@pytest.mark.parametrize("time_usec", [0, 2**64 - 1, 10**15])
def test_a_replay_among_true_messages_is_not_a_restart(time_usec: int) -> None:
    ear = Ear()
    ear.fly()
    for _ in range(50):
        ear.say("ODOMETRY", ODOMETRY | {"x": 9.0, "time_usec": time_usec})
        ear.fly(0.02)
        assert ear.x == 1.0
    assert ear.restarts == 0
    assert dropped(ear, "ODOMETRY", "its time leapt") == 50


def test_a_restarted_autopilot_is_believed_and_asked_for_its_rates_again() -> None:
    ear = Ear()
    ear.fly()
    for n in range(30):
        ear.clock.advance(0.02)
        ms = 2000 + 20 * n
        ear.say("LOCAL_POSITION_NED", POSITION | {"time_boot_ms": ms})
        ear.say("ODOMETRY", ODOMETRY | {"x": 7.0, "time_usec": ms * 1000})
    assert (ear.x, ear.restarts) == (7.0, 1)


def test_an_odometry_in_another_frame_is_none() -> None:
    ear = Ear()
    ear.fly(frame_id=20)
    assert dropped(ear, "ODOMETRY", "another frame") == 25
    assert ear.x == 0.5


def test_a_flood_of_texts_costs_bounded_memory() -> None:
    ear = Ear()
    for n in range(1000):
        ear.say("STATUSTEXT", {"severity": n % 300 - 20, "text": "x" * 50, "id": n, "chunk_seq": n})
        ear.say("STATUSTEXT", {"severity": 3, "text": f"{n}"})
    assert len(ear.telemetry.take_texts()) == 128


def test_a_vehicle_is_on_the_ground_only_while_it_says_so() -> None:
    ear = Ear()
    ear.say("HEARTBEAT", HEARTBEAT)
    ear.say("EXTENDED_SYS_STATE", {"landed_state": 1})
    ear.clock.advance(2.4)
    assert ear.telemetry.status().landed is LandedState.ON_GROUND
    ear.clock.advance(0.2)
    ear.say("HEARTBEAT", HEARTBEAT)
    assert ear.telemetry.status().landed is LandedState.UNKNOWN
    ear.say("EXTENDED_SYS_STATE", {"landed_state": 2})
    assert ear.telemetry.status().landed is LandedState.IN_AIR
