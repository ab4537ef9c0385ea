"""The pilot: `Pilot.step(inputs) -> decision`, pure and deterministic.

Sense; obey the operator; respond to faults; then let the present state decide. The states are in
rooms of their own: `sequence.py` (from the ground and back), `navigation.py` (Algorithm 2),
`orders.py` (hold), `landing.py`. There is no clock, no randomness, no input or output here:
everything comes in `Inputs`.
"""

from collections.abc import Callable

from autonomy.config import Config
from autonomy.geometry import distance
from autonomy.mission.heights import Heights
from autonomy.mission.landing import Landing
from autonomy.mission.machine import OFFBOARD_STATES, TRANSITIONS
from autonomy.mission.navigation import Navigation
from autonomy.mission.orders import Orders
from autonomy.mission.responding import Responding
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.steering import CLEARANCE_LIMIT_M, Steering
from autonomy.mission.tick import Tick
from autonomy.model import Decision, FusedState, Inputs, MissionState, Outcome
from autonomy.t3drm.planner import Planner
from hal.frames import Vector3
from hal.interfaces import SeenSpace


class Pilot:
    """Flies one mission over a route of goals (NED about the take-off point)."""

    def __init__(self, config: Config, route: tuple[Vector3, ...]) -> None:
        """Take a route that `preflight.check_route` accepts."""
        self._config = config
        self._sensing = Sensing(config)
        planner = Planner(config.planner, config.body.radius_m, config.guard.fence)
        self._heights = Heights(config, self._sensing, planner)
        self._steering = Steering(config, self._sensing, self._heights)
        self._navigation = Navigation(
            config, route, self._sensing, planner, self._heights, self._steering
        )
        self._sequence = Sequence(config)
        self._responding = Responding(config, self._sensing, self._sequence)
        self._orders = Orders(self._responding)
        self._landing = Landing(config, self._sequence, self._responding)
        self._state = MissionState.PREFLIGHT
        self._held_from = MissionState.PREFLIGHT
        self._entered_s: float | None = None
        self._last_s: float | None = None
        self._outcome: Outcome | None = None
        self._states = self._rooms()

    def _rooms(self) -> dict[MissionState, Callable[[Tick], Move | None]]:
        """Who decides in which state."""
        sequence, navigation = self._sequence, self._navigation
        return {
            MissionState.PREFLIGHT: self._preflight,
            MissionState.ARM: lambda tick: sequence.arm(tick, tick.elapsed_s),
            MissionState.TAKEOFF: lambda tick: sequence.takeoff(tick, tick.elapsed_s),
            MissionState.OFFBOARD: lambda tick: sequence.offboard(tick, tick.elapsed_s),
            MissionState.CRUISE: navigation.follow,
            MissionState.FOLLOW: navigation.follow,
            MissionState.STOP: navigation.stop,
            MissionState.DETECT: navigation.detect,
            MissionState.REPLAN: navigation.replan,
            MissionState.HOLD: lambda tick: self._orders.hold(tick, self._held_from),
            MissionState.LAND: lambda tick: self._landing.land(tick, self._outcome),
            MissionState.YIELDED: lambda _: Move(MissionState.DONE, "no longer ours to command"),
            MissionState.DONE: lambda _: None,
        }

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
        self._responding.listen(tick)
        for command in inputs.commands:
            self._go(tick, self._orders.obey(tick, command))
        self._go(tick, self._orders.stay(tick))
        self._go(tick, self._responding.respond(tick))
        self._go(tick, self._states[tick.state](tick))
        self._steering.stream_something(tick)
        self._state, self._entered_s = tick.state, tick.entered_s
        return self._decision(tick)

    def _tick(self, inputs: Inputs, fused: FusedState) -> Tick:
        """The tick as it begins: in the state in which the last one ended."""
        nominal_s = 1.0 / self._config.control.rate_hz
        dt_s = inputs.now_s - self._last_s if self._last_s is not None else nominal_s
        self._last_s = inputs.now_s
        entered_s = inputs.now_s if self._entered_s is None else self._entered_s
        return Tick(inputs, fused, dt_s, self._state, entered_s)

    def _preflight(self, tick: Tick) -> Move | None:
        """PREFLIGHT: wait until nothing forbids arming."""
        silent = tuple(self._sensing.silent_beams(tick.now_s))
        above_m = self._sensing.room_above_m()
        return self._sequence.preflight(tick, tick.elapsed_s, silent, above_m)

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
        )
