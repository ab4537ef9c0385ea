"""The phases of flight: what the position controller is asked for in each mode.

Take-off, Hold, OFFBOARD, landing and missions are here; the return has its own room.
"""

import math

import msgspec

from hal.frames import Vector3, add
from hal.sim.autopilot_return import Return
from hal.sim.autopilot_situation import Situation
from hal.sim.autopilot_smoothing import Smoothing
from hal.sim.mission import velocity_to
from hal.sim.px4 import Landed, Mode
from hal.sim.quadrotor import FREE3, Command

_OFF_THE_GROUND_M_S = -0.1  # down; asks the land detector for thrust
_CLIMBED_M = 0.15
_HEADS_ABOVE_M_S = 0.3  # a mission looks where it flies


class FlightPhases:
    """The source of setpoints. Writes `Situation.entered`; a phase that ends asks for the next."""

    def __init__(self, situation: Situation) -> None:
        self._situation = situation
        self._smoothing = Smoothing(situation)
        self._return = Return(situation, self._smoothing)
        self._mission_lands = False
        self.flown_command = Command()
        """What the position controller was asked for last."""

    @property
    def landed_state(self) -> Landed:
        """As PX4 tells it: on the ground, or in the air taking off, landing or neither."""
        s, mode = self._situation, self._situation.mode
        if s.landed:
            return Landed.ON_GROUND
        if mode is Mode.TAKEOFF:
            return Landed.TAKEOFF
        coming_down = self._return.landing if mode is Mode.RETURN else False
        if mode is Mode.MISSION:
            coming_down = self._mission_lands
        if mode is Mode.LAND or (coming_down and s.entered is mode):
            return Landed.LANDING
        return Landed.IN_AIR

    def enter(self, mode: Mode) -> None:
        """Take over from the mode before: where to stop, how high to climb."""
        self._situation.entered = mode
        self._smoothing.stop_here()
        if mode is Mode.RETURN:
            self._return.plan(self._smoothing.braking.end_ned_m)
        if mode is Mode.MISSION:
            self._mission_lands = False
            self._situation.mission.enter()

    def hold_at(self, position_ned_m: Vector3) -> None:
        """Hold, there instead of where it stops."""
        self.enter(Mode.HOLD)
        self._smoothing.stand_at(position_ned_m)

    def leave_ground(self) -> None:
        """The thrust carries it from now on."""
        self._smoothing.leave_ground()

    def rest(self) -> None:
        """The motors stand still: nothing is asked for."""
        self.flown_command = Command()

    def shift(self, by_ned_m: Vector3, by_yaw_rad: float) -> None:
        """The estimator's frame jumped: what it holds and returns to moves along, as in PX4."""
        s = self._situation
        self._smoothing.shift(by_ned_m, by_yaw_rad)
        s.home_ned_m = add(s.home_ned_m, by_ned_m)
        if s.climb_to_m is not None:
            s.climb_to_m += by_ned_m[2]

    def fly(self, dt_s: float) -> Command:
        """What the mode that is flown asks for now."""
        if self._situation.entered is not self._situation.mode:
            self.enter(self._situation.mode)
        self.flown_command = self._command(dt_s)
        return self.flown_command

    def _command(self, dt_s: float) -> Command:
        mode = self._situation.mode
        if mode is Mode.OFFBOARD:
            return self._offboard()
        if mode is Mode.LAND:
            return self._land(dt_s)
        if mode is Mode.RETURN:
            return self._return.fly(dt_s)
        if mode is Mode.TAKEOFF:
            return self._take_off(dt_s)
        if mode is Mode.MISSION:
            return self._mission(dt_s)
        return self._hold(dt_s)

    def _offboard(self) -> Command:
        setpoint = self._situation.setpoint
        if math.isnan(setpoint.yaw_rad) and math.isnan(setpoint.yaw_rate_rad_s):
            return msgspec.structs.replace(setpoint, yaw_rad=self._smoothing.yaw_rad)
        return setpoint

    def _land(self, dt_s: float) -> Command:
        return self._smoothing.locked(self._smoothing.descent_m_s(dt_s))

    def _take_off(self, dt_s: float) -> Command:
        s = self._situation
        if s.climb_to_m is None:
            s.climb_to_m = s.default_takeoff_m
        if not s.airborne:
            return self._smoothing.locked(_OFF_THE_GROUND_M_S)
        to_go_m = s.estimated_position_ned_m[2] - s.climb_to_m
        if to_go_m < float(s.parameters["NAV_MC_ALT_RAD"]) and s.global_position:
            s.intended = Mode.HOLD
            s.entered = Mode.HOLD
        return self._smoothing.climb(to_go_m, dt_s)

    def _hold(self, dt_s: float) -> Command:
        s = self._situation
        if s.climb_to_m is not None:
            to_go_m = s.estimated_position_ned_m[2] - s.climb_to_m
            if abs(to_go_m) > _CLIMBED_M and s.airborne:
                return self._smoothing.climb(to_go_m, dt_s)
        return self._smoothing.stand(s.climb_to_m)

    def _mission(self, dt_s: float) -> Command:
        s, p = self._situation, self._situation.parameters
        if not s.airborne and not s.mission.finished:
            # Whatever comes first, the ground is left upwards.
            return self._smoothing.locked(_OFF_THE_GROUND_M_S)
        here = s.estimated_position_ned_m
        radii = (float(p["NAV_ACC_RAD"]), float(p["NAV_MC_ALT_RAD"]))
        step = s.mission.step(s.now_s, here, s.origin, s.home_ned_m, radii)
        if step.land:
            if not self._mission_lands:
                self._mission_lands = True
                self._smoothing.stop_here()
            return self._land(dt_s)
        if step.place_ned_m is None:
            s.ask_for(Mode.RETURN if step.home else Mode.HOLD)
            self.enter(s.intended)
            return self._hold(dt_s)
        fastest = min(step.speed_m_s, float(p["MPC_XY_CRUISE"]))
        climb = (float(p["MPC_Z_V_AUTO_UP"]), float(p["MPC_Z_V_AUTO_DN"]))
        velocity = velocity_to(step.place_ned_m, here, fastest, climb)
        if math.hypot(velocity[0], velocity[1]) > _HEADS_ABOVE_M_S:
            self._smoothing.yaw_rad = math.atan2(velocity[1], velocity[0])
        return Command(FREE3, velocity, self._smoothing.yaw_rad)
