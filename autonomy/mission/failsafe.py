"""One table of faults and responses. Detectors say which faults are present; the machine only
knows responses. Pure.
"""

from enum import IntEnum, StrEnum

import msgspec

from autonomy.config import Config
from autonomy.model import Ending, FusedState
from hal.readings import VehicleStatus


class Fault(StrEnum):
    """What can be wrong in flight."""

    LINK_LOST = "link_lost"
    BATTERY_LOW = "battery_low"
    STATE_LOST = "state_lost"
    STATE_LOST_LONG = "state_lost_long"
    BEAM_SILENT = "beam_silent"
    BEAM_SILENT_LONG = "beam_silent_long"
    TIME_OVER = "time_over"


class Response(IntEnum):
    """What the machine does about it; the strongest present one wins."""

    HOLD = 1  # stop, hold; go on when the fault is gone
    LAND = 2  # land here; the mission is over


RESPONSES: dict[Fault, tuple[Response, Ending]] = {
    Fault.LINK_LOST: (Response.LAND, Ending.LINK_LOST),
    Fault.BATTERY_LOW: (Response.LAND, Ending.FAILSAFE),
    Fault.STATE_LOST: (Response.HOLD, Ending.FAILSAFE),
    Fault.STATE_LOST_LONG: (Response.LAND, Ending.FAILSAFE),
    Fault.BEAM_SILENT: (Response.HOLD, Ending.FAILSAFE),
    Fault.BEAM_SILENT_LONG: (Response.LAND, Ending.FAILSAFE),
    Fault.TIME_OVER: (Response.LAND, Ending.BUDGET),
}


class Found(msgspec.Struct, frozen=True):
    """A fault that is present, with the sentence that tells a person."""

    fault: Fault
    why: str

    @property
    def response(self) -> Response:
        """What the table says to do."""
        return RESPONSES[self.fault][0]

    @property
    def ending(self) -> Ending:
        """How the mission ends if this fault ends it."""
        return RESPONSES[self.fault][1]


def detect(
    config: Config,
    status: VehicleStatus,
    fused: FusedState,
    state_lost_s: float,
    silent_beams: dict[str, float],
    mission_s: float,
) -> tuple[Found, ...]:
    """The faults present now, strongest response first.

    `state_lost_s` is how long the fused state has not been ok; `silent_beams` maps each horizontal
    beam without a fresh reading to the age of its last one; `mission_s` is the time since arming.
    """
    limits = config.failsafe
    found: list[Found] = []
    if status.link_age_s > config.vehicle.link_timeout_s:
        found.append(
            Found(Fault.LINK_LOST, f"the vehicle has been silent for {status.link_age_s:.1f} s")
        )
    if status.battery_remaining is not None and status.battery_remaining <= limits.battery_land:
        found.append(Found(Fault.BATTERY_LOW, f"the battery is at {status.battery_remaining:.0%}"))
    if state_lost_s > limits.state_loss_land_s:
        found.append(
            Found(
                Fault.STATE_LOST_LONG,
                f"no usable position for {state_lost_s:.1f} s: {fused.why_not_ok}",
            )
        )
    elif not fused.ok:
        found.append(Found(Fault.STATE_LOST, f"no usable position: {fused.why_not_ok}"))
    if silent_beams:
        name, age_s = max(silent_beams.items(), key=lambda item: item[1])
        why = f"beam {name} has been silent for {age_s:.1f} s"
        if age_s > limits.sensor_loss_land_s:
            found.append(Found(Fault.BEAM_SILENT_LONG, why))
        elif age_s > limits.sensor_loss_hold_s:
            found.append(Found(Fault.BEAM_SILENT, why))
    if mission_s > config.mission.time_limit_s:
        found.append(
            Found(Fault.TIME_OVER, f"the time limit of {config.mission.time_limit_s:g} s is over")
        )
    return tuple(sorted(found, key=lambda item: -item.response))
