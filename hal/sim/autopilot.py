"""PX4's mode logic as a deterministic state machine on its own time, around a simulated vehicle.

Which request is refused, what is said about it, when the motors really lift, what happens when
setpoints stop: all as measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11. There is no remote
control, as indoors with a companion computer.

`Autopilot` is the door; behind it are the rooms, as in PX4: commander, health, failsafes, phases of
flight, land detector, battery, and the situation that they share.
"""

import math
from collections import deque
from typing import Literal, Protocol

import msgspec
import numpy as np

from hal.frames import ZERO3, Vector3, add, geodetic_from_ned, ned_from_frd, wrap_pi
from hal.sim.autopilot_announcements import Announcements
from hal.sim.autopilot_battery import SimulatedBattery
from hal.sim.autopilot_commander import Commander
from hal.sim.autopilot_failsafes import Failsafes
from hal.sim.autopilot_health import Health
from hal.sim.autopilot_land_detector import LandDetector
from hal.sim.autopilot_phases import FlightPhases
from hal.sim.autopilot_situation import Situation
from hal.sim.mission import Mission
from hal.sim.px4 import AutopilotText, Landed, Mode, Parameters, Result, Severity, SystemStatus
from hal.sim.px4_events import AutopilotEvent, EventKind
from hal.sim.px4_watch import HeartbeatWatch
from hal.sim.quadrotor import EXACT, FREE3, Command, IdealQuadrotor, Limits, Motors, Quadrotor
from hal.sim.sensors import EstimateOffset

_FIRST_HEARTBEAT_S = 1.4  # after a restart, measured


