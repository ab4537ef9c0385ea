"""How a PX4 multicopter moves: its velocity, position and yaw loops as fitted to measured steps.

Horizontal velocity loop, each axis (fitted to all step and stop records to 4 % rms of the step)::

    u     = 1.8 (v_sp - v) + I - 0.2 dv/dt      dI/dt = 0.4 (v_sp - v)
    da/dt = (u - a) / 0.26 s                    dv/dt = a - k v        dead time 0.03 s

The vertical loop has the same form with PX4's own gains 4.0 and 2.0 and a lag of 0.043 s (1 % rms);
the yaw rate is two lags of 0.135 s behind 0.09 s of dead time (3 % rms). Outside them lies the
position loop, `v_sp = v_ff + gain (p_sp - p)`, limited. Source of the records: measured on PX4 main
bb59c637cd, SIH quadrotor, 2026-11 (tests/golden/px4).

How the vehicle turns to a yaw *angle* was not measured: the gain here gives a settled turn of
about 2 s without noticeable overshoot.
"""

import math
import struct
from enum import IntEnum

import msgspec
import numpy as np
from numba import njit
from numpy.typing import NDArray

from hal.frames import ZERO3, Vector3
from hal.sim.px4 import Parameters
from hal.sim.sensors import EstimateOffset

SUBSTEP_S = 0.01
GRAVITY_M_S2 = 9.80665

_NAN = math.nan
FREE3: Vector3 = (_NAN, _NAN, _NAN)

# Layout of the state vector.
_POS, _VEL, _ACC, _INT = 0, 3, 6, 9
_YAW, _RATE, _RATE_LAG = 12, 13, 14
# Dead times as shift registers of substeps: 0.03 s, 0.03 s, 0.02 s, 0.09 s.
_DELAY_N, _DELAY_E, _DELAY_D, _DELAY_YAW = 15, 18, 21, 23
_STATE_SIZE = 32

# Layout of the command vector.
_P_SP, _V_SP, _YAW_SP, _RATE_SP = 0, 3, 6, 7
_P_ERR, _V_ERR, _YAW_ERR, _A_FF = 8, 11, 14, 15
_COMMAND_SIZE = 18
_SETPOINT, _ERROR, _FEED_FORWARD = struct.Struct("=8d"), struct.Struct("=7d"), struct.Struct("=3d")
_FLOAT_BYTES = 8

_YAW_LAG_S = 0.135
_YAW_GAIN_PER_S = 1.3


class Motors(IntEnum):
    """What the motors do."""

    STOPPED = 0
    IDLE = 1  # spinning, thrust below weight: the vehicle stays where it stands
    FLYING = 2


class Command(msgspec.Struct, frozen=True):
    """What PX4's position controller is asked for; NaN leaves a component free, as in PX4.

    With a position and a velocity the velocity is the feed-forward. A free yaw and a free yaw rate
    keep the rate at zero.
    """

    position_ned_m: Vector3 = FREE3
    velocity_ned_m_s: Vector3 = FREE3
    yaw_rad: float = _NAN
    yaw_rate_rad_s: float = _NAN
    acceleration_ned_m_s2: Vector3 = ZERO3
    """Feed-forward, never free."""


class Limits(msgspec.Struct, frozen=True):
    """The controller's gains and limits that are parameters in PX4."""

    position_gain_per_s: float = 0.95  # MPC_XY_P
    height_gain_per_s: float = 1.0  # MPC_Z_P
    horizontal_m_s: float = 12.0  # MPC_XY_VEL_MAX
    up_m_s: float = 3.0  # MPC_Z_VEL_MAX_UP
    down_m_s: float = 1.5  # MPC_Z_VEL_MAX_DN
    yaw_rate_rad_s: float = math.radians(200.0)  # MC_YAWRATE_MAX

    @classmethod
    def of(cls, parameters: Parameters) -> "Limits":
        """As an autopilot with these parameters has them."""
        return cls(
            position_gain_per_s=float(parameters["MPC_XY_P"]),
            height_gain_per_s=float(parameters["MPC_Z_P"]),
            horizontal_m_s=float(parameters["MPC_XY_VEL_MAX"]),
            up_m_s=float(parameters["MPC_Z_VEL_MAX_UP"]),
            down_m_s=float(parameters["MPC_Z_VEL_MAX_DN"]),
            yaw_rate_rad_s=math.radians(float(parameters["MC_YAWRATE_MAX"])),
        )


