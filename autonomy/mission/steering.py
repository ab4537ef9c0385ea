"""From "along this path" and "stay here" to a setpoint; every offboard tick gets one."""

import math

from autonomy.config import Config, GuidanceConfig
from autonomy.geometry import Point
from autonomy.guidance.follower import arrival_speed, carrot_direction, push_away
from autonomy.guidance.outer_loops import OuterLoops
from autonomy.guidance.path import FlownPath
from autonomy.guidance.pid import Pid
from autonomy.guidance.yaw_scan import YawScan
from autonomy.mission.heights import Heights
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES
from autonomy.mission.making_way import MakingWay
from autonomy.mission.sensing import Sensing
from autonomy.mission.tick import Tick
from autonomy.model import MissionState
from autonomy.t3drm.speed import speed_limit_m_s
from hal.readings import FlightMode, LandedState
from hal.setpoints import Setpoint

CLEARANCE_LIMIT_M = 1.0
_NEAR_M = 0.25
"""The floor, and what the position was seen to wander by between two looks at a bearing."""
_STOP_LEAD_S = 0.1
"""Where to hold: the vehicle cannot stop at once, and is not asked to come back."""


class Steering:
    """Remembers the place that is held, and how far the look round has come."""

    def __init__(self, config: Config, sensing: Sensing, heights: Heights) -> None:
        self._config = config
        self._sensing = sensing
        self._heights = heights
        self.scan = YawScan(math.radians(config.guidance.yaw_rate_deg_s))
        self._loops = OuterLoops(config.guidance)
        self._climb = Pid(config.guidance.altitude, config.guard.climb_max_m_s)
        self._hold_at: Point | None = None
        self._making_way = MakingWay(config)
        self._strayed = False
        self._scan_rates_rad_s = (
            self.scan.rate_rad_s,
            max(self.scan.rate_rad_s, math.radians(config.movers.scan_deg_s)),
        )
        """While everything stands, and while something moves."""
        self._retreat = _retreat(config)

    def let_go(self) -> None:
        """The next hold begins where the vehicle is then."""
        self._hold_at = None

    def fly(self, tick: Tick, path: FlownPath) -> None:
        """Velocity along the path by Table 2's speed, pushed away from what is too near."""
        fused, guidance = tick.fused, self._config.guidance
        velocity = (fused.velocity_ned_m_s[0], fused.velocity_ned_m_s[1])
        direction = carrot_direction(path, fused.point, velocity, guidance)
        nearest = self._sensing.map.nearest_hit(fused.position_ned_m, CLEARANCE_LIMIT_M)
        self.turn_beside(nearest)
        clearance_m, closing = math.inf, 0.0
        if nearest is not None:
            clearance_m = nearest[0]
            closing = direction[0] * math.cos(nearest[1]) + direction[1] * math.sin(nearest[1])
        tick.speed_limit_m_s = speed_limit_m_s(
            clearance_m,
            -closing * guidance.speed_max_m_s,
            guidance,
            self._config.beams.max_m,
        )
        tick.speed_limit_m_s = min(tick.speed_limit_m_s, self._sensing.lookout.speed_max_m_s)
        if tick.slow:
            tick.speed_limit_m_s = min(tick.speed_limit_m_s, guidance.speed_min_m_s)
        speed_m_s = arrival_speed(path.remaining_m, tick.speed_limit_m_s)
        wanted = self._loops.track(
            (direction[0] * speed_m_s, direction[1] * speed_m_s), velocity, tick.dt_s
        )
        north, east = push_away(wanted, nearest, guidance, velocity)
        down_m = -self._heights.commanded_m
        climb_m_s = self._climb.step(down_m, fused.position_ned_m[2], tick.dt_s)
        self._hold_at = None
        tick.setpoint = Setpoint(
            tick.now_s,
            fused.position_ned_m,
            (north, east, climb_m_s),
            self.scan.step(fused.yaw_rad, tick.dt_s),
        )

    def turn_beside(self, nearest: tuple[float, float] | None) -> None:
        """Turn faster beside what is near: until a beam looks there again, the map stands where the
        position was then.
        """
        near = nearest is not None and nearest[0] < _NEAR_M
        self.scan.rate_rad_s = self._scan_rates_rad_s[near or self._sensing.things_move]

    def hold(self, tick: Tick) -> None:
        """Hold with a position (zero velocity alone drifts), turning on.

        Where a hit turns out to be too near to stay, the place to hold moves away from it.
        """
        fused = tick.fused
        yaw_rad = fused.yaw_rad
        nearest = self._sensing.map.nearest_hit(fused.position_ned_m, CLEARANCE_LIMIT_M)
        self.turn_beside(nearest)
        if tick.state is not MissionState.OFFBOARD:
            yaw_rad = self.scan.step(fused.yaw_rad, tick.dt_s)
        guidance = self._retreat if self._sensing.things_move else self._config.guidance
        push = push_away((0.0, 0.0), nearest, guidance)
        down_m = -self._heights.commanded_m
        if push != (0.0, 0.0):
            self._hold_at = None
            tick.setpoint = Setpoint(tick.now_s, (*fused.point, down_m), (*push, 0.0), yaw_rad)
            return
        if self._hold_at is None:
            velocity = fused.velocity_ned_m_s
            self._hold_at = (
                fused.position_ned_m[0] + velocity[0] * _STOP_LEAD_S,
                fused.position_ned_m[1] + velocity[1] * _STOP_LEAD_S,
            )
        added = self._loops.hold(self._hold_at, fused.point, tick.dt_s)
        place = (*self._hold_at, down_m)
        tick.setpoint = Setpoint(tick.now_s, place, (*added, 0.0), yaw_rad)

    def make_way(self, tick: Tick) -> None:
        """Something moves, and comes too near to what this tick would fly: fly something else."""
        fused, setpoint = tick.fused, tick.setpoint
        if not tick.movers and not self._making_way.active:
            return
        navigating = tick.state in NAVIGATING_STATES and not self._heights.changing
        if not (navigating and fused.ok):
            self._making_way.stop()
            return
        planned = (0.0, 0.0) if setpoint is None else setpoint.velocity_ned_m_s[:2]
        space = self._sensing.map
        evasion = self._making_way.advise(
            tick.now_s, fused, planned, tick.movers, space, self._sensing.lookout.speed_max_m_s
        )
        if evasion is None:
            return
        self._strayed = True
        if evasion.why is not None:
            tick.say("make_way", evasion.why)
        if evasion.direction is None:
            tick.setpoint = None
            return
        self._hold_at = None
        yaw_rad = self.scan.commanded_rad if setpoint is not None else None
        if yaw_rad is None:
            yaw_rad = self.scan.step(fused.yaw_rad, tick.dt_s)
        down_m = -self._heights.commanded_m
        climb_m_s = self._climb.step(down_m, fused.position_ned_m[2], tick.dt_s)
        velocity = (*evasion.commanded(fused), climb_m_s)
        tick.setpoint = Setpoint(tick.now_s, fused.position_ned_m, velocity, yaw_rad)

    @property
    def makes_way(self) -> bool:
        """True while something else is flown than was asked for."""
        return self._making_way.active

    def has_strayed(self) -> bool:
        """True once after making way: whatever was planned before begins elsewhere."""
        if self._making_way.active or not self._strayed:
            return False
        self._strayed = False
        return True

    def stream_something(self, tick: Tick) -> None:
        """Every offboard tick has a setpoint; where no state gave one, it is to hold."""
        streaming = tick.state in OFFBOARD_STATES or (
            # Until PX4 has taken over the landing, keep holding.
            tick.state is MissionState.LAND
            and tick.inputs.status.mode is FlightMode.OFFBOARD
            and tick.inputs.status.landed is not LandedState.ON_GROUND
        )
        if tick.setpoint is None and streaming:
            self.hold(tick)


def _retreat(config: Config) -> GuidanceConfig:
    """How a stopped vehicle leaves what is too near, while something moves."""
    guidance, movers = config.guidance, config.movers
    return guidance.model_copy(
        update={
            "push_below_m": max(guidance.push_below_m, movers.retreat_below_m),
            "push_speed_m_s": max(guidance.push_speed_m_s, movers.retreat_speed_m_s),
        }
    )