class _VehiclePart(Protocol):
    @property
    def drag_per_mass_s(self) -> float: ...
    @property
    def response(self) -> Literal["px4", "ideal"]: ...
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
        moves = IdealQuadrotor if scenario.vehicle.response == "ideal" else Quadrotor
        self.quadrotor = moves(
            drag_per_mass_s=scenario.vehicle.drag_per_mass_s,
            yaw_rad=wrap_pi(math.radians(scenario.start_yaw_deg)),
        )
        self.mission = Mission()
        self._announcements = Announcements()
        self._scenario = scenario
        self._rng = rng
        self._booted_s = 0.0
        self._silent_until_s = -math.inf
        self._boot_shift_ned_m: Vector3 = ZERO3
        self._start(scenario.gnss.origin, 0.0, armable_s=boot_s)

    def _start(self, origin: Vector3, now_s: float, *, armable_s: float) -> None:
        """Everything that does not outlive a restart, anew."""
        situation = Situation(
            self.parameters,
            self.quadrotor,
            self.mission,
            self._announcements,
            self._rng,
            origin=origin,
            has_gnss=self._scenario.gnss.present,
            now_s=now_s,
        )
        self._situation = situation
        self._health = Health(situation, armable_s)
        self._failsafes = Failsafes(situation, self._health)
        self._phases = FlightPhases(situation)
        self._land_detector = LandDetector(situation)
        self._commander = Commander(situation, self._health, self._phases, self._land_detector)
        self._battery = SimulatedBattery(self.parameters)
        self.quadrotor.limit(Limits.of(self.parameters))

    # ------------------------------------------------------------ what it is

    @property
    def now_s(self) -> float:
        """Seconds since it started (PX4's boot time)."""
        return self._situation.now_s

    @property
    def uptime_s(self) -> float:
        """Seconds since it was started last: what its clock shows on the wire."""
        return self.on_its_clock_s(self.now_s)

    def on_its_clock_s(self, at_s: float) -> float:
        """A time as the wire tells it, counted from the last start."""
        return at_s - self._booted_s

    @property
    def silent(self) -> bool:
        """True while it starts anew and says nothing."""
        return self.now_s < self._silent_until_s

    @property
    def armed(self) -> bool:
        """True while the motors may turn."""
        return self._situation.armed

    @property
    def flights(self) -> int:
        """How often it has been armed."""
        return self._commander.flights

    @property
    def airborne(self) -> bool:
        """True while its thrust carries it."""
        return self._situation.airborne

    @property
    def mode(self) -> Mode:
        """The mode that is flown: the failsafe's, else the one that was asked for."""
        return self._situation.mode

    @property
    def intended_mode(self) -> Mode:
        """The mode that was asked for."""
        return self._situation.intended

    @property
    def in_failsafe(self) -> bool:
        """True while a failsafe flies the vehicle."""
        return self._situation.failsafe is not None

    @property
    def landed(self) -> Landed:
        """PX4's own belief, which is later than the truth by up to two seconds."""
        return self._phases.landed_state

    @property
    def flown_command(self) -> Command:
        """What the position controller was asked for last."""
        return self._phases.flown_command

    @property
    def global_position(self) -> bool:
        """True while it knows where on Earth it is; the local position may be good without."""
        return self._situation.global_position

    @property
    def not_armable_because(self) -> str:
        """Why arming would be refused; empty when it would not."""
        return self._health.not_armable_because

    @property
    def system_status(self) -> SystemStatus:
        """As in the heartbeat."""
        if self.mode is Mode.TERMINATION:
            return SystemStatus.FLIGHT_TERMINATION
        if self.armed:
            return SystemStatus.CRITICAL if self.in_failsafe else SystemStatus.ACTIVE
        return SystemStatus.UNINIT if self.not_armable_because else SystemStatus.STANDBY

    @property
    def base_mode(self) -> int:
        """As in the heartbeat."""
        return self.mode.base_mode + (128 if self.armed else 0)

    @property
    def battery_remaining(self) -> float:
        """0..1. PX4's simulated battery: down to a half in 30 s of arming, full when disarmed."""
        return self._battery.remaining

    @property
    def battery_override(self) -> float | None:
        """0..1 told instead of the simulated battery's level; may be set."""
        return self._battery.override

    @battery_override.setter
    def battery_override(self, remaining: float | None) -> None:
        self._battery.override = remaining

    @property
    def origin(self) -> Vector3:
        """Of its local frame: latitude, longitude (degrees), altitude over sea (metres)."""
        return self._situation.origin

    @property
    def home_ned_m(self) -> Vector3:
        """Where it was armed last, in its own estimate."""
        return self._situation.home_ned_m

    @property
    def home_set_s(self) -> float:
        """When home was set last."""
        return self._situation.home_set_s

    @property
    def estimate_offset(self) -> EstimateOffset:
        """Estimate minus truth at the last step."""
        return self._situation.error

    @property
    def estimated_position_ned_m(self) -> Vector3:
        """What it believes."""
        return self._situation.estimated_position_ned_m

    @property
    def estimated_velocity_ned_m_s(self) -> Vector3:
        """What it believes."""
        return self._situation.estimated_velocity_ned_m_s

    @property
    def estimated_yaw_rad(self) -> float:
        """What it believes."""
        return self._situation.estimated_yaw_rad

    # ------------------------------------------------------------ whom it hears, what it says

    @property
    def ground_station(self) -> HeartbeatWatch:
        """Who hears a ground station tells it here."""
        return self._situation.ground_station

    @property
    def companion(self) -> HeartbeatWatch:
        """Who hears a companion computer tells it here."""
        return self._situation.companion

    @property
    def gnss_fix(self) -> bool:
        """False while its receiver has no fix; may be set."""
        return self._situation.gnss_fix

    @gnss_fix.setter
    def gnss_fix(self, fix: bool) -> None:
        self._situation.gnss_fix = fix

    @property
    def texts(self) -> deque[AutopilotText]:
        """Status texts, oldest first; who sends them takes them out."""
        return self._announcements.texts

    @property
    def events(self) -> deque[AutopilotEvent]:
        """Events, oldest first; who sends them takes them out."""
        return self._announcements.events

    @property
    def event_sequence(self) -> int:
        """The number of the last event, 16 bit."""
        return self._announcements.event_sequence

    def say(
        self, severity: Severity, text: str, kind: EventKind | None = None, *arguments: float
    ) -> None:
        """Queue a status text, and the event that tells the same."""
        self._situation.say(severity, text, kind, *arguments)

    def report(self, kind: EventKind, *arguments: float) -> None:
        """Queue an event alone."""
        self._situation.report(kind, *arguments)

    # ------------------------------------------------------------ requests

    def arm(self) -> Result:
        """MAV_CMD_COMPONENT_ARM_DISARM with 1."""
        return self._commander.arm()

    def report_health(self) -> Result:
        """MAV_CMD_RUN_PREARM_CHECKS: say anew what stands against arming."""
        self._health.report_anew()
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """MAV_CMD_COMPONENT_ARM_DISARM with 0; `force` cuts the motors in the air as well."""
        return self._commander.disarm(force=force)

    def takeoff(self, altitude_amsl_m: float | None = None) -> Result:
        """MAV_CMD_NAV_TAKEOFF; None (NaN on the wire) climbs MIS_TAKEOFF_ALT above home."""
        return self._commander.takeoff(altitude_amsl_m)

    def land(self) -> Result:
        """MAV_CMD_NAV_LAND."""
        return self._commander.land()

    def return_to_launch(self) -> Result:
        """MAV_CMD_NAV_RETURN_TO_LAUNCH."""
        return self._commander.return_to_launch()

    def hold_at(self, position_ned_m: Vector3) -> Result:
        """MAV_CMD_DO_REPOSITION: hold there; NaN components stay as they are."""
        return self._commander.hold_at(position_ned_m)

    def start_mission(self, first: int = 0) -> Result:
        """MAV_CMD_MISSION_START: arm if need be and fly the mission from item `first` on."""
        return self._commander.start_mission(first)

    def set_mode(self, main: int, sub: int = 0) -> Result:
        """MAV_CMD_DO_SET_MODE. Disarmed every mode is taken; armed only one that can be flown."""
        return self._commander.set_mode(main, sub)

    def terminate(self) -> Result:
        """MAV_CMD_DO_FLIGHTTERMINATION: motors off for good."""
        self._failsafes.terminate()
        return Result.ACCEPTED

    def set_setpoint(
        self,
        position_ned_m: Vector3 = FREE3,
        velocity_ned_m_s: Vector3 = FREE3,
        yaw_rad: float = math.nan,
        yaw_rate_rad_s: float = math.nan,
    ) -> None:
        """One offboard setpoint in local NED, valid from now on; NaN leaves a component free."""
        setpoint = Command(position_ned_m, velocity_ned_m_s, yaw_rad, yaw_rate_rad_s)
        self._situation.setpoint, self._situation.setpoint_s = setpoint, self.now_s

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
        self.quadrotor.limit(Limits.of(self.parameters))
        return Result.ACCEPTED

    # ------------------------------------------------------------ faults

    def refuse(self, what: str, texts: tuple[str, ...]) -> None:
        """Refuse "arm" or "offboard" with these texts from now on; with none, no longer."""
        self._commander.refuse(what, texts)

    def take_refused(self, what: str) -> int:
        """How often that was refused since it was last asked."""
        return self._commander.take_refused(what)

    def take_over(self, mode: Mode) -> None:
        """A pilot's switch: the mode is flown whether or not a command could have asked for it."""
        self._situation.ask_for(mode)

    def fail_safe(self, mode: Mode) -> None:
        """A failsafe of its own takes over; only another mode ends it."""
        self._failsafes.begin(mode)

    def shift_estimate(self, by_ned_m: Vector3, by_yaw_rad: float = 0.0) -> None:
        """The estimator's frame jumped: what it holds and returns to moves along, as in PX4."""
        self._phases.shift(by_ned_m, by_yaw_rad)

    def reboot(self, boot_s: float) -> None:
        """Start anew: motors off, silent at first, armable after `boot_s`, a frame from here.

        Parameters and the mission are kept.
        """
        now_s, (north, east, down) = self.now_s, self.quadrotor.position_ned_m
        origin = geodetic_from_ned((north, east, down), self._scenario.gnss.origin)
        self._boot_shift_ned_m = (-north, -east, -down)
        self._booted_s = now_s
        self._silent_until_s = now_s + _FIRST_HEARTBEAT_S
        self._announcements.restart()
        self._start(origin, now_s, armable_s=now_s + boot_s)

    def set_fault(self, reason: str) -> None:
        """Make arming impossible for `reason` (PX4's words), or possible again with ''."""
        self._health.fault = reason

    # ------------------------------------------------------------ time

    def step(self, dt_s: float, error: EstimateOffset = EXACT) -> None:
        """Let `dt_s` seconds pass while the estimate is off by `error`."""
        s = self._situation
        s.now_s += dt_s
        if self._booted_s > 0.0:
            moved = add(error.position_ned_m, self._boot_shift_ned_m)
            error = msgspec.structs.replace(error, position_ned_m=moved)
        s.error = error
        self._battery.step(dt_s, armed=s.armed)
        self._failsafes.watch()
        if not s.armed:
            self.quadrotor.step(dt_s, Command(), Motors.STOPPED, error)
            self._land_detector.detect_fall()
            return
        self._failsafes.act()
        if s.mode is Mode.TERMINATION:
            s.airborne = False
            self.quadrotor.step(dt_s, Command(), Motors.STOPPED, error)
            return
        self._fly(dt_s)

    def _fly(self, dt_s: float) -> None:
        s, detector = self._situation, self._land_detector
        command = self._phases.fly(dt_s)
        if detector.lift_off(command):
            self._phases.leave_ground()
        motors = Motors.FLYING if s.airborne else Motors.IDLE
        self.quadrotor.step(dt_s, command, motors, s.error)
        detector.detect_landing(command)
        disarm_because = detector.disarm_because
        if disarm_because is not None:
            self._commander.stop_motors(*disarm_because)
