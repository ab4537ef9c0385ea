"""What the guard is told, and what it says."""

import math

import msgspec

from hal.config import BeamMount
from hal.errors import ReadingRefused
from hal.frames import Vector3, finite3
from hal.interfaces import SeenSpace
from hal.readings import RangeReading
from hal.setpoints import Setpoint


class BeamSight(msgspec.Struct, frozen=True):
    """The newest reading of one beam, and where that beam looks."""

    mount: BeamMount
    reading: RangeReading


class Sight(msgspec.Struct, frozen=True):
    """What the guard may know at one tick; raises ReadingRefused when a number is none.

    `position_ned_m`, `velocity_ned_m_s`: the vehicle at `fused_stamp_s`, in the frame of the
    setpoint; `position_ok` is False when the estimator would not fly by it; `position_sigma_m`:
    its one-sigma horizontal uncertainty. `yaw_rad`: heading of the nose. `beams`: one entry for
    each beam, in any order, only those that are fresh. `space`: what was seen to be free.
    Altitudes are -down.
    """

    now_s: float
    fused_stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_rad: float
    space: SeenSpace
    beams: tuple[BeamSight, ...] = ()
    position_sigma_m: float = 0.0
    position_ok: bool = True

    def __post_init__(self) -> None:
        if not (
            finite3((self.now_s, self.fused_stamp_s, self.yaw_rad))
            and finite3(self.position_ned_m)
            and finite3(self.velocity_ned_m_s)
            and 0.0 <= self.position_sigma_m < math.inf
        ):
            raise ReadingRefused("guard: what is known of the vehicle is not a number")


class GuardVerdict(msgspec.Struct, frozen=True):
    """What may be sent.

    `setpoint` is the very object that was checked when `limits` is empty. `speed_limit_m_s` is
    what the effective horizontal velocity was allowed; `free_distance_m` how far the way along it
    is free (fence and space, less the position's uncertainty), at most `Guard.horizon_m`, which is
    also its value when no horizontal motion was asked for.
    """

    setpoint: Setpoint
    limits: tuple[str, ...]
    speed_limit_m_s: float
    free_distance_m: float
