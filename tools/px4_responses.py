"""The simulated PX4 flown through everything that was measured on a real one, curve by curve.

The measured curves are tests/golden/px4/steps.json and profiles.json. `python -m tools.plots_px4`
draws what this module returns; tests bound it.
"""

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hal.frames import Vector3
from hal.sim.autopilot import Autopilot
from hal.sim.px4 import Mode, Result
from hal.sim.scenario import EstimatorSimulation, Scenario
from hal.sim.sensors import EstimatorError

GOLDEN = Path(__file__).parents[1] / "tests" / "golden" / "px4"
TICK_S = 0.01
_SETPOINT_TICKS = 5  # 20 Hz
_REST: Vector3 = (0.0, 0.0, 0.0)


class Curve(NamedTuple):
    """One quantity over time, measured and simulated at the same times.

    `size` is the step, or the range, that an error is compared with.
    """

    name: str
    drag_per_mass_s: float
    unit: str
    times_s: list[float]
    measured: list[float]
    simulated: list[float]
    size: float

    @property
    def rms(self) -> float:
        """Root mean square of the difference, as a share of `size`."""
        error = np.array(self.simulated) - np.array(self.measured)
        return float(np.sqrt(np.mean(error**2))) / self.size


class Noise(NamedTuple):
    """Standard deviations of the estimate, north, east, down, and how far it drifted."""

    position_m: Vector3
    velocity_m_s: Vector3
    drift_m: Vector3
    sample_m_s: Vector3


class Flown:
    """An autopilot in an empty world, flown tick by tick."""

    def __init__(
        self, drag_per_mass_s: float, *, noise_seed: int | None = None, **parameters: float
    ) -> None:
        vehicle = {
            "drag_per_mass_s": drag_per_mass_s,
            "parameters": {"COM_OBL_RC_ACT": 0.0, **parameters},
        }
        scenario = Scenario.model_validate({"name": "reference", "vehicle": vehicle})
        self.pilot = Autopilot(scenario, np.random.default_rng(1))
        self._error = None
        if noise_seed is not None:
            rng = np.random.default_rng(noise_seed)
            self._error = EstimatorError(EstimatorSimulation(), rng)

    def tick(self) -> None:
        """Ten milliseconds."""
        if self._error is None:
            self.pilot.step(TICK_S)
        else:
            self.pilot.step(TICK_S, self._error.step(TICK_S))

    def fly(self, seconds: float, setpoint: Callable[[], None] | None = None) -> None:
        """Let time pass with setpoints at 20 Hz."""
        for tick in range(round(seconds / TICK_S)):
            if setpoint is not None and tick % _SETPOINT_TICKS == 0:
                setpoint()
            self.tick()

    def take_off(self) -> None:
        """To the default altitude, standing still in Hold."""
        if self.pilot.arm() is not Result.ACCEPTED:
            raise RuntimeError(self.pilot.not_armable_because)
        self.pilot.takeoff()
        self.fly(14.0)

    def offboard(self) -> None:
        """OFFBOARD with zero velocity for three seconds."""
        self.velocity(_REST)()
        self.pilot.set_mode(Mode.OFFBOARD.main)
        self.fly(3.0, self.velocity(_REST))

    def velocity(self, ned_m_s: Vector3, yaw_rate_rad_s: float = 0.0) -> Callable[[], None]:
        """A sender of that setpoint."""
        return lambda: self.pilot.set_setpoint(
            velocity_ned_m_s=ned_m_s, yaw_rate_rad_s=yaw_rate_rad_s
        )

    def sample(
        self,
        times_s: list[float],
        read: Callable[[], float],
        setpoint: Callable[[], None] | None = None,
    ) -> list[float]:
        """What `read` says at each of `times_s` from now on."""
        values, tick = [], 0
        for at_s in times_s:
            while tick * TICK_S < at_s - 1e-9:
                if setpoint is not None and tick % _SETPOINT_TICKS == 0:
                    setpoint()
                self.tick()
                tick += 1
            values.append(read())
        return values


