"""What sensors and the autopilot say, as immutable records that refuse what is not a measurement.

Every reading has a `stamp_s`: the monotonic time at which the quantity was true, as well as its
driver knows it. Records are `msgspec` structs, so that the flight log stores and restores them
bit for bit.
"""

import math
from enum import StrEnum

import msgspec

from hal.errors import ReadingRefused
from hal.frames import Vector3

FARTHEST_M, FASTEST_M_S = 1e5, 1e3
"""No small multicopter is farther from where it was switched on, or faster: who says so, errs."""
_TURNS_RAD = 20.0
_SPINS_RAD_S = 1e3


class RangeStatus(StrEnum):
    """How far a range reading can be believed; unknown is never written as zero."""

    VALID = "valid"
    TOO_NEAR = "too_near"  # something is nearer than the sensor can measure
    OUT_OF_RANGE = "out_of_range"  # measured, and nothing within the maximum range
    NO_SIGNAL = "no_signal"  # the sensor could not measure: says nothing about space
    SUSPECT = "suspect"  # measured, but a detector does not believe it


class RangeReading(msgspec.Struct, frozen=True):
    """One measurement of one beam.

    `range_m` is the distance from the sensor's face; it is meaningful for VALID and SUSPECT, is
    the minimum range for TOO_NEAR, the maximum range for OUT_OF_RANGE and 0.0 for NO_SIGNAL.
    """

    stamp_s: float
    beam: str
    status: RangeStatus
    range_m: float
    variance_m2: float
    min_m: float
    max_m: float

    def __post_init__(self) -> None:
        # Six of them come with every tick: words are made only for what is wrong. Comparisons
        # with a NaN are false, so these refuse it, too.
        if not (
            -math.inf < self.stamp_s < math.inf
            and 0.0 <= self.min_m < self.max_m < math.inf
            and 0.0 <= self.range_m < math.inf
            and 0.0 <= self.variance_m2 < math.inf
        ):
            raise ReadingRefused(f"beam {self.beam}: {self._what_is_wrong()}")

    def _what_is_wrong(self) -> str:
        if not math.isfinite(self.stamp_s):
            return "the stamp is not a number"
        if not 0.0 <= self.min_m < self.max_m < math.inf:
            return f"the limits {self.min_m}..{self.max_m} m are not a range"
        if not 0.0 <= self.range_m < math.inf:
            return f"{self.range_m} m is not a distance"
        return f"{self.variance_m2} m2 is not a variance"


class FixType(StrEnum):
    """GNSS solution, in MAVLink's order."""

    NO_GPS = "no_gps"
    NO_FIX = "no_fix"
    FIX_2D = "fix_2d"
    FIX_3D = "fix_3d"
    DGPS = "dgps"
    RTK_FLOAT = "rtk_float"
    RTK_FIXED = "rtk_fixed"

    @property
    def has_position(self) -> bool:
        """True for a solution with a usable three-dimensional position."""
        return self not in (FixType.NO_GPS, FixType.NO_FIX, FixType.FIX_2D)


class GnssFix(msgspec.Struct, frozen=True):
    """One GNSS solution: geodetic degrees, metres above mean sea level, one-sigma accuracies."""

    stamp_s: float
    fix_type: FixType
    latitude_deg: float
    longitude_deg: float
    amsl_m: float
    horizontal_accuracy_m: float
    vertical_accuracy_m: float
    satellites: int

    def __post_init__(self) -> None:
        if not math.isfinite(self.stamp_s):
            raise ReadingRefused("GNSS: the stamp is not a number")
        if not (abs(self.latitude_deg) <= 90.0 and abs(self.longitude_deg) <= 180.0):
            place = f"{self.latitude_deg}, {self.longitude_deg} deg"
            raise ReadingRefused(f"GNSS: {place} is not on Earth")
        if not math.isfinite(self.amsl_m):
            raise ReadingRefused("GNSS: the altitude is not a number")
        if not (
            0.0 < self.horizontal_accuracy_m < math.inf
            and 0.0 < self.vertical_accuracy_m < math.inf
        ):
            raise ReadingRefused("GNSS: a fix needs finite, positive accuracies")


