"""The last check before the wire: no setpoint may ask for more than the vehicle can stop from.

The guard knows nothing of missions or plans. It sees where the vehicle is, what its beams read and
what was seen to be free, and makes a setpoint slower, shorter or a hold; it never turns a setpoint
into another direction except by taking a part of it away. It adds motion of its own in
two cases only: back to where a hold began, and up or down to the height at which a surface below
or above is `beam_stop_m` away again. There "stay here" would give way to every error of the
estimate, and always towards the surface.

What PX4 will fly is the *effective velocity* `v = velocity + position_gain * (position - where the
vehicle is)`, so that is what is limited: velocity and position offset are scaled together.
README.md tells what is limited, by how much, and what supports the numbers.
"""

from hal.vehicle.guard.guard import DRIFT_M_S, HOLD_REACH_M, Guard
from hal.vehicle.guard.limits import (
    ACCELERATION,
    ALTITUDE,
    BEAM,
    BRAKE,
    CEILING,
    CLIMB,
    FENCE,
    FREE_SPACE,
    GROUND,
    LEASH,
    POSITION_STALE,
    SETPOINT_REPEATED,
    SETPOINT_STALE,
    SPEED,
    WORDS,
    YAW_RATE,
)
from hal.vehicle.guard.room import ESCAPE_COSINE, ESCAPE_SPEED_M_S, ESCAPE_STEPS_M
from hal.vehicle.guard.sight import BeamSight, GuardVerdict, Sight
from hal.vehicle.guard.stopping import (
    allowed_speed_m_s,
    needed_distance_m,
    stopping_distance_m,
    stopping_speed_m_s,
)
from hal.vehicle.guard.vertical import HEIGHT_GAIN_PER_S, RETREAT_M_S

__all__ = [
    "ACCELERATION",
    "ALTITUDE",
    "BEAM",
    "BRAKE",
    "CEILING",
    "CLIMB",
    "DRIFT_M_S",
    "ESCAPE_COSINE",
    "ESCAPE_SPEED_M_S",
    "ESCAPE_STEPS_M",
    "FENCE",
    "FREE_SPACE",
    "GROUND",
    "HEIGHT_GAIN_PER_S",
    "HOLD_REACH_M",
    "LEASH",
    "POSITION_STALE",
    "RETREAT_M_S",
    "SETPOINT_REPEATED",
    "SETPOINT_STALE",
    "SPEED",
    "WORDS",
    "YAW_RATE",
    "BeamSight",
    "Guard",
    "GuardVerdict",
    "Sight",
    "allowed_speed_m_s",
    "needed_distance_m",
    "stopping_distance_m",
    "stopping_speed_m_s",
]
