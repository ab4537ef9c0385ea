"""The pilot: `Pilot.step(inputs) -> decision`, pure and deterministic.

Sense; obey the operator; respond to faults; then let the present state decide. The states are in
rooms of their own: `sequence.py` (from the ground and back), `navigation.py` (Algorithm 2),
`orders.py` (hold), `returning.py`, `landing.py`. There is no clock, no randomness, no input or
output here: everything comes in `Inputs`.
"""

from autonomy.config import Config
from autonomy.geometry import distance
from autonomy.mission.drift import Drift
from autonomy.mission.heights import Heights
from autonomy.mission.landing import Landing
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES, TRANSITIONS
from autonomy.mission.navigation import Navigation
from autonomy.mission.orders import Orders
from autonomy.mission.responding import Responding
from autonomy.mission.returning import Returning
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.steering import CLEARANCE_LIMIT_M, Steering
from autonomy.mission.tick import Tick
from autonomy.mission.trail import Trail
from autonomy.model import Crumb, Decision, FusedState, Inputs, MissionState, Outcome, Resumed
from autonomy.t3drm.planner import Planner
from hal.frames import Vector3
from hal.interfaces import SeenSpace
from hal.setpoints import Setpoint

_OUTBOUND = NAVIGATING_STATES - {MissionState.HOLD, MissionState.RETURN}


