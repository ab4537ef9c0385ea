"""RETURN: back along what was flown, to the take-off point or the last open place; then land.

No global position is needed. The vehicle comes to rest, flies the trail backwards where nothing
new stands on it, round what does where the planner finds a way to a later crumb, and changes its
height where the trail did. It moves under the same guard as ever: only through space that was seen
to be free lately, so that it looks round on the way and waits where it has not yet.
What cannot be flown back, in `failsafe.return_timeout_s` without the holds or after `_ATTEMPTS`
looks, lands here.

A mission that is to land where it found the goal unreachable comes by here too where that place is
narrow: PX4 descends by its own estimate, whose drift nothing corrects any more, so that it is
flown to the last open place first.
"""

import itertools
import math
from collections.abc import Callable

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance, polyline_length
from autonomy.mission.course import Course
from autonomy.mission.failsafe import Fault, Response, response_to
from autonomy.mission.heights import Heights
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move
from autonomy.mission.steering import Steering
from autonomy.mission.tick import Tick
from autonomy.mission.trail import SAME_HEIGHT_M, Trail
from autonomy.model import (
    Crumb,
    Ending,
    Environment,
    Leg,
    LegKind,
    MissionState,
    NoPlan,
    Outcome,
    Plan,
)
from autonomy.t3drm.planner import Planner, violated
from hal.frames import horizontal_norm

_AT_REST_M_S = 0.05
_REST_TIMEOUT_S = 4.0
_SWEEP_RAD = math.radians(100.0)
_THERE_M = 0.12
"""This near to a crumb is at it."""
_LOOK_S = 2.0
_ATTEMPTS = 6

_Step = Callable[[Tick], Move | None]


