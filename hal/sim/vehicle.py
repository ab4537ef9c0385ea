"""A PX4 vehicle in this process, on simulated time: `hal.interfaces.Vehicle` around `Autopilot`.

The core is synchronous: `advance`, `execute_now`. The coroutines only wrap it, so that the same
object flies a simulation at hundreds of times real time and stands in for a link in tests.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import msgspec
import numpy as np

from hal.clock import SimClock
from hal.errors import ConnectionFailed
from hal.frames import Vector3
from hal.readings import (
    Attitude,
    LocalPosition,
    StatusText,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Reply, Request, RequestKind, Setpoint
from hal.sim.autopilot import Autopilot
from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import FaultWindow
from hal.sim.link_faults import FaultyChannel
from hal.sim.px4 import Mode, Result
from hal.sim.quadrotor import EXACT
from hal.sim.sensors import EstimateOffset, EstimatorError
from hal.sim.vehicle_faults import EstimateFaults, VehicleFaults

_TEXTS_KEPT = 64
ASKED_PARAMETERS = (
    "COM_OBL_RC_ACT",
    "COM_OF_LOSS_T",
    "COM_DISARM_LAND",
    "COM_DISARM_PRFLT",
    "GF_ACTION",
    "MIS_TAKEOFF_ALT",
    "MPC_LAND_SPEED",
    "MPC_XY_P",
    "MPC_XY_VEL_MAX",
    "MPC_Z_VEL_MAX_DN",
    "MPC_Z_VEL_MAX_UP",
    "NAV_DLL_ACT",
    "NAV_RCL_ACT",
    "RTL_RETURN_ALT",
)
"""What a client asks for when it connects; the others stay with the autopilot."""
_LONGEST_STEP_S = 0.05


class Truth(msgspec.Struct, frozen=True):
    """The vehicle as it really is, in NED about the take-off point."""

    stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rad_s: float
    armed: bool
    on_ground: bool


def truth_of(autopilot: Autopilot, stamp_s: float) -> Truth:
    """The true state behind an autopilot's belief."""
    quad = autopilot.quadrotor
    roll, pitch = quad.tilt_rad
    return Truth(
        stamp_s,
        quad.position_ned_m,
        quad.velocity_ned_m_s,
        roll,
        pitch,
        quad.yaw_rad,
        quad.yaw_rate_rad_s,
        autopilot.armed,
        quad.on_ground,
    )


class _Told(NamedTuple):
    """What the vehicle sends in one step."""

    position: LocalPosition
    attitude: Attitude
    status: VehicleStatus
    texts: tuple[StatusText, ...]