class Pilot:
    """Flies one mission over a route of goals (NED about the take-off point)."""

    def __init__(
        self, config: Config, route: tuple[Vector3, ...], resumed: Resumed | None = None
    ) -> None:
        """Take a route that `preflight.check_route` accepts.

        With `resumed` the mission begins in the air, in PX4's Hold, with an empty map: it asks for
        Offboard and looks round before anything else.
        """
        self._config = config
        self._sensing = Sensing(config)
        planner = Planner(config.planner, config.body.radius_m, config.guard.fence)
        self._trail = Trail() if resumed is None else Trail(resumed.trail, flown_m=resumed.flown_m)
        self._heights = Heights(config, self._sensing, planner)
        self._steering = Steering(config, self._sensing, self._heights)
        self._navigation = Navigation(
            config, route, self._sensing, planner, self._heights, self._steering, self._trail
        )
        self._returning = Returning(
            config, self._sensing, planner, self._heights, self._steering, self._trail
        )
        self._drift = Drift(config)
        self._sequence = Sequence(config)
        self._responding = Responding(
            config, self._sensing, self._sequence, self._trail, self._drift
        )
        self._orders = Orders()
        self._landing = Landing(config, self._sequence)
        self._state = MissionState.PREFLIGHT
        self._held_from = MissionState.PREFLIGHT
        self._entered_s: float | None = None
        self._resumes = False
        self._last_s: float | None = None
        self._outcome: Outcome | None = None
        if resumed is not None:
            self._resume(resumed)

    @property
    def space(self) -> SeenSpace:
        """What was seen to be free, for the guard."""
        return self._sensing.map

    @property
    def sensing(self) -> Sensing:
        """Newest readings, map and frame, for the guard and for pictures."""
        return self._sensing

    @property
    def goal(self) -> Vector3:
        """The goal being flown to."""
        return self._navigation.goal

    # ------------------------------------------------------------ one step

    def step(self, inputs: Inputs) -> Decision:
        """Decide everything for this tick. `inputs.now_s` must not run backwards."""
        if self._last_s is not None and inputs.now_s < self._last_s:
            raise ValueError(f"time ran backwards: {inputs.now_s} s after {self._last_s} s")
        tick = self._tick(inputs, self._sensing.step(inputs))
        tick.movers = self._sensing.moving(tick.now_s)
        if self._resumes and tick.fused.ok:
            self._resumes = False
            tick.say("resume", "on with the mission that was interrupted; its map is empty")
            self._entered(tick)
        self._responding.listen(tick)
        tick.events.extend(self._sensing.lookout.news)
        if self._sensing.lookout.lost_now:
            self._steering.scan.restart()
        for command in inputs.commands:
            self._go(tick, self._orders.obey(tick, command))
        self._go(tick, self._orders.stay(tick))
        self._go(tick, self._responding.respond(tick))
        self._go(tick, self._decide(tick))
        self._steering.make_way(tick)
        self._steering.stream_something(tick)
        self._leave_crumb(tick)
        self._state, self._entered_s = tick.state, tick.entered_s
        return self._decision(tick)

    def _resume(self, resumed: Resumed) -> None:
        self._state = MissionState.OFFBOARD
        self._sensing.fix_home(resumed.home_ned_m)
        self._responding.armed(resumed.armed_s)
        self._navigation.begin_at(resumed.goal_index)
        self._sequence.in_the_air()
        self._resumes = True

    def resumed(self) -> Resumed | None:
        """What another program would need to go on from here; None before the vehicle is armed."""
        armed_s = self._responding.armed_s
        if armed_s is None:
            return None
        return Resumed(
            self._sensing.home_ned_m,
            armed_s,
            self._navigation.goal_index,
            self._trail.crumbs,
            self._trail.flown_m,
        )

    def _tick(self, inputs: Inputs, fused: FusedState) -> Tick:
        """The tick as it begins: in the state in which the last one ended."""
        nominal_s = 1.0 / self._config.control.rate_hz
        dt_s = inputs.now_s - self._last_s if self._last_s is not None else nominal_s
        self._last_s = inputs.now_s
        entered_s = inputs.now_s if self._entered_s is None else self._entered_s
        tick = Tick(inputs, fused, dt_s, self._state, entered_s)
        tick.events.extend(fused.news)
        tick.returning = self._returning.begun
        return tick

    def sent(self, setpoint: Setpoint | None) -> None:
        """What the guard let pass of the last decision's setpoint, in the mission frame."""
        self._drift.sent(setpoint)

    def _leave_crumb(self, tick: Tick) -> None:
        """On the way out, at a height of flight: where a return will fly back past."""
        fused, height_m = tick.fused, self._heights.present_m
        outbound = tick.state in _OUTBOUND and not self._heights.changing
        if outbound and fused.ok and self._trail.is_due(fused.point, height_m):
            self._trail.lay(Crumb(fused.point, height_m, self._heights.is_open(fused.point)))

    def _decide(self, tick: Tick) -> Move | None:
        """The present state's word on where to go next."""
        match tick.state:
            case MissionState.CRUISE | MissionState.FOLLOW:
                return self._navigation.follow(tick)
            case MissionState.STOP:
                return self._navigation.stop(tick)
            case MissionState.DETECT:
                return self._navigation.detect(tick)
            case MissionState.REPLAN:
                return self._navigation.replan(tick)
            case MissionState.HOLD:
                return self._orders.hold(tick, self._held_from)
            case MissionState.RETURN:
                return self._returning.fly(tick)
            case _:
                return self._decide_around(tick)

    def _decide_around(self, tick: Tick) -> Move | None:
        """The states before and after the flight proper."""
        match tick.state:
            case MissionState.PREFLIGHT:
                return self._preflight(tick)
            case MissionState.ARM:
                return self._sequence.arm(tick, tick.elapsed_s)
            case MissionState.TAKEOFF:
                return self._sequence.takeoff(tick, tick.elapsed_s)
            case MissionState.OFFBOARD:
                return self._sequence.offboard(tick, tick.elapsed_s)
            case MissionState.LAND:
                return self._landing.land(tick, self._outcome)
            case MissionState.YIELDED:
                return Move(MissionState.DONE, "no longer ours to command")
            case _:
                return None

    def _preflight(self, tick: Tick) -> Move | None:
        """PREFLIGHT: wait until nothing forbids arming."""
        silent = tuple(self._sensing.silent_beams(tick.now_s))
        above_m, covered = self._sensing.room_above_m(), self._sensing.covered_beams()
        return self._sequence.preflight(tick, tick.elapsed_s, silent, above_m, covered)

    # ------------------------------------------------------------ bookkeeping

    def _go(self, tick: Tick, move: Move | None) -> None:
        """Change state where that was decided; the transition must be in the table."""
        if move is None:
            return
        if move.state not in TRANSITIONS[tick.state]:
            raise AssertionError(f"{tick.state} -> {move.state} is not in the mission's table")
        if move.state is MissionState.HOLD:
            self._held_from = tick.state
        tick.state = move.state
        tick.entered_s = tick.now_s
        if move.outcome is not None:
            self._outcome = move.outcome
        tick.say(move.state.value, move.why)
        self._entered(tick)

    def _entered(self, tick: Tick) -> None:
        """What a new state begins with."""
        height_m = -tick.fused.position_ned_m[2]
        match tick.state:
            case MissionState.ARM:
                self._sensing.fix_home()
                self._responding.armed(tick.now_s)
            case MissionState.OFFBOARD:
                self._steering.let_go()
                self._heights.begin(tick.now_s, height_m, -self.goal[2])
                self._sensing.map.mark_seen_disc(tick.fused.point, self._config.map.start_disc_m)
            case MissionState.STOP | MissionState.DETECT | MissionState.HOLD:
                self._steering.scan.restart()
                self._heights.pause(height_m)
            case MissionState.RETURN:
                self._heights.pause(height_m)
                self._returning.again(tick, self._outcome)
            case MissionState.LAND:
                self._heights.pause(height_m)
            case _:
                pass

    def _decision(self, tick: Tick) -> Decision:
        """What this tick decided, as one record."""
        fused = tick.fused
        navigating = tick.state in OFFBOARD_STATES
        goal = (self.goal[0], self.goal[1])
        return Decision(
            now_s=tick.now_s,
            state=tick.state,
            fused=fused,
            setpoint=tick.setpoint,
            requests=tuple(tick.requests),
            events=tuple(tick.events),
            plan=tick.plan,
            distance_to_go_m=distance(fused.point, goal),
            clearance_m=(
                self._sensing.map.clearance_m(fused.position_ned_m, CLEARANCE_LIMIT_M)
                if navigating
                else CLEARANCE_LIMIT_M
            ),
            speed_limit_m_s=tick.speed_limit_m_s,
            stops=self._navigation.stops,
            replans=self._navigation.replans,
            outcome=self._outcome if tick.state is MissionState.DONE else None,
            height_m=self._heights.flown_at_m if navigating else None,
            faults=tuple(fault.fault.value for fault in tick.faults),
            walls=self._sensing.walls,
            doubts=self._sensing.lookout.doubts,
            movers=tick.movers,
        )
