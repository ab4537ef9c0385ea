"""MAVLink: a whole simulated flight whose every word comes over a wire, and others on that wire.

The simulated vehicle's words become messages, these go through what the real link's go through
(`Telemetry`, `MavlinkBeams`, `AutopilotGnss`), and the pilot flies by what comes out. A case is a
list of messages, one a line of JSON, that others put in between.

Two targets. `wire`: what must not be believed (other senders, what is no measurement, old and
made-up times, torn text) changes nothing: every command is, bit for bit, the one of the same
flight alone. `mavlink`: everything else that others can say in the vehicle's name; nothing inside
may become infinite, no setpoint may break the guard's limits, and the vehicle must touch nothing.
"""

import asyncio
import functools
import json
import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import Inputs
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.clock import Clock
from hal.drops import Drops, dropped_by
from hal.gnss.autopilot_gnss import AutopilotGnss
from hal.interfaces import WireMessage
from hal.ranging.mavlink_beams import MavlinkBeams
from hal.ranging.orientations import orientation_of
from hal.readings import FixType, FlightMode, GnssFix, LandedState, RangeReading, RangeStatus
from hal.setpoints import Setpoint
from hal.sim.scenario import load_scenario
from hal.vehicle.telemetry import Telemetry
from tools.fuzz.cases import Tally, Target, lines, require

Fields = dict[str, Any]
Said = tuple[str, int, int, str]
"""(name, system, component, text)"""
Timed = tuple[int, str, int, int, str]
"""The same after its tick."""
Injected = dict[int, list[Said]]

SYSTEM, AUTOPILOT = 1, 1
_SCENARIO = "default"
_CLOCK_BEHIND_S = 40.0
_TICKS = 1_400
"""Injections are spread over so many ticks, a little more than a flight takes."""
_SETTLED_TICKS = 10
"""Nothing is put in before this: whose clock is which is learned from the first message."""
_SPEED_SLACK_M_S = 1e-6
_MODES = {
    FlightMode.MANUAL: 1 << 16,
    FlightMode.OFFBOARD: 6 << 16,
    FlightMode.UNKNOWN: 0,
    **{
        mode: 4 << 16 | sub << 24
        for mode, sub in (
            *((FlightMode.TAKEOFF, 2), (FlightMode.HOLD, 3), (FlightMode.MISSION, 4)),
            *((FlightMode.RETURN, 5), (FlightMode.LAND, 6), (FlightMode.DESCEND, 20)),
        )
    },
}
_LANDED = {
    LandedState.UNKNOWN: 0,
    LandedState.ON_GROUND: 1,
    LandedState.IN_AIR: 2,
    LandedState.TAKEOFF: 3,
    LandedState.LANDING: 4,
}
_FIXES = {fix: number for number, fix in enumerate(FixType)}


class Link:
    """What the vehicle's adapter is to the drivers: a `MessageSource`, without a library."""

    def __init__(self, clock: Clock) -> None:
        self.drops = Drops()
        self.restarts = 0
        self.telemetry = Telemetry(clock, SYSTEM, self.drops, self._restarted)
        self._takers: dict[str, list[Callable[[WireMessage], None]]] = {}
        for name, take in self.telemetry.takers.items():
            self._takers[name] = [take]

    def _restarted(self) -> None:
        self.restarts += 1

    def listen(self, name: str, take: Callable[[WireMessage], None]) -> None:
        """As `hal.interfaces.MessageSource`."""
        self._takers.setdefault(name, []).append(self.telemetry.of_this_vehicle(name, take))

    def stamp_s(self, message: WireMessage, boot_s: float) -> float:
        """As `hal.interfaces.MessageSource`."""
        return self.telemetry.stamp_s(message, boot_s)

    def deliver(self, name: str, message: WireMessage) -> None:
        """One message arrives."""
        for take in self._takers.get(name, ()):
            take(message)


