"""PX4's mode logic as a deterministic state machine on its own time, around a simulated vehicle.

Which request is refused, what is said about it, when the motors really lift, what happens when
setpoints stop: all as measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11. There is no remote
control, as indoors with a companion computer.
"""

import math
from collections import Counter, deque
from typing import Protocol

import msgspec
import numpy as np

from hal.frames import (
    ZERO3,
    Vector3,
    add,
    geodetic_from_ned,
    ned_from_frd,
    norm,
    scale,
    wrap_pi,
)
from hal.sim import px4_events as events
from hal.sim.mission import Mission, velocity_to
from hal.sim.px4 import (
    AutopilotText,
    Landed,
    Mode,
    Parameters,
    Result,
    Severity,
    SystemStatus,
)
from hal.sim.px4_events import AutopilotEvent, EventKind
from hal.sim.px4_watch import Change, GnssWatch, HeartbeatWatch
from hal.sim.quadrotor import EXACT, FREE3, Command, Limits, Motors, Quadrotor
from hal.sim.sensors import EstimateOffset

# Measured intervals that are no parameters.
_DETECT_AFTER_SPOOL_UP_S = 0.83
_LIFT_OFF_AUTO_S = -0.1  # against the end of the thrust ramp, MPC_TKO_RAMP_T
_LIFT_OFF_OFFBOARD_S = -0.7
_LANDING_DETECTED_S = 1.8
_FREE_FALL_LANDED_S = 0.43
_OFFBOARD_LOSS_JITTER_S = (0.02, 0.12)
_COMPANION_LOSS_S = 4.5
_FIRST_HEARTBEAT_S = 1.4
_NO_GNSS = "Preflight: GPS fix too low"
# Measured vertical profiles: velocity per height still to go, its limit and slew.
_TAKEOFF_GAIN_PER_S, _TAKEOFF_MAX_M_S = 0.5, 0.77
_RETURN_CLIMB = 0.8  # m/s per root of the metres still to climb
_CLIMB_SLEW_M_S2 = 0.8
_RETURN_CLIMB_SLEW_M_S2 = 2.5
_DESCENT_SLEW_M_S2 = 1.5
_CRAWL_BELOW_M = 0.9
# Return: the height over home is this times the distance (measured twice), horizontally homing.
_RETURN_CONE = math.sqrt(3.0)
_RETURN_REACHED_M, _RETURN_LEVEL_M = 0.5, 0.1
_RETURN_CLIMB_S = 0.7  # at least, unless nothing is to be climbed
_HOMING_GAIN_PER_S, _HOMING_MAX_M_S = 0.45, 2.0

_NAMES = {
    Mode.MANUAL: "Manual",
    Mode.ALTITUDE: "Altitude",
    Mode.POSITION: "Position",
    Mode.ORBIT: "Orbit",
    Mode.ACRO: "Acro",
    Mode.STABILIZED: "Stabilized",
    Mode.OFFBOARD: "Offboard",
    Mode.MISSION: "Mission",
    Mode.HOLD: "Hold",
    Mode.RETURN: "Return",
}
# The modes of a multicopter that need a global position: PX4's mode_requirements.cpp. Take-off
# needs a local one; after it, PX4 stays in Takeoff where Hold cannot run.
_GLOBAL_MODES = frozenset({Mode.HOLD, Mode.RETURN, Mode.MISSION})
_NO_GLOBAL_POSITION = "Navigation error: No valid global position estimate"
_OBL_ACTIONS = {4: Mode.LAND, 5: Mode.HOLD}
_DLL_ACTIONS = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND, 5: Mode.TERMINATION}
_EVENT_ACTIONS = {
    Mode.HOLD: events.ACTION_HOLD,
    Mode.RETURN: events.ACTION_RETURN,
    Mode.LAND: events.ACTION_LAND,
    Mode.TERMINATION: events.ACTION_TERMINATE,
}


class _VehiclePart(Protocol):
    @property
    def drag_per_mass_s(self) -> float: ...
    @property
    def parameters(self) -> dict[str, float]: ...


class _ScenarioPart(Protocol):
    @property
    def vehicle(self) -> _VehiclePart: ...
    @property
    def start_yaw_deg(self) -> float: ...
    @property
    def gnss(self) -> "_OriginPart": ...


class _OriginPart(Protocol):
    @property
    def origin(self) -> Vector3: ...
    @property
    def present(self) -> bool: ...


class Braking(msgspec.Struct, frozen=True):
    """PX4's jerk-limited stop from a velocity: triangular deceleration within MPC_JERK_AUTO."""

    start_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    duration_s: float

    @classmethod
    def plan(
        cls, now_s: float, position_ned_m: Vector3, velocity_ned_m_s: Vector3, jerk_m_s3: float
    ) -> "Braking":
        """A stop that begins now: its deceleration rises and falls in 2 sqrt(speed / jerk)."""
        duration_s = 2.0 * math.sqrt(norm(velocity_ned_m_s) / max(jerk_m_s3, 0.1))
        return cls(now_s, position_ned_m, velocity_ned_m_s, duration_s)

    @property
    def end_ned_m(self) -> Vector3:
        """Where the stop ends."""
        return add(self.position_ned_m, scale(self.velocity_ned_m_s, 0.5 * self.duration_s))

    def at(self, now_s: float) -> tuple[Vector3, Vector3, Vector3]:
        """(position, velocity, acceleration) of the stop at `now_s`."""
        if self.duration_s <= 0.0 or now_s >= self.start_s + self.duration_s:
            return self.end_ned_m, ZERO3, ZERO3
        x = (now_s - self.start_s) / self.duration_s
        if x < 0.5:
            path, speed, slope = x - 2.0 * x**3 / 3.0, 1.0 - 2.0 * x * x, -4.0 * x
        else:
            y = 1.0 - x
            path, speed, slope = 0.5 - 2.0 * y**3 / 3.0, 2.0 * y * y, -4.0 * y
        v = self.velocity_ned_m_s
        return (
            add(self.position_ned_m, scale(v, path * self.duration_s)),
            scale(v, speed),
            scale(v, slope / self.duration_s),
        )


