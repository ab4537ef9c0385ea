"""What a vehicle can be asked: a setpoint every tick, and requests that it accepts or refuses."""

import math
from enum import StrEnum

import msgspec

from hal.errors import ReadingRefused
from hal.frames import ZERO3, Vector3, finite3


class Setpoint(msgspec.Struct, frozen=True):
    """Be at `position_ned_m`, moving with `velocity_ned_m_s`, heading `yaw_rad`.

    PX4's position controller adds `MPC_XY_P * (position error)` to the velocity; a zero velocity
    therefore holds the position (zero velocity *alone* drifts: 12 cm in 30 s were measured).
    Frame: the autopilot's local NED frame.
    """

    stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3 = ZERO3
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        if not (
            math.isfinite(self.stamp_s)
            and math.isfinite(self.yaw_rad)
            and finite3(self.position_ned_m)
            and finite3(self.velocity_ned_m_s)
        ):
            raise ReadingRefused("setpoint: a component is not a number")


class RequestKind(StrEnum):
    """Requests to the autopilot. There is none that cuts the motors in the air."""

    ARM = "arm"
    TAKEOFF = "takeoff"
    OFFBOARD = "offboard"
    HOLD = "hold"
    LAND = "land"
    DISARM = "disarm"  # PX4 refuses it unless landed


class Request(msgspec.Struct, frozen=True):
    """One request. `altitude_m` (above the take-off point) belongs to TAKEOFF only."""

    kind: RequestKind
    altitude_m: float = 0.0


class Reply(msgspec.Struct, frozen=True):
    """The autopilot's answer; `reason` is a sentence when it was not accepted."""

    stamp_s: float
    kind: RequestKind
    accepted: bool
    reason: str = ""