class LocalPosition(msgspec.Struct, frozen=True):
    """The autopilot's own estimate of position and velocity in its local NED frame.

    `reset_counter` changes when the estimator jumped (EKF reset): everything that was placed in
    the frame before has moved with respect to it. Where `resets_told` is False nobody tells it, and
    jumps go unseen.
    """

    stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    reset_counter: int = 0
    resets_told: bool = True

    def __post_init__(self) -> None:
        (n, e, d), (vn, ve, vd) = self.position_ned_m, self.velocity_ned_m_s
        if not (
            -math.inf < self.stamp_s < math.inf
            and -FARTHEST_M <= n <= FARTHEST_M
            and -FARTHEST_M <= e <= FARTHEST_M
            and -FARTHEST_M <= d <= FARTHEST_M
            and -FASTEST_M_S <= vn <= FASTEST_M_S
            and -FASTEST_M_S <= ve <= FASTEST_M_S
            and -FASTEST_M_S <= vd <= FASTEST_M_S
        ):
            numbers = (self.stamp_s, n, e, d, vn, ve, vd)
            raise ReadingRefused(
                "local position: no multicopter is there, or that fast"
                if all(map(math.isfinite, numbers))
                else "local position: a component is not a number"
            )


class Attitude(msgspec.Struct, frozen=True):
    """Attitude as Z-Y-X Euler angles NED -> FRD, and the yaw rate about down."""

    stamp_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rad_s: float

    def __post_init__(self) -> None:
        finite = math.isfinite
        if not (
            finite(self.stamp_s)
            and finite(self.roll_rad)
            and finite(self.pitch_rad)
            and finite(self.yaw_rad)
            and finite(self.yaw_rate_rad_s)
        ):
            raise ReadingRefused("attitude: a component is not a number")
        if not (
            -_TURNS_RAD <= self.roll_rad <= _TURNS_RAD
            and -_TURNS_RAD <= self.pitch_rad <= _TURNS_RAD
            and -_TURNS_RAD <= self.yaw_rad <= _TURNS_RAD
            and -_SPINS_RAD_S <= self.yaw_rate_rad_s <= _SPINS_RAD_S
        ):
            raise ReadingRefused(
                "attitude: an angle of many turns, or a spin that nothing survives"
            )


class FlightMode(StrEnum):
    """PX4's navigation states, as far as this project tells them apart."""

    UNKNOWN = "unknown"
    MANUAL = "manual"  # every mode in which a pilot holds the sticks
    TAKEOFF = "takeoff"
    HOLD = "hold"
    MISSION = "mission"
    RETURN = "return"
    LAND = "land"
    DESCEND = "descend"  # PX4's own landing without a position
    OFFBOARD = "offboard"


class LandedState(StrEnum):
    """EXTENDED_SYS_STATE.landed_state."""

    UNKNOWN = "unknown"
    ON_GROUND = "on_ground"
    TAKEOFF = "takeoff"
    IN_AIR = "in_air"
    LANDING = "landing"


class VehicleStatus(msgspec.Struct, frozen=True):
    """What the autopilot says of itself. `stamp_s` is the time of the newest message behind it.

    `link_age_s` is how long the link has been silent. `armable` is the vehicle's own health
    report; `not_armable_because` repeats its words. `battery_remaining` is 0..1 or None.
    `global_position` is False for a vehicle that knows its local position only: PX4 does not hold,
    nor return, without a global one.
    """

    stamp_s: float
    armed: bool
    mode: FlightMode
    landed: LandedState
    link_age_s: float
    armable: bool = True
    not_armable_because: str = ""
    battery_remaining: float | None = None
    in_failsafe: bool = False
    global_position: bool = True

    def against_offboard(self) -> str | None:
        """Why OFFBOARD may not be asked for, although PX4 would go there; None: nothing.

        PX4 accepts it disarmed (who arms next would see it take off), and from the mode that a
        pilot, or PX4 itself, has chosen since.
        """
        if not self.armed:
            return "the vehicle is not armed"
        if self.mode not in _OFFBOARD_FOLLOWS:
            return (
                f"the vehicle's mode is {self.mode.value} now, which is not for this program to end"
            )
        return None


_OFFBOARD_FOLLOWS = (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD)
"""What was asked for before, and what PX4 goes to by itself at the end of a take-off."""


class VehicleFacts(msgspec.Struct, frozen=True):
    """What does not change during a flight: who the autopilot is and how it is configured.

    `parameters` holds those asked for; a name that the vehicle does not know is absent.
    """

    autopilot: str
    version: str
    system_id: int
    parameters: dict[str, float]
    booted_s: float | None = None
    """When the autopilot started, on this computer's monotonic clock; None: not known."""


class StatusText(msgspec.Struct, frozen=True):
    """One line that the autopilot wrote for people; `severity` as in MAV_SEVERITY (0 worst)."""

    stamp_s: float
    severity: int
    text: str