class SimVehicle:
    """One simulated PX4 multicopter.

    Stamps are the clock's time. `estimator` makes the autopilot's estimate differ from the truth;
    without it the estimate is exact. Of `faults` those of the vehicle, its estimate and its link
    are flown; `rng` is for the link's.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        clock: SimClock,
        estimator: EstimatorError | None = None,
        *,
        faults: Iterable[FaultWindow] = (),
        fault_clock: FaultClock | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        faults, when = tuple(faults), fault_clock or FaultClock(clock.now_s())
        rng = rng if rng is not None else np.random.default_rng(0)
        self._faults = VehicleFaults(autopilot, faults, when)
        self._estimate_faults = EstimateFaults(faults, when)
        self._up: FaultyChannel[Setpoint] = FaultyChannel(faults, "up", rng, when)
        self._down: FaultyChannel[_Told] = FaultyChannel(faults, "down", rng, when)
        self._heard_s = clock.now_s()
        self._autopilot = autopilot
        self._clock = clock
        self._facts: tuple[int, VehicleFacts] | None = None
        self._estimator = estimator
        self._texts: deque[StatusText] = deque(maxlen=_TEXTS_KEPT)
        self._offset_s = clock.now_s() - autopilot.now_s
        self._reset_counter = 0
        self._shift_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._silent_since_s: float | None = None
        self._position: LocalPosition | None = None
        self._attitude: Attitude | None = None
        self._status = self._read_status(clock.now_s())

    @property
    def autopilot(self) -> Autopilot:
        """The autopilot inside, with the true state."""
        return self._autopilot

    # ------------------------------------------------------------ simulation

    def truth(self) -> Truth:
        """The true state, which only a simulation knows."""
        return truth_of(self._autopilot, self._clock.now_s())

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass: the clock moves on and the vehicle flies."""
        steps = max(1, math.ceil(dt_s / _LONGEST_STEP_S - 1e-9))
        for _ in range(steps):
            self._clock.advance(dt_s / steps)
            self._step(dt_s / steps)

    def _step(self, dt_s: float) -> None:
        error = self._estimator.step(dt_s) if self._estimator is not None else EXACT
        shift = self._shift_ned_m
        if shift != (0.0, 0.0, 0.0):
            p = error.position_ned_m
            error = EstimateOffset(
                (p[0] + shift[0], p[1] + shift[1], p[2] + shift[2]),
                error.velocity_ned_m_s,
                error.yaw_rad,
            )
        now_s = self._clock.now_s()
        self._faults.step(now_s)
        error = self._with_faults(now_s, error)
        for setpoint in self._up.take(now_s):
            self._obey(setpoint)
        self._autopilot.step(dt_s, error)
        if self._silent_since_s is None:
            self._publish()

    def _with_faults(self, now_s: float, error: EstimateOffset) -> EstimateOffset:
        """The estimate's offset with its faults; the autopilot's own setpoints follow a jump."""
        spoilt, jump = self._estimate_faults.spoil(now_s, error)
        if jump is not None:
            self._autopilot.shift_estimate(jump.position_ned_m, jump.yaw_rad)
        return spoilt

    def jump_estimate(self, shift_ned_m: Vector3) -> None:
        """Let the local frame jump, as an EKF reset does; the reset counter says so."""
        s = self._shift_ned_m
        self._shift_ned_m = (
            s[0] + shift_ned_m[0],
            s[1] + shift_ned_m[1],
            s[2] + shift_ned_m[2],
        )
        self._reset_counter = (self._reset_counter + 1) % 256

    def cut_link(self) -> None:
        """From now on nothing arrives in either direction; the vehicle flies on by itself."""
        if self._silent_since_s is None:
            self._silent_since_s = self._clock.now_s()

    def restore_link(self) -> None:
        """The link is there again."""
        self._silent_since_s = None

    def _publish(self) -> None:
        now_s, autopilot = self._clock.now_s(), self._autopilot
        quad = autopilot.quadrotor
        position = LocalPosition(
            now_s,
            autopilot.estimated_position_ned_m,
            autopilot.estimated_velocity_ned_m_s,
            (self._reset_counter + self._estimate_faults.resets) % 256,
        )
        roll, pitch = quad.tilt_rad
        attitude = Attitude(now_s, roll, pitch, autopilot.estimated_yaw_rad, quad.yaw_rate_rad_s)
        texts = tuple(
            StatusText(text.at_s + self._offset_s, int(text.severity), text.text)
            for text in autopilot.texts
        )
        autopilot.texts.clear()
        if autopilot.silent:
            return
        told = _Told(position, attitude, self._read_status(now_s), texts)
        if self._down.sound:
            self._hear(now_s, told)
            return
        self._down.put(now_s, told)
        for arrived in self._down.take(now_s):
            self._hear(now_s, arrived)

    def _hear(self, now_s: float, told: _Told) -> None:
        """What was sent arrives; what was overtaken on the way is not believed."""
        self._heard_s = now_s
        self._texts.extend(told.texts)
        if self._position is None or told.position.stamp_s >= self._position.stamp_s:
            self._position, self._attitude, self._status = told[:3]

    def _read_status(self, now_s: float) -> VehicleStatus:
        autopilot = self._autopilot
        reason = "" if autopilot.armed else autopilot.not_armable_because
        return VehicleStatus(
            stamp_s=now_s,
            armed=autopilot.armed,
            mode=autopilot.mode.flight_mode,
            landed=autopilot.landed.landed_state,
            link_age_s=0.0,
            armable=not reason,
            not_armable_because=reason,
            battery_remaining=autopilot.battery_remaining,
            in_failsafe=autopilot.in_failsafe,
            global_position=autopilot.global_position,
        )

    # ------------------------------------------------------------ the contract

    async def open(self, deadline_s: float) -> VehicleFacts:
        """As `hal.interfaces.Vehicle.open`; ConnectionFailed when the link is cut."""
        if self._silent_since_s is not None:
            raise ConnectionFailed(
                f"the simulated vehicle did not answer within {deadline_s:g} s: restore its link"
            )
        self._publish()
        return self.facts()

    async def close(self) -> None:
        """Nothing to let go of."""

    def facts(self) -> VehicleFacts:
        """Who it is, with the values of `ASKED_PARAMETERS`; the same object until one changes."""
        parameters = self._autopilot.parameters
        if self._facts is None or self._facts[0] != parameters.changes:
            asked = {n: float(parameters[n]) for n in ASKED_PARAMETERS if n in parameters}
            facts = VehicleFacts("PX4", "simulated", 1, asked, booted_s=0.0)
            self._facts = (parameters.changes, facts)
        return self._facts[1]

    def local_position(self) -> LocalPosition | None:
        """The newest estimate."""
        return self._position

    def attitude(self) -> Attitude | None:
        """The newest attitude."""
        return self._attitude

    def status(self) -> VehicleStatus:
        """The newest status, its link age counted to now."""
        now_s, status = self._clock.now_s(), self._status
        since_s = self._heard_s if self._silent_since_s is None else status.stamp_s
        if now_s == since_s:
            return status
        return VehicleStatus(
            status.stamp_s,
            status.armed,
            status.mode,
            status.landed,
            now_s - since_s,
            status.armable,
            status.not_armable_because,
            status.battery_remaining,
            status.in_failsafe,
            status.global_position,
        )

    def take_texts(self) -> tuple[StatusText, ...]:
        """Status texts since the last call, oldest first."""
        texts = tuple(self._texts)
        self._texts.clear()
        return texts

    def send(self, setpoint: Setpoint) -> None:
        """One offboard setpoint, valid from now on."""
        if self._silent_since_s is not None:
            return
        if self._up.sound:
            self._obey(setpoint)
        else:
            self._up.put(self._clock.now_s(), setpoint)

    def _obey(self, setpoint: Setpoint) -> None:
        if not self._autopilot.silent:
            self._autopilot.set_setpoint(
                setpoint.position_ned_m, setpoint.velocity_ned_m_s, setpoint.yaw_rad
            )

    def stop_now(self) -> None:
        """A setpoint that stays where the vehicle is, by its own estimate."""
        autopilot = self._autopilot
        self.send(
            Setpoint(
                self._clock.now_s(),
                autopilot.estimated_position_ned_m,
                yaw_rad=autopilot.estimated_yaw_rad,
            )
        )

    def execute_now(self, request: Request) -> Reply:
        """Carry out one request; a refusal's reason is what the autopilot wrote."""
        now_s = self._clock.now_s()
        cut = self._silent_since_s is not None or self._autopilot.silent
        if cut or self._up.lost(now_s) or self._down.lost(now_s):
            return Reply(now_s, request.kind, accepted=False, reason="the vehicle did not answer")
        if request.kind is RequestKind.OFFBOARD:
            against = self.status().against_offboard()
            if against is not None:
                return Reply(now_s, request.kind, accepted=False, reason=against)
        before = len(self._autopilot.texts)
        result = self._request(request)
        said = [text.text for text in list(self._autopilot.texts)[before:]]
        self._publish()
        if result is Result.ACCEPTED:
            return Reply(now_s, request.kind, accepted=True)
        reason = "; ".join(said) or f"the autopilot answered {result.name.lower()}"
        return Reply(now_s, request.kind, accepted=False, reason=reason)

    async def execute(self, request: Request) -> Reply:
        """As `execute_now`."""
        return self.execute_now(request)

    def _request(self, request: Request) -> Result:
        autopilot = self._autopilot
        match request.kind:
            case RequestKind.ARM:
                return autopilot.arm()
            case RequestKind.DISARM:
                return autopilot.disarm()
            case RequestKind.TAKEOFF:
                return self._takeoff(request.altitude_m)
            case RequestKind.LAND:
                return autopilot.land()
            case RequestKind.OFFBOARD:
                return autopilot.set_mode(Mode.OFFBOARD.main)
            case RequestKind.HOLD:
                return autopilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub)

    def _takeoff(self, altitude_m: float) -> Result:
        """MIS_TAKEOFF_ALT counts above home, as MAVSDK's take-off altitude does."""
        self._autopilot.set_parameter("MIS_TAKEOFF_ALT", altitude_m)
        return self._autopilot.takeoff(math.nan)
