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
from enum import IntEnum

import msgspec
import numpy as np
from numba import njit
from numpy.typing import NDArray

from hal.frames import ZERO3, Vector3
from hal.sim.sensors import EstimateOffset

SUBSTEP_S = 0.01
GRAVITY_M_S2 = 9.80665

_NAN = math.nan
FREE3: Vector3 = (_NAN, _NAN, _NAN)

# Layout of the state vector.
_POS, _VEL, _ACC, _INT = 0, 3, 6, 9
_YAW, _RATE, _RATE_LAG = 12, 13, 14
_DELAY_H, _DELAY_Z, _DELAY_YAW = 15, 21, 23
_DELAY_YAW_STEPS = 9
_STATE_SIZE = _DELAY_YAW + _DELAY_YAW_STEPS

# Layout of the command vector.
_P_SP, _V_SP, _YAW_SP, _RATE_SP = 0, 3, 6, 7
_P_ERR, _V_ERR, _YAW_ERR, _A_FF = 8, 11, 14, 15
_COMMAND_SIZE = 18


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


EXACT = EstimateOffset(ZERO3, ZERO3, 0.0)
_DEFAULT_LIMITS = Limits()


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _advance(
    s: NDArray[np.float64],
    c: NDArray[np.float64],
    limits: NDArray[np.float64],
    motors: int,
    steps: int,
    h: float,
    k: float,
    floor: float,
) -> None:
    """Advance the state `s` by `steps` substeps of `h` seconds, in place."""
    for _ in range(steps):
        # ---- position loop, on the estimate
        vn = 0.0 if math.isnan(c[3]) else c[3]
        ve = 0.0 if math.isnan(c[4]) else c[4]
        vd = 0.0 if math.isnan(c[5]) else c[5]
        if not math.isnan(c[0]):
            vn += limits[0] * (c[0] - s[0] - c[8])
        if not math.isnan(c[1]):
            ve += limits[0] * (c[1] - s[1] - c[9])
        if not math.isnan(c[2]):
            vd += limits[1] * (c[2] - s[2] - c[10])
        speed = math.sqrt(vn * vn + ve * ve)
        if speed > limits[2]:
            vn *= limits[2] / speed
            ve *= limits[2] / speed
        vd = min(max(vd, -limits[3]), limits[4])
        rate = 0.0 if math.isnan(c[7]) else c[7]
        if not math.isnan(c[6]):
            error = (c[6] - s[12] - c[14] + math.pi) % (2.0 * math.pi) - math.pi
            rate += 1.3 * error
        rate = min(max(rate, -limits[5]), limits[5])
        # ---- dead times: shift registers, oldest first
        sp_n, sp_e, sp_d, sp_r = s[15], s[16], s[21], s[23]
        for i in range(15, 19):
            s[i] = s[i + 2]
        s[19], s[20] = vn, ve
        s[21] = s[22]
        s[22] = vd
        for i in range(23, 31):
            s[i] = s[i + 1]
        s[31] = rate
        if motors < 2:
            for i in range(6, 12):
                s[i] = 0.0
            s[13] = 0.0
            s[14] = 0.0
            fall = 0.0
            if s[2] < floor - 1e-9:
                fall = 9.80665
            else:
                s[3] = 0.0
                s[4] = 0.0
                s[5] = 0.0
            s[3] -= k * s[3] * h
            s[4] -= k * s[4] * h
            s[5] += (fall - k * s[5]) * h
            for i in range(3):
                s[i] += s[3 + i] * h
            if s[2] >= floor:
                s[2] = floor
                s[5] = 0.0
            continue
        # ---- velocity loops
        for i in range(3):
            sp = sp_n if i == 0 else (sp_e if i == 1 else sp_d)
            p_gain, i_gain, d_gain, lag = (1.8, 0.4, 0.2, 0.26) if i < 2 else (4.0, 2.0, 0.0, 0.043)
            dv = s[6 + i] - k * s[3 + i]
            error = sp - s[3 + i] - c[11 + i]
            u = p_gain * error + s[9 + i] - d_gain * dv + c[15 + i]
            u = min(max(u, -9.80665), 9.80665)
            s[9 + i] = min(max(s[9 + i] + i_gain * error * h, -5.0), 5.0)
            s[6 + i] += (u - s[6 + i]) / lag * h
            s[3 + i] += dv * h
            s[i] += s[3 + i] * h
        s[14] += (sp_r - s[14]) / 0.135 * h
        s[13] += (s[14] - s[13]) / 0.135 * h
        s[12] = (s[12] + s[13] * h + math.pi) % (2.0 * math.pi) - math.pi
        # ---- the floor holds the vehicle, and friction its place
        if s[2] >= floor:
            s[2] = floor
            for i in range(3):
                s[3 + i] = min(s[3 + i], 0.0) if i == 2 else 0.0
                s[6 + i] = min(s[6 + i], 0.0) if i == 2 else 0.0
                s[9 + i] = min(s[9 + i], 0.0) if i == 2 else 0.0


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
            c[_P_SP : _P_SP + 3] = command.position_ned_m
            c[_V_SP : _V_SP + 3] = command.velocity_ned_m_s
            c[_YAW_SP] = command.yaw_rad
            c[_RATE_SP] = command.yaw_rate_rad_s
            c[_A_FF : _A_FF + 3] = command.acceleration_ned_m_s2
            self._last = command
        if error is not EXACT:
            c[_P_ERR : _P_ERR + 3] = error.position_ned_m
            c[_V_ERR : _V_ERR + 3] = error.velocity_ned_m_s
            c[_YAW_ERR] = error.yaw_rad
        else:
            c[_P_ERR : _YAW_ERR + 1] = 0.0
        steps = max(1, round(dt_s / SUBSTEP_S))
        _advance(
            self._state,
            c,
            self._limits,
            int(motors),
            steps,
            dt_s / steps,
            self._drag_per_s,
            self._floor_m,
        )

    def _triple(self, at: int) -> Vector3:
        s = self._state
        return (float(s[at]), float(s[at + 1]), float(s[at + 2]))

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
        return float(self._state[_YAW])

    @property
    def yaw_rate_rad_s(self) -> float:
        """True yaw rate."""
        return float(self._state[_RATE])

    @property
    def height_m(self) -> float:
        """Height above the floor."""
        return self._floor_m - float(self._state[2])

    @property
    def on_ground(self) -> bool:
        """True while the floor carries the vehicle."""
        return float(self._state[2]) >= self._floor_m - 1e-6

    @property
    def tilt_rad(self) -> tuple[float, float]:
        """(roll, pitch): the thrust's horizontal part needs tan(angle) = acceleration / g."""
        s = self._state
        north, east, yaw = float(s[_ACC]), float(s[_ACC + 1]), float(s[_YAW])
        c, n = math.cos(yaw), math.sin(yaw)
        forward, right = c * north + n * east, -n * north + c * east
        return (math.atan2(right, GRAVITY_M_S2), -math.atan2(forward, GRAVITY_M_S2))


def warm_up() -> None:
    """Compile the kernel with the types used in flight."""
    Quadrotor().step(SUBSTEP_S, Command())