class Autopilot:
    """A PX4 multicopter without its wires. Requests answer with MAV_RESULT at once.

    Of the scenario only `vehicle`, `start_yaw_deg` and the GNSS origin are read, and whether there
    is a receiver. It becomes armable `boot_s` seconds after it starts (PX4 in simulation: 4.2 s).
    """

    def __init__(
        self, scenario: _ScenarioPart, rng: np.random.Generator, *, boot_s: float = 0.0
    ) -> None:
        self.parameters = Parameters()
        for name, value in scenario.vehicle.parameters.items():
            self.parameters.set(name, value)
        self.quadrotor = Quadrotor(
            drag_per_mass_s=scenario.vehicle.drag_per_mass_s,
            yaw_rad=wrap_pi(math.radians(scenario.start_yaw_deg)),
        )
        self.origin: Vector3 = scenario.gnss.origin
        self.texts: deque[AutopilotText] = deque(maxlen=256)
        self.events: deque[AutopilotEvent] = deque(maxlen=256)
        self.event_sequence = 0
        self.home_set_s = 0.0
        """When home was set last."""
        self.flights = 0
        """How often it has been armed."""
        self.flown_command = Command()
        """What the position controller was asked for last."""
        self.ground_station = HeartbeatWatch()
        self.companion = HeartbeatWatch()
        self.gnss_fix = True
        """False while its receiver has no fix."""
        self._has_gnss = scenario.gnss.present
        self._gnss = GnssWatch()
        self._offboard_lost = False
        self._station_action: Mode | None = None
        self._station_action_s = math.inf
        self._said_reason = ""
        self._warned_mode: Mode | None = None
        self.battery_override: float | None = None
        self.mission = Mission()
        self._scenario = scenario
        self._booted_s = 0.0
        self._silent_until_s = -math.inf
        self._boot_shift_ned_m: Vector3 = ZERO3
        self._refusals: dict[str, tuple[str, ...]] = {}
        self._refused: Counter[str] = Counter()
        self._rng = rng
        self._boot_s = boot_s
        self._fault = ""
        self._now_s = 0.0
        self._error = EXACT
        self._intended = Mode.HOLD
        self._before_landing = Mode.HOLD
        self._failsafe: Mode | None = None
        self._entered: Mode | None = None
        self._armed = False
        self._armed_s = 0.0
        self._landed = True
        self._airborne = False
        self._kill_s: float | None = None
        self._ramp_s: float | None = None
        self._landed_s: float | None = None
        self._touch_s: float | None = None
        self._flown = False
        self._setpoint = Command()
        self._setpoint_s = -math.inf
        self._loss_jitter_s = 0.0
        self._home_ned_m: Vector3 = ZERO3
        self._braking = Braking(0.0, ZERO3, ZERO3, 0.0)
        self._hold_yaw_rad = self.quadrotor.yaw_rad
        self._climb_to_m: float | None = None
        self._vertical_sp_m_s = 0.0
        self._return_height_m = 0.0
        self._return_phase = "climb"
        self._return_s = 0.0
        self._mission_lands = False
        self._battery = 1.0
        self._apply_limits()

    # ------------------------------------------------------------ what it is

    @property
    def now_s(self) -> float:
        """Seconds since it started (PX4's boot time)."""
        return self._now_s

    @property
    def uptime_s(self) -> float:
        """Seconds since it was started last: what its clock shows on the wire."""
        return self.on_its_clock_s(self._now_s)

    def on_its_clock_s(self, at_s: float) -> float:
        """A time as the wire tells it, counted from the last start."""
        return at_s - self._booted_s

    @property
    def silent(self) -> bool:
        """True while it starts anew and says nothing."""
        return self._now_s < self._silent_until_s

    @property
    def armed(self) -> bool:
        """True while the motors may turn."""
        return self._armed

    @property
    def airborne(self) -> bool:
        """True while its thrust carries it."""
        return self._airborne

    @property
    def mode(self) -> Mode:
        """The mode that is flown: the failsafe's, else the one that was asked for."""
        return self._failsafe or self._intended

    @property
    def intended_mode(self) -> Mode:
        """The mode that was asked for."""
        return self._intended

    @property
    def in_failsafe(self) -> bool:
        """True while a failsafe flies the vehicle."""
        return self._failsafe is not None

    @property
    def landed(self) -> Landed:
        """PX4's own belief, which is later than the truth by up to two seconds."""
        if self._landed:
            return Landed.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return Landed.TAKEOFF
        coming_down = self._return_phase == "land" if self.mode is Mode.RETURN else False
        if self.mode is Mode.MISSION:
            coming_down = self._mission_lands
        if self.mode is Mode.LAND or (coming_down and self._entered is self.mode):
            return Landed.LANDING
        return Landed.IN_AIR

    @property
    def global_position(self) -> bool:
        """True while it knows where on Earth it is; the local position may be good without."""
        return self._has_gnss and self._gnss.position_valid

    @property
    def not_armable_because(self) -> str:
        """Why arming would be refused; empty when it would not."""
        if self._now_s < self._boot_s:
            return "Preflight Fail: no heading reference"
        if self._fault:
            return self._fault
        if not self._gnss.position_valid:
            return _NO_GNSS
        if self.ground_station.lost and int(self.parameters["NAV_DLL_ACT"]) > 0:
            return "Preflight Fail: No connection to the GCS"
        if self._intended.needs_pilot:
            return "Mode needs a remote control"
        if self._intended is Mode.OFFBOARD and not self._setpoint_fresh():
            return "No offboard signal"
        if self._intended in _GLOBAL_MODES and not self.global_position:
            return _NO_GLOBAL_POSITION
        return ""

    @property
    def system_status(self) -> SystemStatus:
        """As in the heartbeat."""
        if self.mode is Mode.TERMINATION:
            return SystemStatus.FLIGHT_TERMINATION
        if self._armed:
            return SystemStatus.CRITICAL if self.in_failsafe else SystemStatus.ACTIVE
        return SystemStatus.UNINIT if self.not_armable_because else SystemStatus.STANDBY

    @property
    def base_mode(self) -> int:
        """As in the heartbeat."""
        return self.mode.base_mode + (128 if self._armed else 0)

    @property
    def battery_remaining(self) -> float:
        """0..1. PX4's simulated battery: down to a half in 30 s of arming, full when disarmed."""
        return self._battery if self.battery_override is None else self.battery_override

    @property
    def home_ned_m(self) -> Vector3:
        """Where it was armed last, in its own estimate."""
        return self._home_ned_m

    @property
    def estimate_offset(self) -> EstimateOffset:
        """Estimate minus truth at the last step."""
        return self._error

    @property
    def estimated_position_ned_m(self) -> Vector3:
        """What it believes."""
        return add(self.quadrotor.position_ned_m, self._error.position_ned_m)

    @property
    def estimated_velocity_ned_m_s(self) -> Vector3:
        """What it believes."""
        return add(self.quadrotor.velocity_ned_m_s, self._error.velocity_ned_m_s)

    @property
    def estimated_yaw_rad(self) -> float:
        """What it believes."""
        return wrap_pi(self.quadrotor.yaw_rad + self._error.yaw_rad)

    # ------------------------------------------------------------ requests

    def arm(self) -> Result:
        """MAV_CMD_COMPONENT_ARM_DISARM with 1."""
        if self._armed:
            return Result.ACCEPTED
        if self._refusals.get("arm"):
            return self._refuse("arm")
        reason = self.not_armable_because
        if reason:
            self._say_why_not(reason)
            self.say(
                Severity.CRITICAL,
                "Arming denied: Resolve system health failures first",
                events.ARMING_DENIED,
            )
            return Result.TEMPORARILY_REJECTED
        self._armed = True
        self._armed_s = self._now_s
        self.flights += 1
        self._home_ned_m = self.estimated_position_ned_m
        self.home_set_s = self._now_s
        self._airborne = self._flown = False
        self._ramp_s = self._landed_s = self._touch_s = None
        self._entered = None
        self.say(
            Severity.INFO, "Armed by external command", events.ARMED_BY, events.COMMAND_EXTERNAL
        )
        return Result.ACCEPTED

    def report_health(self) -> Result:
        """MAV_CMD_RUN_PREARM_CHECKS: say anew what stands against arming."""
        self._said_reason = ""
        reason = self.not_armable_because
        if reason and not self._armed:
            self._say_why_not(reason)
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """MAV_CMD_COMPONENT_ARM_DISARM with 0; `force` cuts the motors in the air as well."""
        if not self._armed:
            return Result.ACCEPTED
        if not self._landed and not force:
            self.say(Severity.CRITICAL, "Disarming denied: not landed", events.DISARMING_DENIED)
            return Result.TEMPORARILY_REJECTED
        self._disarm("Disarmed by external command", events.COMMAND_EXTERNAL)
        return Result.ACCEPTED

    def takeoff(self, altitude_amsl_m: float | None = None) -> Result:
        """MAV_CMD_NAV_TAKEOFF; None (NaN on the wire) climbs MIS_TAKEOFF_ALT above home."""
        height_m = float(self.parameters["MIS_TAKEOFF_ALT"])
        base_ned_m = self._home_ned_m if self._armed else self.estimated_position_ned_m
        target_m = base_ned_m[2] - height_m
        if altitude_amsl_m is not None and math.isfinite(altitude_amsl_m):
            target_m = self.origin[2] - altitude_amsl_m
        elif self._armed:
            self.say(
                Severity.INFO,
                f"Using default takeoff altitude: {height_m:.1f} m",
                events.TAKEOFF_ALTITUDE,
                height_m,
            )
        self._command(Mode.TAKEOFF)
        self._climb_to_m = min(target_m, self.estimated_position_ned_m[2])
        return Result.ACCEPTED

    def land(self) -> Result:
        """MAV_CMD_NAV_LAND."""
        self.say(Severity.INFO, "Landing at current position", events.LANDING_HERE)
        self._command(Mode.LAND)
        return Result.ACCEPTED

    def return_to_launch(self) -> Result:
        """MAV_CMD_NAV_RETURN_TO_LAUNCH."""
        self.say(Severity.INFO, "Returning to launch", events.RETURNING)
        self._command(Mode.RETURN)
        return Result.ACCEPTED

    def hold_at(self, position_ned_m: Vector3) -> Result:
        """MAV_CMD_DO_REPOSITION: hold there; NaN components stay as they are."""
        here = self.estimated_position_ned_m
        n, e, d = (h if math.isnan(p) else p for p, h in zip(position_ned_m, here, strict=True))
        self._command(Mode.HOLD)
        if self._armed:
            self._enter(Mode.HOLD)
            self._braking = Braking(self._now_s, (n, e, d), ZERO3, 0.0)
        return Result.ACCEPTED

    def start_mission(self, first: int = 0) -> Result:
        """MAV_CMD_MISSION_START: arm if need be and fly the mission from item `first` on."""
        if not self.mission.items or not self.mission.set_current(first):
            self.say(
                Severity.CRITICAL, "Mission start denied! No valid mission", events.MISSION_DENIED
            )
            return Result.DENIED
        result = self.arm()
        if result is Result.ACCEPTED:
            self._command(Mode.MISSION)
        return result

    def set_mode(self, main: int, sub: int = 0) -> Result:
        """MAV_CMD_DO_SET_MODE. Disarmed every mode is taken; armed only one that can be flown."""
        try:
            mode = Mode(sub << 24 | main << 16)
        except ValueError:
            self.say(Severity.CRITICAL, "Unsupported main mode")
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.OFFBOARD and self._refusals.get("offboard"):
            return self._refuse("offboard")
        if self._armed and not self._available(mode):
            self.say(
                Severity.CRITICAL,
                f"Switching to {_NAMES[mode]} is currently not available",
                events.MODE_NOT_AVAILABLE,
                int(mode),
                mode.main,
            )
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.TAKEOFF and self._climb_to_m is None:
            self._climb_to_m = self._home_ned_m[2] - float(self.parameters["MIS_TAKEOFF_ALT"])
        self._command(mode)
        return Result.ACCEPTED

    def set_setpoint(
        self,
        position_ned_m: Vector3 = FREE3,
        velocity_ned_m_s: Vector3 = FREE3,
        yaw_rad: float = math.nan,
        yaw_rate_rad_s: float = math.nan,
    ) -> None:
        """One offboard setpoint in local NED, valid from now on; NaN leaves a component free."""
        self._setpoint = Command(position_ned_m, velocity_ned_m_s, yaw_rad, yaw_rate_rad_s)
        self._setpoint_s = self._now_s

    def set_body_setpoint(
        self, velocity_frd_m_s: Vector3, yaw_rad: float, yaw_rate_rad_s: float
    ) -> None:
        """One offboard velocity in the body frame, turned by yaw alone as PX4 does."""
        velocity = ned_from_frd(velocity_frd_m_s, self.estimated_yaw_rad)
        self.set_setpoint(FREE3, velocity, yaw_rad, yaw_rate_rad_s)

    def set_parameter(self, name: str, value: float) -> Result:
        """Set a parameter without range check; DENIED for an unknown name."""
        if not self.parameters.set(name, value):
            return Result.DENIED
        self._apply_limits()
        return Result.ACCEPTED

    # ------------------------------------------------------------ faults

    def refuse(self, what: str, texts: tuple[str, ...]) -> None:
        """Refuse "arm" or "offboard" with these texts from now on; with none, no longer."""
        self._refusals[what] = texts

    def take_refused(self, what: str) -> int:
        """How often that was refused since it was last asked."""
        return self._refused.pop(what, 0)

    def _refuse(self, what: str) -> Result:
        self._refused[what] += 1
        for text in self._refusals[what]:
            self.say(Severity.WARNING if text.startswith("Preflight") else Severity.CRITICAL, text)
        return Result.TEMPORARILY_REJECTED

    def take_over(self, mode: Mode) -> None:
        """A pilot's switch: the mode is flown whether or not a command could have asked for it."""
        self._command(mode)

    def fail_safe(self, mode: Mode) -> None:
        """A failsafe of its own takes over; only another mode ends it."""
        if self._armed:
            self._failsafe, self._offboard_lost = mode, False
            self._announce_failsafe(mode)

    def shift_estimate(self, by_ned_m: Vector3, by_yaw_rad: float = 0.0) -> None:
        """The estimator's frame jumped: what it holds and returns to moves along, as in PX4."""
        north, east, down = by_ned_m
        b = self._braking
        self._braking = msgspec.structs.replace(b, position_ned_m=add(b.position_ned_m, by_ned_m))
        self._home_ned_m = add(self._home_ned_m, (north, east, down))
        self._hold_yaw_rad = wrap_pi(self._hold_yaw_rad + by_yaw_rad)
        if self._climb_to_m is not None:
            self._climb_to_m += down

    def reboot(self, boot_s: float) -> None:
        """Start anew: motors off, silent at first, armable after `boot_s`, a frame from here.

        Parameters and the mission are kept.
        """
        fresh = Autopilot(self._scenario, self._rng)
        lasting = ("parameters", "mission", "quadrotor", "texts", "events", "_now_s", "_rng")
        for name, value in vars(fresh).items():
            if name not in lasting:
                setattr(self, name, value)
        north, east, down = self.quadrotor.position_ned_m
        self.origin = geodetic_from_ned((north, east, down), fresh.origin)
        self._boot_shift_ned_m = (-north, -east, -down)
        self._booted_s = self._now_s
        self._silent_until_s = self._now_s + _FIRST_HEARTBEAT_S
        self._boot_s = self._now_s + boot_s
        self._apply_limits()

    def set_fault(self, reason: str) -> None:
        """Make arming impossible for `reason` (PX4's words), or possible again with ''."""
        self._fault = reason

    # ------------------------------------------------------------ time

    def step(self, dt_s: float, error: EstimateOffset = EXACT) -> None:
        """Let `dt_s` seconds pass while the estimate is off by `error`."""
        self._now_s += dt_s
        if self._booted_s > 0.0:
            moved = add(error.position_ned_m, self._boot_shift_ned_m)
            error = msgspec.structs.replace(error, position_ned_m=moved)
        self._error = error
        self._drain_battery(dt_s)
        self._watch()
        if not self._armed:
            self._fall_or_rest(dt_s)
            return
        self._check_offboard()
        self._check_station_failsafe()
        if self.mode is Mode.TERMINATION:
            self._airborne = False
            self.quadrotor.step(dt_s, Command(), Motors.STOPPED, self._error)
            return
        if self._entered is not self.mode:
            self._enter(self.mode)
        command = self.flown_command = self._fly(dt_s)
        self._lift_off(command)
        self.quadrotor.step(dt_s, command, Motors.FLYING if self._airborne else Motors.IDLE, error)
        self._detect_landing(command)
        self._auto_disarm()

    def _fall_or_rest(self, dt_s: float) -> None:
        self.quadrotor.step(dt_s, Command(), Motors.STOPPED, self._error)
        since = self._kill_s
        if since is not None and (
            self.quadrotor.on_ground or self._now_s - since > _FREE_FALL_LANDED_S
        ):
            self._landed = True

    def _drain_battery(self, dt_s: float) -> None:
        if not self._armed:
            self._battery = 1.0
            return
        least = 0.01 * float(self.parameters["SIM_BAT_MIN_PCT"])
        drain_s = max(float(self.parameters["SIM_BAT_DRAIN"]), 1.0)
        self._battery = max(min(least, self._battery), self._battery - dt_s / drain_s)

    # ------------------------------------------------------------ modes

    def _command(self, mode: Mode) -> None:
        if mode in (Mode.LAND, Mode.RETURN) and self._intended not in (Mode.LAND, Mode.RETURN):
            self._before_landing = self._intended
        if mode is not Mode.TAKEOFF:
            self._climb_to_m = None
        self._intended = mode
        self._failsafe = None
        self._entered = None
        self._loss_jitter_s = float(self._rng.uniform(*_OFFBOARD_LOSS_JITTER_S))

    def _available(self, mode: Mode) -> bool:
        if mode in _GLOBAL_MODES and not self.global_position:
            return False
        if mode is Mode.OFFBOARD:
            return self._setpoint_fresh()
        if mode is Mode.MISSION:
            return bool(self.mission.items)
        return not mode.needs_pilot

    def _setpoint_fresh(self, extra_s: float = 0.0) -> bool:
        limit_s = float(self.parameters["COM_OF_LOSS_T"]) + extra_s
        return self._now_s - self._setpoint_s <= limit_s

    def _check_offboard(self) -> None:
        if self._intended is not Mode.OFFBOARD or self._landed:
            return
        if self._failsafe is not None:
            if self._offboard_lost and self._setpoint_fresh():
                self._failsafe = None
            return
        if self._setpoint_fresh(self._loss_jitter_s):
            return
        self._loss_jitter_s = float(self._rng.uniform(*_OFFBOARD_LOSS_JITTER_S))
        # Without a remote control every fallback to a piloted mode ends in a return.
        action = _OBL_ACTIONS.get(int(self.parameters["COM_OBL_RC_ACT"]), Mode.RETURN)
        # Hold falls through to Return, and Return to Land, where they cannot run (PX4's source).
        self._failsafe = action if self._available(action) else Mode.LAND
        self._offboard_lost = True
        self._announce_failsafe(self._failsafe)

    def _announce_failsafe(self, mode: Mode) -> None:
        self.say(
            Severity.CRITICAL,
            "Failsafe activated",
            events.FAILSAFE,
            int(Mode.TERMINATION if mode is Mode.TERMINATION else self._intended),
            _EVENT_ACTIONS[mode],
        )

    def terminate(self) -> Result:
        """MAV_CMD_DO_FLIGHTTERMINATION: motors off for good."""
        self._intended = self._failsafe = Mode.TERMINATION
        self._announce_failsafe(Mode.TERMINATION)
        return Result.ACCEPTED

    # ------------------------------------------------------------ watches

    def _watch(self) -> None:
        """Notice who came and went on the link, and whether the position is good."""
        now_s, p = self._now_s, self.parameters
        station = self.ground_station.step(now_s, float(p["COM_DL_LOSS_T"]))
        if station is Change.LOST:
            self.say(Severity.INFO, "Connection to ground station lost", events.STATION_LOST)
            self._plan_station_failsafe()
        elif station is Change.BACK:
            self.say(Severity.INFO, "GCS connection regained", events.STATION_BACK)
            self._station_action = None
        companion = self.companion.step(now_s, _COMPANION_LOSS_S)
        if companion is Change.LOST:
            self.say(
                Severity.CRITICAL, "Connection to mission computer lost", events.COMPANION_LOST
            )
        elif companion is Change.BACK:
            self.say(Severity.INFO, "Onboard controller regained", events.COMPANION_BACK)
        complains, position = self._gnss.step(now_s, fix=self.gnss_fix)
        if complains:
            self.say(Severity.WARNING, _NO_GNSS)
            self._said_reason = _NO_GNSS
        if position is Change.LOST and not self._armed:
            self.report(events.FAILSAFE_WARNING, int(self._intended))
        self._warn_without_setpoints()

    def _warn_without_setpoints(self) -> None:
        """OFFBOARD selected on the ground without setpoints is worth a warning, once."""
        without = not self._armed and self._intended is Mode.OFFBOARD and not self._setpoint_fresh()
        if without and self._warned_mode is not self._intended:
            self.report(events.FAILSAFE_WARNING, int(self._intended))
        self._warned_mode = self._intended if without else None

    def _say_why_not(self, reason: str) -> None:
        """PX4's words on what stands against arming, once for as long as it does."""
        if reason == _NO_GLOBAL_POSITION:
            self.report(events.NO_GLOBAL_POSITION, events.GLOBAL_MODES, 0)
        if reason.startswith("Preflight") and reason != self._said_reason:
            heading = reason.endswith("no heading reference")
            self.say(Severity.CRITICAL if heading else Severity.WARNING, reason)
        self._said_reason = reason

    def _plan_station_failsafe(self) -> None:
        action = _DLL_ACTIONS.get(int(self.parameters["NAV_DLL_ACT"]))
        if action is None or not self._armed or self._failsafe is not None:
            return
        delay_s = float(self.parameters["COM_FAIL_ACT_T"])
        self._station_action, self._station_action_s = action, self._now_s + delay_s
        self._failsafe, self._offboard_lost = Mode.HOLD, False
        self.say(
            Severity.CRITICAL,
            f"Failsafe activated: entering Hold for {delay_s:.0f} seconds",
            events.FAILSAFE_HOLDS,
            int(self._intended),
            _EVENT_ACTIONS[action],
            round(delay_s),
            events.CAUSE_GROUND_STATION_LOST,
        )

    def _check_station_failsafe(self) -> None:
        action = self._station_action
        if action is None or self._now_s < self._station_action_s:
            return
        self._station_action = None
        if self._failsafe is not Mode.HOLD:
            return
        self._failsafe = action
        self.say(
            Severity.CRITICAL,
            "Failsafe activated",
            events.FAILSAFE_OF,
            int(self._intended),
            _EVENT_ACTIONS[action],
            events.CAUSE_GROUND_STATION_LOST,
        )

    def _enter(self, mode: Mode) -> None:
        """Take over from the mode before: where to stop, how high to climb."""
        self._entered = mode
        self._stop_here()
        if mode is Mode.RETURN:
            self._plan_return(self._braking.end_ned_m)
        if mode is Mode.MISSION:
            self._mission_lands = False
            self.mission.enter()

    def _stop_here(self) -> None:
        here, moving = self.estimated_position_ned_m, self.estimated_velocity_ned_m_s
        self._braking = Braking.plan(
            self._now_s, here, moving, float(self.parameters["MPC_JERK_AUTO"])
        )
        self._hold_yaw_rad = wrap_pi(self.estimated_yaw_rad + 0.4 * self.quadrotor.yaw_rate_rad_s)
        self._vertical_sp_m_s = moving[2] if self._airborne else 0.0

    def _plan_return(self, here: Vector3) -> None:
        """Climb so high that the cone over home is reached from `here`, where it will stand."""
        home = self._home_ned_m
        height = home[2] - here[2]
        away = math.hypot(here[0] - home[0], here[1] - home[1])
        cone = min(_RETURN_CONE * away, float(self.parameters["RTL_RETURN_ALT"]))
        self._return_height_m = max(height, cone)
        climbs = self._return_height_m - height > _RETURN_LEVEL_M
        self._return_phase = "climb"
        self._return_s = self._now_s + (_RETURN_CLIMB_S if climbs else 0.0)
        amsl = self.origin[2] - home[2] + self._return_height_m
        above_m = math.ceil(self._return_height_m)
        self.say(
            Severity.INFO,
            f"RTL: start return at {math.ceil(amsl)} m ({above_m} m above destination)",
            events.RETURN_AT,
            math.ceil(amsl),
            above_m,
        )

    # ------------------------------------------------------------ flying

    def _fly(self, dt_s: float) -> Command:
        mode = self.mode
        if mode is Mode.OFFBOARD:
            return self._offboard_command()
        if mode is Mode.LAND:
            return self._descend(dt_s)
        if mode is Mode.RETURN:
            return self._return(dt_s)
        if mode is Mode.TAKEOFF:
            return self._climb(dt_s)
        if mode is Mode.MISSION:
            return self._fly_mission(dt_s)
        return self._hold(dt_s)

    def _fly_mission(self, dt_s: float) -> Command:
        if not self._airborne and not self.mission.finished:
            return self._locked(-0.1)  # whatever comes first, the ground is left upwards
        p, here = self.parameters, self.estimated_position_ned_m
        radii = (float(p["NAV_ACC_RAD"]), float(p["NAV_MC_ALT_RAD"]))
        step = self.mission.step(self._now_s, here, self.origin, self._home_ned_m, radii)
        if step.land:
            if not self._mission_lands:
                self._mission_lands = True
                self._stop_here()
            return self._descend(dt_s)
        if step.place_ned_m is None:
            self._command(Mode.RETURN if step.home else Mode.HOLD)
            self._enter(self._intended)
            return self._hold(dt_s)
        fastest = min(step.speed_m_s, float(p["MPC_XY_CRUISE"]))
        climb = (float(p["MPC_Z_V_AUTO_UP"]), float(p["MPC_Z_V_AUTO_DN"]))
        velocity = velocity_to(step.place_ned_m, here, fastest, climb)
        if math.hypot(velocity[0], velocity[1]) > 0.3:
            self._hold_yaw_rad = math.atan2(velocity[1], velocity[0])
        return Command(FREE3, velocity, self._hold_yaw_rad)

    def _offboard_command(self) -> Command:
        setpoint = self._setpoint
        if math.isnan(setpoint.yaw_rad) and math.isnan(setpoint.yaw_rate_rad_s):
            return msgspec.structs.replace(setpoint, yaw_rad=self._hold_yaw_rad)
        return setpoint

    def _slew(self, target_m_s: float, slew_m_s2: float, dt_s: float) -> float:
        step = slew_m_s2 * dt_s
        change = target_m_s - self._vertical_sp_m_s
        self._vertical_sp_m_s += min(max(change, -step), step)
        return self._vertical_sp_m_s

    def _locked(self, vertical_m_s: float) -> Command:
        """Stand horizontally where the stop ends, move vertically."""
        p, v, a = self._braking.at(self._now_s)
        return Command(
            (p[0], p[1], math.nan),
            (v[0], v[1], vertical_m_s),
            self._hold_yaw_rad,
            acceleration_ned_m_s2=(a[0], a[1], 0.0),
        )

    def _hold(self, dt_s: float) -> Command:
        if self._climb_to_m is not None:
            to_go = self.estimated_position_ned_m[2] - self._climb_to_m
            if abs(to_go) > 0.15 and self._airborne:
                return self._locked(self._slew(self._climb_rate(to_go), _CLIMB_SLEW_M_S2, dt_s))
        p, v, a = self._braking.at(self._now_s)
        down = p[2] if self._climb_to_m is None else self._climb_to_m
        return Command(
            (p[0], p[1], down), v, self._hold_yaw_rad, acceleration_ned_m_s2=(a[0], a[1], 0.0)
        )

    @staticmethod
    def _climb_rate(to_go_m: float) -> float:
        rate = _TAKEOFF_GAIN_PER_S * to_go_m
        return -min(max(rate, -_TAKEOFF_MAX_M_S), _TAKEOFF_MAX_M_S)

    def _climb(self, dt_s: float) -> Command:
        if self._climb_to_m is None:
            self._climb_to_m = self._home_ned_m[2] - float(self.parameters["MIS_TAKEOFF_ALT"])
        if not self._airborne:
            return self._locked(-0.1)
        to_go = self.estimated_position_ned_m[2] - self._climb_to_m
        if to_go < float(self.parameters["NAV_MC_ALT_RAD"]) and self.global_position:
            self._intended = Mode.HOLD
            self._entered = Mode.HOLD
        return self._locked(self._slew(self._climb_rate(to_go), _CLIMB_SLEW_M_S2, dt_s))

    def _descend(self, dt_s: float) -> Command:
        return self._locked(self._slew(self._descent_m_s(), _DESCENT_SLEW_M_S2, dt_s))

    def _descent_m_s(self) -> float:
        """PX4's landing speed by height: fast above MPC_LAND_ALT1, at last a crawl."""
        p, height_m = self.parameters, self.quadrotor.height_m
        if height_m < _CRAWL_BELOW_M:
            return float(p["MPC_LAND_CRWL"])
        low_m, high_m = float(p["MPC_LAND_ALT2"]), float(p["MPC_LAND_ALT1"])
        slow, fast = float(p["MPC_LAND_SPEED"]), float(p["MPC_Z_V_AUTO_DN"])
        share = min(max((height_m - low_m) / max(high_m - low_m, 1e-6), 0.0), 1.0)
        return slow + share * (fast - slow)

    def _return(self, dt_s: float) -> Command:
        home, here = self._home_ned_m, self.estimated_position_ned_m
        north, east = home[0] - here[0], home[1] - here[1]
        away = math.hypot(north, east)
        if self._return_phase == "climb":
            to_go = self._return_height_m - (home[2] - here[2])
            radius_m = _RETURN_REACHED_M
            if self._now_s < self._return_s:
                radius_m = 0.0
            if to_go > radius_m and self._airborne:
                fastest = float(self.parameters["MPC_Z_V_AUTO_UP"])
                rate = -min(_RETURN_CLIMB * math.sqrt(to_go), fastest)
                return self._locked(self._slew(rate, _RETURN_CLIMB_SLEW_M_S2, dt_s))
            self._return_phase = "fly"
        if self._return_phase == "fly" and away < float(self.parameters["NAV_ACC_RAD"]):
            self._return_phase = "land"
            self.say(Severity.INFO, "RTL: land at destination", events.RETURN_LANDS)
        vertical = 0.0
        fastest = float(self.parameters["MPC_XY_CRUISE"])
        if self._return_phase == "land":
            vertical = self._descend(dt_s).velocity_ned_m_s[2]
            fastest = _HOMING_MAX_M_S
        speed = min(_HOMING_GAIN_PER_S * away, fastest)
        share = speed / away if away > 1e-6 else 0.0
        return Command(FREE3, (north * share, east * share, vertical), self._hold_yaw_rad)

    # ------------------------------------------------------------ ground contact

    def _wanted_down_m_s(self, command: Command) -> float:
        down = command.velocity_ned_m_s[2]
        wanted = 0.0 if math.isnan(down) else down
        if not math.isnan(command.position_ned_m[2]):
            wanted += float(self.parameters["MPC_Z_P"]) * (
                command.position_ned_m[2] - self.estimated_position_ned_m[2]
            )
        return wanted

    def _lift_off(self, command: Command) -> None:
        """Spool up, ramp the thrust, leave the ground."""
        if self._airborne:
            return
        climbing = self.mode in (Mode.TAKEOFF, Mode.OFFBOARD, Mode.MISSION) and (
            self._wanted_down_m_s(command) < -0.05
        )
        if not climbing:
            if self._landed:
                self._ramp_s = None
            return
        if self._ramp_s is None:
            spooled_s = self._armed_s + float(self.parameters["COM_SPOOLUP_TIME"])
            self._ramp_s = max(self._now_s, spooled_s)
        since_s = self._now_s - self._ramp_s
        if self._landed and since_s >= _DETECT_AFTER_SPOOL_UP_S:
            self._landed = False
            self._flown = True
            self._landed_s = None
            self.home_set_s = self._now_s
            self.say(Severity.INFO, "Takeoff detected", events.TAKEOFF_DETECTED)
        ramp_s = float(self.parameters["MPC_TKO_RAMP_T"])
        early_s = _LIFT_OFF_OFFBOARD_S if self.mode is Mode.OFFBOARD else _LIFT_OFF_AUTO_S
        if not self._landed and since_s >= ramp_s + early_s:
            self._airborne = True
            self._vertical_sp_m_s = 0.0
            self._touch_s = None

    def _detect_landing(self, command: Command) -> None:
        # A take-off may be called off when it was detected and the ground not left yet.
        if not self._airborne and self._landed:
            return
        if not self.quadrotor.on_ground or self._wanted_down_m_s(command) < 0.05:
            self._touch_s = None
            return
        if self._touch_s is None:
            self._touch_s = self._now_s
        if self._now_s - self._touch_s >= _LANDING_DETECTED_S:
            self._landed = True
            self._airborne = False
            self._ramp_s = None
            self._landed_s = self._now_s
            self.mission.landed()
            self.say(Severity.INFO, "Landing detected", events.LANDING_DETECTED)

    def _auto_disarm(self) -> None:
        if not self._landed:
            return
        if self._landed_s is not None:
            after_s = float(self.parameters["COM_DISARM_LAND"])
            if after_s >= 0.0 and self._now_s - self._landed_s >= after_s:
                self._disarm("Disarmed by landing", events.LANDING)
            return
        after_s = float(self.parameters["COM_DISARM_PRFLT"])
        limit_s = after_s + float(self.parameters["COM_SPOOLUP_TIME"])
        if after_s > 0.0 and not self._flown and self._now_s - self._armed_s >= limit_s:
            self._disarm("Disarmed by auto preflight disarming", events.PREFLIGHT_INACTION)

    def _disarm(self, text: str, reason: int) -> None:
        in_air = not self._landed
        if self.in_failsafe:
            self._warned_mode = self._intended  # what was announced is not announced again
        self.flown_command = Command()
        self._armed = False
        self._airborne = False
        self._failsafe = None
        self._entered = None
        self._ramp_s = self._landed_s = self._touch_s = None
        self._kill_s = self._now_s if in_air else None
        self._climb_to_m = None
        if self._intended in (Mode.LAND, Mode.RETURN):
            self._intended = self._before_landing
        if self._intended in (Mode.TAKEOFF, Mode.MISSION):
            self._intended = Mode.HOLD
        self.say(Severity.INFO, text, events.DISARMED_BY, reason)

    def _apply_limits(self) -> None:
        p = self.parameters
        self.quadrotor.limit(
            Limits(
                position_gain_per_s=float(p["MPC_XY_P"]),
                height_gain_per_s=float(p["MPC_Z_P"]),
                horizontal_m_s=float(p["MPC_XY_VEL_MAX"]),
                up_m_s=float(p["MPC_Z_VEL_MAX_UP"]),
                down_m_s=float(p["MPC_Z_VEL_MAX_DN"]),
                yaw_rate_rad_s=math.radians(float(p["MC_YAWRATE_MAX"])),
            )
        )

    def say(
        self,
        severity: Severity,
        text: str,
        kind: EventKind | None = None,
        *arguments: float,
    ) -> None:
        """Queue a status text, and the event that tells the same."""
        self.texts.append(AutopilotText(self._now_s, severity, text))
        if kind is not None:
            self.report(kind, *arguments)

    def report(self, kind: EventKind, *arguments: float) -> None:
        """Queue an event alone."""
        self.event_sequence = (self.event_sequence + 1) & 0xFFFF
        self.events.append(AutopilotEvent.of(self._now_s, self.event_sequence, kind, *arguments))