class HostileFlight(Simulation):
    """A simulated flight whose inputs come over a `Link`, with others' messages among them."""

    def __init__(self, config: Config, injected: Injected) -> None:
        scenario = load_scenario(_SCENARIO)
        config = with_scenario(config, scenario)
        super().__init__(scenario, config, (goal_of(scenario, config),), seed=7)
        self.scenario, self.config = scenario, config
        self.link = Link(self.clock)
        self.injected = injected
        self._tick = 0
        beams = config.beams.model_copy(update={"latency_s": 0.0})
        self._mounts = {mount.name: orientation_of(mount) for mount in beams.mounts}
        self.beams = MavlinkBeams(self.link, beams)
        self.receiver = AutopilotGnss(self.link)
        asyncio.run(self._open())

    async def _open(self) -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(self.beams.open(5.0))
            group.create_task(self.receiver.open(5.0))
            await asyncio.sleep(0.0)
            reading = RangeReading(0.0, "down", RangeStatus.VALID, 0.1, 1e-4, 0.02, 1.0)
            self._say("DISTANCE_SENSOR", self._range(reading, self.boot_s))
            fix = GnssFix(0.0, FixType.NO_FIX, 0.0, 0.0, 0.0, 1.0, 1.0, 0)
            self._say("GPS_RAW_INT", self._fix(fix, self.boot_s))
        self.beams.take()

    @property
    def boot_s(self) -> float:
        """The vehicle's own clock."""
        return self.clock.now_s() + _CLOCK_BEHIND_S

    def inputs(self) -> Inputs:
        """The vehicle's words as they come out of the wire."""
        spoken = super().inputs()
        others = self.injected.get(self._tick, [])
        self._tick += 1
        for name, fields in self._words(spoken):
            self._say(name, fields)
        for name, system, component, text in others:
            message = WireMessage(self.clock.now_s(), system, component, text)
            self.link.deliver(name, message)
        telemetry = self.link.telemetry
        return msgspec.structs.replace(
            spoken,
            ranges=self.beams.take(),
            local_position=telemetry.local_position(),
            attitude=telemetry.attitude(),
            gnss=self.receiver.fix(),
            status=telemetry.status(),
        )

    def _say(self, name: str, fields: Fields) -> None:
        now_s = self.clock.now_s()
        self.link.deliver(name, WireMessage(now_s, SYSTEM, AUTOPILOT, json.dumps(fields)))

    def _words(self, spoken: Inputs) -> list[tuple[str, Fields]]:
        """One tick of the vehicle as messages; at this rate every kind comes every time."""
        status, ms = spoken.status, round(self.boot_s * 1e3)
        mode = _MODES[status.mode]
        words: list[tuple[str, Fields]] = [
            (
                "HEARTBEAT",
                {
                    "autopilot": 12,
                    "base_mode": 128 if status.armed else 0,
                    "custom_mode": mode,
                    "system_status": 5 if status.in_failsafe else 4,
                },
            ),
            ("CURRENT_MODE", {"custom_mode": mode}),
            ("EXTENDED_SYS_STATE", {"landed_state": _LANDED[status.landed]}),
            (
                "SYS_STATUS",
                {
                    "onboard_control_sensors_health": 0x1000_0000 if status.armable else 0,
                    "battery_remaining": round(100.0 * (status.battery_remaining or 0.0)),
                },
            ),
        ]
        if status.global_position:
            words.append(("GLOBAL_POSITION_INT", {"lat": 1, "lon": 1}))
        if spoken.attitude is not None:
            a = spoken.attitude
            angles = {"roll": a.roll_rad, "pitch": a.pitch_rad, "yaw": a.yaw_rad}
            words.append(("ATTITUDE", {"time_boot_ms": ms, **angles, "yawspeed": a.yaw_rate_rad_s}))
        if spoken.local_position is not None:
            p = spoken.local_position
            (x, y, z), (vx, vy, vz) = p.position_ned_m, p.velocity_ned_m_s
            state = {"x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}
            frames = {"frame_id": 1, "child_frame_id": 1, "q": [1.0, 0.0, 0.0, 0.0]}
            words.append(("LOCAL_POSITION_NED", {"time_boot_ms": ms, **state}))
            words.append(
                (
                    "ODOMETRY",
                    {"time_usec": ms * 1000, **frames, **state, "reset_counter": p.reset_counter},
                )
            )
        behind_s = self.boot_s - spoken.now_s
        words += [("DISTANCE_SENSOR", self._range(r, r.stamp_s + behind_s)) for r in spoken.ranges]
        if spoken.gnss is not None:
            words.append(("GPS_RAW_INT", self._fix(spoken.gnss, spoken.gnss.stamp_s + behind_s)))
        return words

    def _range(self, reading: RangeReading, boot_s: float) -> Fields:
        cm = round(reading.range_m * 100.0)
        if reading.status is RangeStatus.OUT_OF_RANGE:
            cm = round(reading.max_m * 100.0) + 1
        return {
            "time_boot_ms": round(boot_s * 1e3),
            "min_distance": round(reading.min_m * 100.0),
            "max_distance": round(reading.max_m * 100.0),
            "current_distance": cm,
            "id": 0,
            "orientation": self._mounts[reading.beam],
            "covariance": 255,
            "signal_quality": 1 if reading.status is RangeStatus.NO_SIGNAL else 100,
            "quaternion": [0.0, 0.0, 0.0, 0.0],
        }

    def _fix(self, fix: GnssFix, boot_s: float) -> Fields:
        return {
            "time_usec": round(boot_s * 1e6),
            "fix_type": _FIXES[fix.fix_type],
            "lat": round(fix.latitude_deg * 1e7),
            "lon": round(fix.longitude_deg * 1e7),
            "alt": round(fix.amsl_m * 1e3),
            "eph": 80,
            "epv": 120,
            "satellites_visible": fix.satellites,
            "h_acc": round(fix.horizontal_accuracy_m * 1e3),
            "v_acc": round(fix.vertical_accuracy_m * 1e3),
        }


# ---------------------------------------------------------------- what must not matter

_TIMED = {
    "ATTITUDE": ("time_boot_ms", 1e3),
    "LOCAL_POSITION_NED": ("time_boot_ms", 1e3),
    "ODOMETRY": ("time_usec", 1e6),
    "DISTANCE_SENSOR": ("time_boot_ms", 1e3),
    "GPS_RAW_INT": ("time_usec", 1e6),
}
_OF_WHOEVER_IS_ABOARD = ("DISTANCE_SENSOR", "OBSTACLE_DISTANCE")
TEMPLATES: dict[str, Fields] = {
    "HEARTBEAT": {"autopilot": 12, "base_mode": 0, "custom_mode": 1 << 16, "system_status": 5},
    "CURRENT_MODE": {"custom_mode": 4 << 16 | 6 << 24},
    "EXTENDED_SYS_STATE": {"landed_state": 1},
    "SYS_STATUS": {"onboard_control_sensors_health": 0, "battery_remaining": 3},
    "GLOBAL_POSITION_INT": {"lat": 1, "lon": 1},
    "STATUSTEXT": {"severity": 0, "text": "x" * 50, "id": 1, "chunk_seq": 0},
    "ATTITUDE": {"time_boot_ms": 0, "roll": 0.3, "pitch": -0.2, "yaw": 2.0, "yawspeed": 1.0},
    "LOCAL_POSITION_NED": {
        "time_boot_ms": 0,
        "x": 3.0,
        "y": -2.0,
        "z": -0.5,
        "vx": 2.0,
        "vy": 0.0,
        "vz": -1.0,
    },
    "ODOMETRY": {
        "time_usec": 0,
        "frame_id": 1,
        "child_frame_id": 12,
        "x": 3.0,
        "y": -2.0,
        "z": -0.5,
        "q": [0.7, 0.0, 0.0, 0.7],
        "vx": 2.0,
        "vy": 0.0,
        "vz": -1.0,
        "reset_counter": 9,
    },
    "DISTANCE_SENSOR": {
        "time_boot_ms": 0,
        "min_distance": 2,
        "max_distance": 100,
        "current_distance": 101,
        "id": 0,
        "orientation": 0,
        "covariance": 1,
        "signal_quality": 100,
        "quaternion": [1.0, 0.0, 0.0, 0.0],
    },
    "OBSTACLE_DISTANCE": {
        "time_usec": 0,
        "distances": [20] * 72,
        "increment": 5,
        "increment_f": 5.0,
        "min_distance": 2,
        "max_distance": 100,
        "angle_offset": 0.0,
        "frame": 12,
    },
    "GPS_RAW_INT": {
        "time_usec": 0,
        "fix_type": 3,
        "lat": 100,
        "lon": 100,
        "alt": 0,
        "eph": 1,
        "epv": 1,
        "satellites_visible": 30,
        "h_acc": 10,
        "v_acc": 10,
    },
}
_NO_NUMBERS: tuple[Any, ...] = (None, "1", [], {}, True, 1e39, -1e300, "NaN")
_ABSURD_KEYS = {
    "ATTITUDE": ("roll", "pitch", "yaw", "yawspeed"),
    "LOCAL_POSITION_NED": ("x", "y", "z", "vx", "vy", "vz"),
    "ODOMETRY": ("x", "y", "z", "vx", "vy", "vz"),
}


def _pick(rng: np.random.Generator, among: Any) -> Any:
    return list(among)[int(rng.integers(len(among)))]


def _timed(name: str, fields: Fields, boot_s: float) -> Fields:
    key, per_s = _TIMED.get(name, ("", 0.0))
    return fields | {key: max(0, round(boot_s * per_s))} if key else fields


def _of_another(rng: np.random.Generator, name: str, now_s: float) -> tuple[int, int, str]:
    """What anybody but the vehicle says, as plausible as can be."""
    fields = _timed(name, TEMPLATES[name], now_s)
    system = int(rng.choice([0, 2, 7, 255]))
    if name in _OF_WHOEVER_IS_ABOARD or rng.random() < 0.5:
        return system, int(rng.choice([1, 158])), json.dumps(fields)
    return SYSTEM, int(rng.choice([0, 2, 100, 158, 190, 255])), json.dumps(fields)


def _no_measurement(rng: np.random.Generator, name: str, now_s: float) -> tuple[int, int, str]:
    """In the vehicle's name, and now, but nothing that can be read as what it should be."""
    fields = dict(_timed(name, TEMPLATES[name], now_s))
    absurd = _ABSURD_KEYS.get(name)
    if absurd is not None and rng.random() < 0.4:
        fields[_pick(rng, absurd)] = float(rng.choice([1e38, -3.4e38, 1e6, -2e5]))
        return SYSTEM, AUTOPILOT, json.dumps(fields)
    required = [key for key in fields if key not in _OPTIONAL]
    if rng.random() < 0.2:
        del fields[_pick(rng, required)]
        return SYSTEM, AUTOPILOT, json.dumps(fields)
    key = _pick(rng, required)
    if isinstance(fields[key], float):
        fields[key] = _pick(rng, _NO_NUMBERS[:5])
    elif isinstance(fields[key], str):
        fields[key] = _pick(rng, (None, 1, [], {}))
    else:
        fields[key] = _pick(rng, (*_NO_NUMBERS[:4], 0.5, "NaN"))
    return SYSTEM, AUTOPILOT, json.dumps(fields)


_OPTIONAL = {"id", "chunk_seq", "signal_quality", "quaternion", "h_acc", "v_acc"} | {
    *("increment_f", "angle_offset", "frame"),
}


def _torn(rng: np.random.Generator, name: str, now_s: float) -> tuple[int, int, str]:
    text = json.dumps(_timed(name, TEMPLATES[name], now_s))
    return SYSTEM, AUTOPILOT, text[: int(rng.integers(len(text)))]


def _of_another_time(rng: np.random.Generator, name: str, now_s: float) -> tuple[int, int, str]:
    """In the vehicle's name, plausible, but old (said again) or from a future."""
    # A receiver's newest fix is up to 0.24 s old: 0.06 s ago would be news.
    least_s = 0.06 if name != "GPS_RAW_INT" else 0.4
    ago_s = float(_pick(rng, (least_s, 0.5, 0.99, 1.5, 20.0, 1e9, -2.0, -60.0, -1e9)))
    fields = _timed(name, TEMPLATES[name], now_s - ago_s)
    return SYSTEM, AUTOPILOT, json.dumps(fields)


def make_harmless(rng: np.random.Generator) -> bytes:
    """Up to 400 messages that must not matter, alone and in bursts."""
    told: list[Timed] = []
    for _ in range(int(rng.integers(1, 400))):
        tick = int(rng.integers(_SETTLED_TICKS, _TICKS))
        kind = _pick(rng, (_of_another, _no_measurement, _torn, _of_another_time))
        names = _TIMED if kind is _of_another_time else TEMPLATES
        name = _pick(rng, names)
        burst = range(tick, tick + int(_pick(rng, (1, 1, 1, 8))))
        told += [(at, name, *kind(rng, name, _boot_s(at))) for at in burst]
    return _written(told)


def _boot_s(tick: int) -> float:
    """The vehicle's clock at a tick of the flight."""
    return _CLOCK_BEHIND_S + 6.0 + 0.05 * tick


# ---------------------------------------------------------------- what may matter


def make_anything(rng: np.random.Generator) -> bytes:
    """Up to 200 messages in the vehicle's name or a companion's, with any numbers, at its time."""
    told = []
    for _ in range(int(rng.integers(1, 200))):
        tick = int(rng.integers(0, _TICKS))
        name = _pick(rng, TEMPLATES)
        fields = {key: _any_like(rng, value) for key, value in TEMPLATES[name].items()}
        if rng.random() < 0.8:
            fields = _timed(name, fields, _boot_s(tick) + 0.001)
        component = int(_pick(rng, (AUTOPILOT, AUTOPILOT, 158, 196)))
        told.append((tick, name, SYSTEM, component, json.dumps(fields)))
    return _written(told)


def _any_like(rng: np.random.Generator, value: Any) -> Any:
    if rng.random() < 0.3:
        return value
    if isinstance(value, list):
        size = len(value) if rng.random() < 0.9 else int(rng.integers(0, 80))
        return [_any_like(rng, value[0]) for _ in range(size)]
    if isinstance(value, str):
        return rng.bytes(int(rng.integers(0, 60))).decode("latin-1")
    if isinstance(value, float):
        scale = float(_pick(rng, (0.1, 1.0, 10.0, 1e3, 1e5, 1e38)))
        return float(rng.normal()) * scale
    high = int(_pick(rng, (2, 16, 101, 256, 65536, 2**32, 2**64)))
    low = int(_pick(rng, (0, 0, -high // 2)))
    return min(int(low + rng.random() * (high - low)), high - 1)


# ---------------------------------------------------------------- flying


def _written(told: list[Timed]) -> bytes:
    return b"".join(json.dumps(each).encode() + b"\n" for each in sorted(told))


def _read(case: bytes) -> Injected:
    injected: Injected = {}
    for line in case.splitlines():
        tick, name, system, component, text = json.loads(line)
        injected.setdefault(tick, []).append((name, system, component, text))
    return injected


def _flown(
    case: bytes, ticks: int, note: Callable[[HostileFlight, Command], None]
) -> HostileFlight:
    """`ticks` of the flight, or all of it."""
    flight = HostileFlight(Config(), _read(case))
    flight.vehicle.advance(6.0)
    for _ in range(ticks):
        command = flight.tick()
        note(flight, command)
        if command.decision.outcome is not None:
            break
    return flight


def _written_down(command: Command) -> bytes:
    """What a tick does to the vehicle; a flight is the same when all of these are."""
    decision = command.decision
    return msgspec.json.encode((command.wire_setpoint, decision.requests, decision.state))


@functools.cache
def _alone(ticks: int) -> tuple[bytes, ...]:
    """The flight without anybody on the wire."""
    commands: list[bytes] = []
    _flown(b"", ticks, lambda _, command: commands.append(_written_down(command)))
    return tuple(commands)


def run_harmless(case: bytes, ticks: int = _TICKS) -> Tally:
    """Raises Broken at the first command that differs from the flight alone."""
    alone = _alone(ticks)
    count = 0

    def compare(flight: HostileFlight, command: Command) -> None:
        nonlocal count
        _check(flight, command)
        require(
            count < len(alone) and _written_down(command) == alone[count],
            f"tick {count} is not what it is without the others on the wire",
        )
        count += 1

    flight = _flown(case, ticks, compare)
    require(count == len(alone), f"it ended after {count} ticks instead of {len(alone)}")
    return _tally(flight, len(case.splitlines()))


def run_anything(case: bytes, ticks: int = _TICKS) -> Tally:
    """Raises for what is infinite inside, and for a setpoint beyond the guard's limits."""
    touched = 0

    def watch(flight: HostileFlight, command: Command) -> None:
        nonlocal touched
        _check(flight, command)
        truth, body = flight.vehicle.truth(), flight.scenario.vehicle
        touched |= flight.world.collides(
            truth.position_ned_m, body.body_radius_m, body.body_half_height_m
        )

    flight = _flown(case, ticks, watch)
    tally = _tally(flight, len(case.splitlines()))
    tally["flights that touched something"] = int(touched)
    return tally


def _tally(flight: HostileFlight, put_in: int) -> Tally:
    dropped = dropped_by((flight.link.drops, flight.beams, flight.receiver))
    tally = Tally({"messages put in": put_in})
    for (_, reason), count in dropped.items():
        tally[reason] += count
    return tally


def _check(flight: HostileFlight, command: Command) -> None:
    fused = command.decision.fused
    if fused is not None:
        numbers = (
            *(fused.stamp_s, *fused.position_ned_m, *fused.velocity_ned_m_s, fused.yaw_rad),
            *(fused.position_sigma_m, fused.height_agl_m or 0.0),
            *(fused.roll_rad, fused.pitch_rad, fused.yaw_rate_rad_s),
        )
        require(all(map(math.isfinite, numbers)), f"the estimate is not finite: {fused}")
    for setpoint in (command.setpoint, command.wire_setpoint):
        if setpoint is not None:
            _check_setpoint(flight, setpoint)


def _check_setpoint(flight: HostileFlight, setpoint: Setpoint) -> None:
    numbers = (
        *setpoint.position_ned_m,
        *(*setpoint.velocity_ned_m_s, setpoint.yaw_rad, setpoint.stamp_s),
    )
    require(all(map(math.isfinite, numbers)), f"the setpoint is not finite: {setpoint}")
    north, east, down = setpoint.velocity_ned_m_s
    guard = flight.config.guard
    require(
        math.hypot(north, east) <= guard.speed_max_m_s + _SPEED_SLACK_M_S
        and abs(down) <= guard.climb_max_m_s + _SPEED_SLACK_M_S,
        f"the setpoint is faster than the guard allows: {setpoint}",
    )


WIRE = Target("wire", make_harmless, run_harmless, lines)
MAVLINK = Target("mavlink", make_anything, run_anything, lines)
