"""What must be true on the ground before the motors may turn. Pure.

Each finding is one sentence that says what is wrong and what to do about it.
"""

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.model import FusedState
from hal.frames import Vector3, finite3
from hal.readings import FlightMode, LandedState, VehicleFacts, VehicleStatus

# PX4's COM_OBL_RC_ACT: what it does when the offboard stream ends and no RC is there. The default
# (0) is a return that climbs first: measured +4.3 m, fatal under a ceiling.
_LAND, _HOLD = 4, 5
# COM_OF_LOSS_T, PX4's default: it flies on with the last velocity for as long.
_BLIND_MAX_S = 1.0
# NAV_DLL_ACT: disabled, Hold, Land. Return climbs, and the others cut the motors.
_LINK_ACTIONS = (0, 1, 3)
_GAIN_TOLERANCE_PER_S = 0.1

_GOAL_FENCE_MARGIN_M = 0.05


def check_route(config: Config, route: tuple[Vector3, ...]) -> None:
    """Raise BadInput for a goal that no flight may be started for.

    Goals are NED about the take-off point. The goal must be finite, inside the fence and inside
    the altitude band.
    """
    if not route:
        raise BadInput("there is no goal; give one with --goal x,y")
    for number, goal in enumerate(route, start=1):
        name = f"goal {number} ({goal[0]:g}, {goal[1]:g}, {goal[2]:g})"
        if not finite3(goal):
            raise BadInput(f"{name} has a coordinate that is not a number; give finite metres")
        inside_m = config.guard.fence.inside_distance_m(goal[0], goal[1])
        if inside_m < _GOAL_FENCE_MARGIN_M:
            place = (
                f"{-inside_m:.2f} m outside the geofence"
                if inside_m < 0
                else "on the geofence's edge"
            )
            raise BadInput(f"{name} is {place}; choose a goal inside it or change guard.fence")
        altitude_m = -goal[2]
        if not config.guard.altitude_min_m <= altitude_m <= config.guard.altitude_max_m:
            raise BadInput(
                f"{name} is {altitude_m:g} m high, outside the altitude band "
                f"{config.guard.altitude_min_m:g}..{config.guard.altitude_max_m:g} m; "
                "change the goal or guard.altitude_min_m / altitude_max_m"
            )


def parameter_findings(
    parameters: dict[str, float], position_gain_per_s: float = 0.95
) -> tuple[str, ...]:
    """What in PX4's parameters would make a flight of this service dangerous."""
    findings = []
    action = parameters.get("COM_OBL_RC_ACT")
    if action is None:
        findings.append(
            "the vehicle does not tell COM_OBL_RC_ACT (what it does when this program dies); "
            "check that it runs PX4 1.14 or newer"
        )
    elif int(action) not in (_LAND, _HOLD):
        findings.append(
            f"COM_OBL_RC_ACT is {int(action)}: when this program dies PX4 would not stop "
            "(0 climbs and returns); set it to 5 (Hold) or 4 (Land)"
        )
    timeout_s = parameters.get("COM_OF_LOSS_T")
    if timeout_s is not None and timeout_s > _BLIND_MAX_S:
        findings.append(
            f"COM_OF_LOSS_T is {timeout_s:g} s: PX4 would fly on blindly for that long; set it to 1"
        )
    link_action = parameters.get("NAV_DLL_ACT")
    if link_action is not None and int(link_action) not in _LINK_ACTIONS:
        findings.append(
            f"NAV_DLL_ACT is {int(link_action)}: this program is PX4's ground station, and when it "
            "dies PX4 would not just stop (2 climbs and returns); set it to 0, 1 (Hold) or 3 (Land)"
        )
    gain = parameters.get("MPC_XY_P")
    if gain is not None and abs(gain - position_gain_per_s) > _GAIN_TOLERANCE_PER_S:
        findings.append(
            f"MPC_XY_P is {gain:g}, but guard.position_gain_per_s is {position_gain_per_s:g}: the "
            "guard would limit another speed than PX4 flies; make them equal"
        )
    return tuple(findings)


def hold_keeps_down(status: VehicleStatus) -> bool:
    """True when PX4 does not arm for want of a global position, which Hold needs and Takeoff not.

    (PX4's mode_requirements.cpp: Hold, Return and Mission need a global position, Takeoff a local
    one; arming is checked against the mode that is selected.)
    """
    return (
        status.mode is FlightMode.HOLD
        and not status.armed
        and not status.armable
        and not status.global_position
    )


def findings(
    config: Config,
    facts: VehicleFacts | None,
    status: VehicleStatus,
    fused: FusedState,
    silent_beams: tuple[str, ...],
    room_above_m: float | None = None,
    covered_beams: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Everything that forbids arming now; empty when the vehicle is ready.

    `room_above_m`: what the beam that looks up measures from the ground, None for nothing in range;
    `covered_beams` see something that is on their lens.
    """
    found: list[str] = []
    if facts is not None:
        found.extend(parameter_findings(facts.parameters, config.guard.position_gain_per_s))
    if status.link_age_s > config.vehicle.link_timeout_s:
        found.append(f"the vehicle has been silent for {status.link_age_s:.1f} s; check the link")
    if status.landed not in (LandedState.ON_GROUND, LandedState.UNKNOWN):
        found.append(
            "the vehicle is already in the air and is not taken over; land it before starting a "
            "mission (a service that was killed in flight goes on by service.on_restart_in_flight)"
        )
    elif status.armed:
        found.append("the vehicle is already armed; disarm it before starting a mission")
    if not status.armable:
        because = status.not_armable_because or "its health report says not ready"
        found.append(f"the vehicle is not ready to arm: {because}{_about_position(status)}")
    if status.battery_remaining is not None and (
        status.battery_remaining <= config.failsafe.battery_warn
    ):
        found.append(
            f"the battery is at {status.battery_remaining:.0%}; charge it above "
            f"{config.failsafe.battery_warn:.0%}"
        )
    if not fused.ok:
        found.append(f"there is no usable position: {fused.why_not_ok}{_about_source(status)}")
    if silent_beams:
        found.append(
            f"no reading from the range beams {', '.join(silent_beams)}; check sensors and wiring"
        )
    if covered_beams:
        found.append(
            f"the range beams {', '.join(covered_beams)} see something inside the vehicle's own "
            "body; clean their lenses and take away what covers them"
        )
    needed_m = config.mission.altitude_m + config.guard.beam_stop_m
    if room_above_m is not None and room_above_m < needed_m:
        found.append(
            f"something is {room_above_m:.2f} m above the vehicle, {needed_m:.2f} m are needed; "
            "take off elsewhere or lower mission.altitude_m (--altitude)"
        )
    return tuple(found)


def _about_position(status: VehicleStatus) -> str:
    """What a missing global position has to do with arming."""
    if status.global_position or status.mode not in (FlightMode.HOLD, FlightMode.RETURN):
        return ""
    return (
        f"; it knows no global position, which its mode {status.mode.value} needs: give it one "
        "(GNSS, or the origin of its local position by SET_GPS_GLOBAL_ORIGIN)"
    )


def _about_source(status: VehicleStatus) -> str:
    """Where a local position could come from, for a vehicle that has no other either."""
    if status.global_position:
        return ""
    return (
        "; it has no global position either: give PX4 a source (GNSS, optical flow with a range "
        "sensor below, or motion capture or visual odometry with EKF2_EV_CTRL)"
    )