def _golden(name: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((GOLDEN / name).read_text())
    return document


def step_curves() -> Iterator[Curve]:
    """Velocity and yaw rate steps and stops in OFFBOARD, both drags."""
    for record in _golden("steps.json")["records"]:
        yield _step_curve(record)


def _step_curve(record: dict[str, Any]) -> Curve:
    axis, name = record["axis"], record["name"]
    flown = Flown(record["drag_per_mass_s"])
    flown.take_off()
    flown.offboard()
    place = {"horizontal": 1 if name.startswith("right") else 0, "vertical": 2, "yaw": 3}[axis]

    def asking(value: float) -> Callable[[], None]:
        if place == 3:
            return flown.velocity(_REST, math.radians(value))
        north, east, down = (value if place == i else 0.0 for i in range(3))
        return flown.velocity((north, east, down))

    def read() -> float:
        if place == 3:
            return math.degrees(flown.pilot.quadrotor.yaw_rate_rad_s)
        return flown.pilot.estimated_velocity_ned_m_s[place]

    if record["before"]:
        flown.fly(record["before_s"], asking(record["before"]))
    times_s = [0.1 * i for i in range(len(record["series"]))]
    simulated = flown.sample(times_s, read, asking(record["setpoint"]))
    unit = "deg/s" if axis == "yaw" else "m/s"
    size = abs(record["setpoint"] or record["before"])
    drag = record["drag_per_mass_s"]
    return Curve(name, drag, unit, times_s, record["series"], simulated, size)


def profile_curves() -> Iterator[Curve]:
    """Take-off, landing, return, the Hold failsafe, a fall: with PX4's simulated drag."""
    golden = _golden("profiles.json")
    yield from _takeoff(golden["takeoff"]["series"])
    yield _landing(golden["land"]["series"])
    yield from _return(golden["return"]["series"])
    yield _hold_failsafe(golden["hold_failsafe"]["series"])
    yield _fall(golden["kill"]["series"])


def _curve(
    name: str, unit: str, series: list[list[float]], column: int, simulated: list[float]
) -> Curve:
    measured = [row[column] for row in series]
    size = max(measured) - min(measured)
    return Curve(name, 1.0, unit, [row[0] for row in series], measured, simulated, size)


def _takeoff(series: list[list[float]]) -> Iterator[Curve]:
    flown = Flown(1.0)
    flown.fly(1.0)
    flown.pilot.arm()
    flown.pilot.takeoff()
    pairs: list[tuple[float, float]] = []

    def read() -> float:
        quadrotor = flown.pilot.quadrotor
        pairs.append((quadrotor.height_m, -quadrotor.velocity_ned_m_s[2]))
        return 0.0

    flown.sample([row[0] for row in series], read)
    yield _curve("take-off: height", "m", series, 1, [height for height, _ in pairs])
    yield _curve("take-off: climb", "m/s", series, 2, [climb for _, climb in pairs])


def _landing(series: list[list[float]]) -> Curve:
    flown = Flown(1.0, MIS_TAKEOFF_ALT=series[0][1])
    flown.take_off()
    flown.fly(15.0)  # the last centimetres of a climb take long
    flown.pilot.land()
    times_s = [row[0] for row in series]
    heights = flown.sample(times_s, lambda: flown.pilot.quadrotor.height_m)
    return _curve("landing: height", "m", series, 1, heights)


def _return(series: list[list[float]]) -> Iterator[Curve]:
    flown = Flown(1.0)
    flown.take_off()
    flown.offboard()
    outwards = flown.velocity((1.0, 0.0, 0.0))
    while flown.pilot.quadrotor.position_ned_m[0] < series[0][1] - 0.7:
        flown.fly(0.05, outwards)
    flown.pilot.return_to_launch()
    pairs: list[tuple[float, float]] = []

    def read() -> float:
        quadrotor = flown.pilot.quadrotor
        pairs.append((quadrotor.position_ned_m[0], quadrotor.height_m))
        return 0.0

    flown.sample([row[0] for row in series], read)
    yield _curve("return: distance", "m", series, 1, [away for away, _ in pairs])
    yield _curve("return: height", "m", series, 2, [height for _, height in pairs])


def _hold_failsafe(series: list[list[float]]) -> Curve:
    flown = Flown(1.0, COM_OBL_RC_ACT=5.0)
    flown.take_off()
    flown.offboard()
    flown.fly(4.0, flown.velocity((0.5, 0.0, 0.0)))
    start_m = flown.pilot.quadrotor.position_ned_m[0]

    def read() -> float:
        return flown.pilot.quadrotor.position_ned_m[0] - start_m

    distances = flown.sample([row[0] for row in series], read)
    return _curve("setpoints stop, Hold: distance", "m", series, 1, distances)


def _fall(series: list[list[float]]) -> Curve:
    flown = Flown(1.0)
    flown.take_off()
    flown.fly(10.0)
    flown.pilot.disarm(force=True)
    heights = flown.sample([row[0] for row in series], lambda: flown.pilot.quadrotor.height_m)
    return _curve("motors cut: height", "m", series, 1, heights)


def position_step(drag_per_mass_s: float) -> tuple[list[float], list[float]]:
    """(measured, simulated) of a metre north in OFFBOARD position.

    Each is [s to 10 %, to 50 %, to 90 %, fastest m/s, farthest m].
    """
    flown = Flown(drag_per_mass_s)
    flown.take_off()
    flown.offboard()
    n, e, d = flown.pilot.estimated_position_ned_m
    target = (n + 1.0, e, d)
    times_s = [TICK_S * i for i in range(800)]
    track = np.array(
        flown.sample(
            times_s,
            lambda: flown.pilot.estimated_position_ned_m[0] - n,
            lambda: flown.pilot.set_setpoint(position_ned_m=target, yaw_rad=0.0),
        )
    )
    crossings = [TICK_S * float(np.argmax(track > share)) for share in (0.1, 0.5, 0.9)]
    simulated = [*crossings, float(np.diff(track).max()) / TICK_S, float(track.max())]
    measured: list[float] = _golden("profiles.json")["position_step"][f"drag_{drag_per_mass_s}"]
    return measured, simulated


def noise(kind: str, seed: int, seconds: float = 30.0) -> Noise:
    """How still it stands: `kind` is hold, offboard_velocity or offboard_position."""
    flown = Flown(1.0, noise_seed=seed)
    flown.take_off()
    setpoint: Callable[[], None] | None = None
    if kind != "hold":
        flown.offboard()
        here = flown.pilot.estimated_position_ned_m
        setpoint = flown.velocity(_REST)
        if kind == "offboard_position":
            setpoint = lambda: flown.pilot.set_setpoint(position_ned_m=here, yaw_rad=0.0)  # noqa: E731
        flown.fly(8.0, setpoint)
    states: list[tuple[Vector3, Vector3]] = []

    def read() -> float:
        pilot = flown.pilot
        states.append((pilot.estimated_position_ned_m, pilot.estimated_velocity_ned_m_s))
        return 0.0

    flown.sample([0.02 * i for i in range(round(seconds / 0.02))], read, setpoint)
    position, velocity = (np.array([state[i] for state in states]) for i in range(2))
    return Noise(
        _vector(position.std(axis=0)),
        _vector(velocity.std(axis=0)),
        _vector(position[-1] - position[0]),
        _vector(np.diff(velocity, axis=0).std(axis=0)),
    )


def measured_noise(kind: str) -> Noise:
    """As `noise`, measured."""
    golden = _golden("profiles.json")["noise"][kind]
    keys = ("position", "velocity", "drift", "sample")
    return Noise(*(_vector(np.array(golden[key])) for key in keys))


def _vector(values: "np.ndarray[Any, Any]") -> Vector3:
    return (float(values[0]), float(values[1]), float(values[2]))
