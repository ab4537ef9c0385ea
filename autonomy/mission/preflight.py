"""What must be true on the ground before the motors may turn. Pure.

Each finding is one sentence that says what is wrong and what to do about it.
"""

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.model import FusedState
from hal.frames import Vector3, finite3
from hal.readings import LandedState, VehicleFacts, VehicleStatus

# PX4's COM_OBL_RC_ACT: what it does when the offboard stream ends and no RC is there. The default
# (0) is a return that climbs first: measured +4.3 m, fatal under a ceiling.
_LAND, _HOLD = 4, 5

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


def parameter_findings(parameters: dict[str, float]) -> tuple[str, ...]:
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
    if timeout_s is not None and timeout_s > 2.0:
        findings.append(
            f"COM_OF_LOSS_T is {timeout_s:g} s: PX4 would fly on blindly for that long; set it to 1"
        )
    return tuple(findings)


def findings(
    config: Config,
    facts: VehicleFacts | None,
    status: VehicleStatus,
    fused: FusedState,
    silent_beams: tuple[str, ...],
) -> tuple[str, ...]:
    """Everything that forbids arming now; empty when the vehicle is ready."""
    found: list[str] = []
    if facts is not None:
        found.extend(parameter_findings(facts.parameters))
    if status.link_age_s > config.vehicle.link_timeout_s:
        found.append(f"the vehicle has been silent for {status.link_age_s:.1f} s; check the link")
    if status.landed not in (LandedState.ON_GROUND, LandedState.UNKNOWN):
        found.append("the vehicle is already in the air; land it before starting a mission")
    elif status.armed:
        found.append("the vehicle is already armed; disarm it before starting a mission")
    if not status.armable:
        because = status.not_armable_because or "its health report says not ready"
        found.append(f"the vehicle is not ready to arm: {because}")
    if status.battery_remaining is not None and (
        status.battery_remaining <= config.failsafe.battery_warn
    ):
        found.append(
            f"the battery is at {status.battery_remaining:.0%}; charge it above "
            f"{config.failsafe.battery_warn:.0%}"
        )
    if not fused.ok:
        found.append(f"there is no usable position: {fused.why_not_ok}")
    if silent_beams:
        found.append(
            f"no reading from the range beams {', '.join(silent_beams)}; check sensors and wiring"
        )
    return tuple(found)