EXACT = EstimateOffset(ZERO3, ZERO3, 0.0)
_DEFAULT_LIMITS = Limits()


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _limited(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _demand(p_sp: float, v_sp: float, estimate: float, gain: float) -> float:
    """Velocity wanted along one axis; NaN means that the component is free."""
    demand = 0.0 if math.isnan(v_sp) else v_sp
    if not math.isnan(p_sp):
        demand += gain * (p_sp - estimate)
    return demand


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _turn_demand(c: NDArray[np.float64], yaw: float, limit: float) -> float:
    rate = 0.0 if math.isnan(c[_RATE_SP]) else c[_RATE_SP]
    if not math.isnan(c[_YAW_SP]):
        error = (c[_YAW_SP] - yaw - c[_YAW_ERR] + math.pi) % (2.0 * math.pi) - math.pi
        rate += _YAW_GAIN_PER_S * error
    return _limited(rate, -limit, limit)


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _shift(s: NDArray[np.float64], first: int, last: int, newest: float) -> float:
    """Push `newest` into the shift register s[first:last]; what falls out."""
    oldest: float = s[first]
    for i in range(first, last - 1):
        s[i] = s[i + 1]
    s[last - 1] = newest
    return oldest


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _axis(
    s: NDArray[np.float64], c: NDArray[np.float64], i: int, sp: float, h: float, k: float
) -> None:
    """One substep of the velocity loop of axis `i`."""
    p_gain, i_gain, d_gain, lag = (1.8, 0.4, 0.2, 0.26) if i < 2 else (4.0, 2.0, 0.0, 0.043)
    dv = s[_ACC + i] - k * s[_VEL + i]
    error = sp - s[_VEL + i] - c[_V_ERR + i]
    u = p_gain * error + s[_INT + i] - d_gain * dv + c[_A_FF + i]
    u = _limited(u, -GRAVITY_M_S2, GRAVITY_M_S2)
    s[_INT + i] = _limited(s[_INT + i] + i_gain * error * h, -5.0, 5.0)
    s[_ACC + i] += (u - s[_ACC + i]) / lag * h
    s[_VEL + i] += dv * h
    s[_POS + i] += s[_VEL + i] * h


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _unpowered(s: NDArray[np.float64], h: float, k: float, floor: float) -> None:
    """One substep without thrust: free fall with drag, or standing on the floor."""
    for i in range(_ACC, _INT + 3):
        s[i] = 0.0
    s[_RATE] = s[_RATE_LAG] = 0.0
    standing = s[_POS + 2] >= floor - 1e-9
    for i in range(3):
        if standing:
            s[_VEL + i] = 0.0
            continue
        pull = GRAVITY_M_S2 if i == 2 else 0.0
        s[_VEL + i] += (pull - k * s[_VEL + i]) * h
        s[_POS + i] += s[_VEL + i] * h


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _touch(s: NDArray[np.float64], floor: float) -> None:
    """The floor holds the vehicle, and friction its place."""
    if s[_POS + 2] < floor:
        return
    s[_POS + 2] = floor
    for first in (_VEL, _ACC, _INT):
        s[first] = s[first + 1] = 0.0
        s[first + 2] = min(s[first + 2], 0.0)


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _advance(
    s: NDArray[np.float64],
    c: NDArray[np.float64],
    limits: NDArray[np.float64],
    powered: bool,  # noqa: FBT001  a kernel has no keyword arguments
    steps: int,
    h: float,
    k: float,
    floor: float,
) -> None:
    """Advance the state `s` by `steps` substeps of `h` seconds, in place."""
    for _ in range(steps):
        north = _demand(c[0], c[3], s[0] + c[_P_ERR], limits[0])
        east = _demand(c[1], c[4], s[1] + c[_P_ERR + 1], limits[0])
        down = _demand(c[2], c[5], s[2] + c[_P_ERR + 2], limits[1])
        excess = math.sqrt(north * north + east * east) / limits[2]
        if excess > 1.0:
            north, east = north / excess, east / excess
        down = _limited(down, -limits[3], limits[4])
        turn = _turn_demand(c, s[_YAW], limits[5])
        north = _shift(s, _DELAY_N, _DELAY_E, north)
        east = _shift(s, _DELAY_E, _DELAY_D, east)
        down = _shift(s, _DELAY_D, _DELAY_YAW, down)
        turn = _shift(s, _DELAY_YAW, _STATE_SIZE, turn)
        if not powered:
            _unpowered(s, h, k, floor)
            _touch(s, floor)
            continue
        _axis(s, c, 0, north, h, k)
        _axis(s, c, 1, east, h, k)
        _axis(s, c, 2, down, h, k)
        s[_RATE_LAG] += (turn - s[_RATE_LAG]) / _YAW_LAG_S * h
        s[_RATE] += (s[_RATE_LAG] - s[_RATE]) / _YAW_LAG_S * h
        s[_YAW] = (s[_YAW] + s[_RATE] * h + math.pi) % (2.0 * math.pi) - math.pi
        _touch(s, floor)


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _obey(
    s: NDArray[np.float64],
    c: NDArray[np.float64],
    limits: NDArray[np.float64],
    steps: int,
    h: float,
    floor: float,
) -> None:
    """As `_advance` with power, but what is asked is there within the substep."""
    for i in range(_ACC, _INT + 3):
        s[i] = 0.0
    for i in range(_DELAY_N, _STATE_SIZE):
        s[i] = 0.0
    for _ in range(steps):
        north = _demand(c[0], c[3], s[0] + c[_P_ERR], limits[0])
        east = _demand(c[1], c[4], s[1] + c[_P_ERR + 1], limits[0])
        down = _demand(c[2], c[5], s[2] + c[_P_ERR + 2], limits[1])
        excess = math.sqrt(north * north + east * east) / limits[2]
        if excess > 1.0:
            north, east = north / excess, east / excess
        s[_VEL] = north - c[_V_ERR]
        s[_VEL + 1] = east - c[_V_ERR + 1]
        s[_VEL + 2] = _limited(down, -limits[3], limits[4]) - c[_V_ERR + 2]
        s[_RATE] = s[_RATE_LAG] = _turn_demand(c, s[_YAW], limits[5])
        for i in range(3):
            s[_POS + i] += s[_VEL + i] * h
        s[_YAW] = (s[_YAW] + s[_RATE] * h + math.pi) % (2.0 * math.pi) - math.pi
        _touch(s, floor)


class Quadrotor:
    """True state of the vehicle in NED, and the loops that move it.

    `drag_per_mass_s` is k above (1/s): 1.0 for the SIH default, 0.2 for a small real quadrotor.
    `floor_down_m` is the surface that it stands on.
    """

    def __init__(
        self,
        *,
        drag_per_mass_s: float = 1.0,
        position_ned_m: Vector3 = ZERO3,
        yaw_rad: float = 0.0,
        floor_down_m: float = 0.0,
        limits: Limits = _DEFAULT_LIMITS,
    ) -> None:
        self._drag_per_s = float(drag_per_mass_s)
        self._floor_m = float(floor_down_m)
        self._state = np.zeros(_STATE_SIZE)
        self._state[_POS : _POS + 3] = position_ned_m
        self._state[_YAW] = yaw_rad
        self._told: list[float] = self._state.tolist()  # read often, and reading numpy is slow
        self._tilt_rad: tuple[float, float] | None = None
        self._command = np.zeros(_COMMAND_SIZE)
        self._last: Command | None = None
        self._limits = np.zeros(6)
        self.limit(limits)

    def limit(self, limits: Limits) -> None:
        """Take new gains and limits."""
        self._limits[:] = msgspec.structs.astuple(limits)

    def step(
        self,
        dt_s: float,
        command: Command,
        motors: Motors = Motors.FLYING,
        error: EstimateOffset = EXACT,
    ) -> None:
        """Fly `command` for `dt_s` seconds, in equal substeps of about 10 ms.

        The loops close on the estimate, which is the truth plus `error`.
        """
        c = self._command
        if command is not self._last:
            _SETPOINT.pack_into(
                c.data,
                _P_SP * _FLOAT_BYTES,
                *command.position_ned_m,
                *command.velocity_ned_m_s,
                command.yaw_rad,
                command.yaw_rate_rad_s,
            )
            _FEED_FORWARD.pack_into(c.data, _A_FF * _FLOAT_BYTES, *command.acceleration_ned_m_s2)
            self._last = command
        off = (*error.position_ned_m, *error.velocity_ned_m_s, error.yaw_rad)
        _ERROR.pack_into(c.data, _P_ERR * _FLOAT_BYTES, *off)
        steps = max(1, round(dt_s / SUBSTEP_S))
        self._advance(motors is Motors.FLYING, steps, dt_s / steps)
        self._told = self._state.tolist()
        self._tilt_rad = None

    def _advance(self, powered: bool, steps: int, h_s: float) -> None:  # noqa: FBT001  as the kernel's
        _advance(
            self._state,
            self._command,
            self._limits,
            powered,
            steps,
            h_s,
            self._drag_per_s,
            self._floor_m,
        )

    def _triple(self, at: int) -> Vector3:
        s = self._told
        return (s[at], s[at + 1], s[at + 2])

    @property
    def position_ned_m(self) -> Vector3:
        """True position."""
        return self._triple(_POS)

    @property
    def velocity_ned_m_s(self) -> Vector3:
        """True velocity."""
        return self._triple(_VEL)

    @property
    def yaw_rad(self) -> float:
        """True heading in [-pi, pi)."""
        return self._told[_YAW]

    @property
    def yaw_rate_rad_s(self) -> float:
        """True yaw rate."""
        return self._told[_RATE]

    @property
    def height_m(self) -> float:
        """Height above the floor."""
        return self._floor_m - self._told[2]

    @property
    def on_ground(self) -> bool:
        """True while the floor carries the vehicle."""
        return self._told[2] >= self._floor_m - 1e-6

    @property
    def tilt_rad(self) -> tuple[float, float]:
        """(roll, pitch): the thrust's horizontal part needs tan(angle) = acceleration / g."""
        if self._tilt_rad is None:
            s = self._told
            north, east, yaw = s[_ACC], s[_ACC + 1], s[_YAW]
            c, n = math.cos(yaw), math.sin(yaw)
            forward, right = c * north + n * east, -n * north + c * east
            self._tilt_rad = math.atan2(right, GRAVITY_M_S2), -math.atan2(forward, GRAVITY_M_S2)
        return self._tilt_rad


class IdealQuadrotor(Quadrotor):
    """Velocity and yaw rate are what the position controller asks for, at once: no lag, no dead
    time, no overshoot, no tilt. The controller, its limits and the estimate's error are the same.

    Nothing flies so: beside it one sees how much of a flight is PX4's response.
    """

    def _advance(self, powered: bool, steps: int, h_s: float) -> None:  # noqa: FBT001
        if powered:
            _obey(self._state, self._command, self._limits, steps, h_s, self._floor_m)
        else:
            super()._advance(powered, steps, h_s)


def warm_up() -> None:
    """Compile the kernels with the types used in flight."""
    Quadrotor().step(SUBSTEP_S, Command())
    IdealQuadrotor().step(SUBSTEP_S, Command())