class Returning:
    """Begins once in a flight; an interruption (HOLD) is followed by `again`."""

    def __init__(
        self,
        config: Config,
        sensing: Sensing,
        planner: Planner,
        heights: Heights,
        steering: Steering,
        trail: Trail,
    ) -> None:
        self._config = config
        self._sensing = sensing
        self._planner = planner
        self._heights = heights
        self._steering = steering
        self._trail = trail
        self._course = Course(sensing)
        self._step: _Step = self._rest
        self._step_s = 0.0
        self._passes = 0
        """How many crumbs the present course flies back past."""
        self._attempts = 0
        self._wanted_m: float | None = None
        """The height that was set out for; None for a change that was under way before."""
        self._flown_s: float | None = None
        """How long the vehicle has been flying back; None before it turned back."""
        self._last_s = 0.0
        self._to_open = config.failsafe.return_to == "open"

    @property
    def begun(self) -> bool:
        """True once the mission has turned back."""
        return self._flown_s is not None

    def again(self, tick: Tick, outcome: Outcome | None) -> None:
        """The state is entered, for the first time or after a hold; `outcome` is the mission's."""
        if self._flown_s is None:
            self._flown_s = 0.0
        self._last_s = tick.now_s
        if outcome is not None and outcome.ending is Ending.UNREACHABLE:
            self._to_open |= response_to(self._config, Fault.UNREACHABLE) is Response.LAND
        self._enter(tick, self._rest)

    def fly(self, tick: Tick) -> Move | None:
        """RETURN: one tick."""
        self._flown_s = (self._flown_s or 0.0) + tick.now_s - self._last_s
        self._last_s = tick.now_s
        if self._flown_s > self._config.failsafe.return_timeout_s:
            return _land("the way back took too long")
        return self._step(tick)

    def _enter(self, tick: Tick, step: _Step) -> None:
        self._step, self._step_s = step, tick.now_s

    # ------------------------------------------------------------ steps

    def _rest(self, tick: Tick) -> Move | None:
        """Until the vehicle has come to rest."""
        if (
            horizontal_norm(tick.fused.velocity_ned_m_s) > _AT_REST_M_S
            and tick.now_s - self._step_s < _REST_TIMEOUT_S
        ):
            return None
        # A change of height that was under way comes first: this map is of neither height.
        self._enter(tick, self._change if self._heights.changing else self._choose)
        return None

    def _choose(self, tick: Tick) -> Move | None:
        """What comes next: a stretch at this height, another height, or the landing."""
        point = tick.fused.point
        back = self._trail.back(to_open=self._to_open)
        gone = [distance(crumb.point, point) > _THERE_M for crumb in back]
        if not any(gone) and all(self._is_here(crumb) for crumb in back):
            return _land(self._where())
        stretch = tuple(itertools.takewhile(self._is_here, back))
        if not stretch:
            return self._climb(tick, back[0].height_m)
        path = (point, *(crumb.point for crumb in stretch if distance(crumb.point, point) > 1e-6))
        if polyline_length(path) <= _THERE_M:
            return self._reached(tick, len(stretch))
        return self._set_out(tick, path, stretch)

    def _set_out(
        self, tick: Tick, path: tuple[Point, ...], stretch: tuple[Crumb, ...]
    ) -> Move | None:
        """Fly the trail where it is free, round what stands on it where there is a way."""
        keep_out_m = self._planner.keep_outs_m[-1]
        hits = self._sensing.map.hits()
        bar = violated(np.array(path), hits, keep_out_m)
        if bar is None:
            length_m = polyline_length(path)
            leg = Leg(LegKind.STRAIGHT, path, length_m, keep_out_m)
            plan = Plan((leg,), length_m, keep_out_m, Environment.FREE, ())
            self._fly_to(tick, plan, len(stretch))
            return None
        beyond = max(0, bar.segment - (len(path) - 1 - len(stretch)))
        for count in _targets(beyond, len(stretch)):
            found = self._planner.plan(tick.fused.point, stretch[count - 1].point, hits, _THERE_M)
            if not isinstance(found, NoPlan):
                self._fly_to(tick, found, count)
                return None
        return self._look_again(tick)

    def _fly_to(self, tick: Tick, plan: Plan, passes: int) -> None:
        tick.plan = plan
        self._course.take(plan)
        self._passes = passes
        tick.say("return", f"{plan.length_m:.2f} m back along the way that was flown")
        self._enter(tick, self._follow)

    def _follow(self, tick: Tick) -> Move | None:
        """Along the course, until its end or until something stands on it."""
        path = self._course.path
        if distance(tick.fused.point, path.points[-1]) <= _THERE_M:
            return self._reached(tick, self._passes)
        blocked_m = self._course.blocked_ahead_m()
        if blocked_m is not None and blocked_m <= self._config.mission.detection_range_m:
            return self._look_again(tick)
        if self._course.is_stuck(tick):
            return self._look_again(tick)
        self._steering.fly(tick, path)
        return None

    def _reached(self, tick: Tick, passed: int) -> Move | None:
        """At the end of a stretch."""
        back = self._trail.back(to_open=self._to_open)
        if passed >= len(back):
            return _land(self._where())
        self._trail.drop(passed)
        self._enter(tick, self._rest)
        return None

    def _climb(self, tick: Tick, height_m: float) -> Move | None:
        """To the height at which the trail goes on."""
        if not self._heights.may_change(tick, height_m):
            if tick.now_s - self._step_s < _LOOK_S:
                return None
            return _land(f"the way back goes on at {height_m:.2f} m, which cannot be reached")
        self._heights.change_to(height_m)
        self._wanted_m = height_m
        self._enter(tick, self._change)
        return None

    def _change(self, tick: Tick) -> Move | None:
        """Up or down, in place; then a look round, for the map of that height may be empty."""
        if not self._heights.change(tick):
            return None
        wanted_m, self._wanted_m = self._wanted_m, None
        if wanted_m is not None and abs(self._heights.present_m - wanted_m) > SAME_HEIGHT_M:
            return _land("the way back is at another height, which cannot be reached")
        self._look(tick)
        return None

    def _look_again(self, tick: Tick) -> Move | None:
        """Something stands on the way back."""
        self._attempts += 1
        if self._attempts > _ATTEMPTS:
            return _land("there is no way back")
        self._look(tick)
        return None

    def _look(self, tick: Tick) -> None:
        self._steering.scan.restart()
        self._enter(tick, self._looking)

    def _looking(self, tick: Tick) -> Move | None:
        """Until every bearing was seen once more."""
        swept = abs(self._steering.scan.turned_rad) >= _SWEEP_RAD
        if swept and tick.now_s - self._step_s >= _LOOK_S:
            self._enter(tick, self._choose)
        return None

    # ------------------------------------------------------------ small questions

    def _is_here(self, crumb: Crumb) -> bool:
        """True for a crumb at the present height."""
        return abs(crumb.height_m - self._heights.present_m) <= SAME_HEIGHT_M

    def _where(self) -> str:
        if self._to_open:
            return "back at the last open place"
        return "back where the flight began"


def _targets(first: int, count: int) -> tuple[int, ...]:
    """How many crumbs to fly to: just past what bars the way, then farther, then all."""
    steps = (first + 1, first + 3, first + 6, count)
    return tuple(dict.fromkeys(min(step, count) for step in steps))


def _land(why: str) -> Move:
    return Move(MissionState.LAND, f"{why}: landing")
