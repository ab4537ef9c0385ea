"""At which height to fly, and how to get there: the pilot's part of over and under.

A height is changed in place, at rest, and only as far as the beam in that direction shows room;
then the vehicle looks round there before anything is planned. What was seen at each height is
remembered (`StoreyMaps`); `t3drm.over_under` says which height is the cheapest.
"""

import math
from collections import deque
from collections.abc import Iterable

import msgspec

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.mission.sensing import Room, Sensing
from autonomy.mission.tick import Tick
from autonomy.model import NoPlan, Plan
from autonomy.perception.storey_maps import FloatArray
from autonomy.t3drm.over_under import SAME_M, Price, Question, Search, Storeys, Way
from autonomy.t3drm.planner import Failure, Planner

NEAR_HEIGHT_M = 0.15
"""This near, the height of a goal is reached, should the guard not allow more."""
SETTLED_M = 0.05
CHANGE_TIMEOUT_S = 15.0
"""So much longer than a steady climb takes may a change last."""
BLIND_S = 2.0
"""So long the beam that looks where the vehicle moves may be silent before it turns back."""
HERE_M = 0.3
"""What was found out about a height holds this far round the place."""
PLACES_KEPT = 64
SHAFT_MARGIN_M = 0.02
ROOM_M, ROOM_IN_FENCE_M = 0.3, 0.1
"""A height is changed, and a look taken there for seconds, only this far from every hit and from
the fence: between the two, an error of the position of 10 cm has nowhere to go."""
OPEN_M, OPEN_IN_FENCE_M = 0.4, 0.2
"""So much room has a place that is worth flying back to for it."""
RETREATS_MAX = 4
SEARCH_SHARE = 0.6
"""Of the mission's time limit: later no other height is looked at; a verdict comes in time."""


class Heights:
    """The present height of flight, the change that is under way, and the search for others."""

    def __init__(self, config: Config, sensing: Sensing, planner: Planner) -> None:
        self._config = config
        self._sensing, self._planner = sensing, planner
        self._price = Price.of(config.planner.storeys, config.guidance)
        self._storeys = self._storeys_about(config.mission.altitude_m)
        self.present_m = config.mission.altitude_m
        """The storey that the present map belongs to; kept until a change has ended."""
        self.commanded_m = self.present_m
        """What to fly at now."""
        self.changes = 0
        self._wanted_m: float | None = None
        self._came_from_m = self.present_m
        self._began_s = 0.0
        self._limit_s = CHANGE_TIMEOUT_S
        self._seen_s = 0.0
        self._barred: deque[tuple[float, Point]] = deque(maxlen=PLACES_KEPT)
        self._looked: deque[tuple[float, Point]] = deque(maxlen=PLACES_KEPT)
        self._search: Search | None = None
        self._why_left_out: str | None = None
        self._guesses = True
        self._search_until_s = math.inf
        self._open_at: Point | None = None
        self._retreats = 0
        # What is flown only to prove that there is no way needs no narrow passages.
        wide_m = max(config.planner.storeys.proof_clearance_m, config.planner.hard_clearance_m)
        wide = {"comfortable_clearance_m": wide_m, "hard_clearance_m": wide_m, "levels": 1}
        self._wide_planner = Planner(
            config.planner.model_copy(update=wide), config.body.radius_m, config.guard.fence
        )

    # ------------------------------------------------------------ which goal

    def begin(self, now_s: float, height_m: float, goal_m: float) -> None:
        """In the air at `height_m`, on the way to a goal at `goal_m`; nothing is known yet."""
        self._search_until_s = now_s + SEARCH_SHARE * self._config.mission.time_limit_s
        self._sensing.maps.settle(self.present_m)
        if not self.aim(height_m, goal_m):
            self._sensing.begin_at_height(self.present_m)
        self.changes = 0

    def aim(self, height_m: float, goal_m: float) -> bool:
        """The next goal is at `goal_m`; True when the height has to be changed for it."""
        self._storeys = self._storeys_about(goal_m)
        goal_m = self._storeys.goal_m
        self._search = None
        self._wanted_m = None
        # What was tried on the way to the last goal says little about the way to this one.
        self._guesses, self._retreats = True, 0
        if abs(height_m - goal_m) > NEAR_HEIGHT_M:
            self.commanded_m = self.present_m
            self.change_to(goal_m)
            return True
        if abs(goal_m - self.present_m) > SAME_M:
            self.present_m = goal_m
            self._sensing.maps.settle(goal_m)
        self.commanded_m = goal_m
        return False

    @property
    def at_goals_height(self) -> bool:
        """True at the goal's storey."""
        return not self.changing and abs(self.present_m - self._storeys.goal_m) <= SAME_M

    @property
    def goal_m(self) -> float:
        """The goal's height."""
        return self._storeys.goal_m

    # ------------------------------------------------------------ changing

    @property
    def changing(self) -> bool:
        """True from the order until the vehicle has come to rest at a storey."""
        return self._wanted_m is not None

    @property
    def flown_at_m(self) -> float:
        """The height being flown at, or changed to."""
        return self.present_m if self._wanted_m is None else self._wanted_m

    def change_to(self, height_m: float) -> None:
        """Order a change; `change` makes it, tick by tick, once the vehicle is at rest."""
        self._search = None
        self._wanted_m = height_m
        self._came_from_m = self.present_m
        self._began_s = math.nan
        self.changes += 1

    def pause(self, height_m: float) -> None:
        """Something else comes first: stay at `height_m` until `change` is called again."""
        if self.changing:
            self.commanded_m = height_m
            self._began_s = math.nan

    def change(self, tick: Tick) -> bool:
        """One tick of the change that was ordered; True when it has ended, there or elsewhere."""
        wanted_m = self._wanted_m
        if wanted_m is None:
            return True
        height_m = -tick.fused.position_ned_m[2]
        if math.isnan(self._began_s):
            self._began_s = self._seen_s = tick.now_s
            self._sensing.leave_height()
            steady_s = abs(wanted_m - height_m) / self._config.planner.storeys.climb_m_s
            self._limit_s = CHANGE_TIMEOUT_S + steady_s
        away_m = abs(wanted_m - height_m)
        if away_m <= SETTLED_M:
            return self._settle(tick, wanted_m)
        rise = 1 if wanted_m > height_m else -1
        room = self._sensing.room(rise, tick.now_s)
        if room is not None:
            self._seen_s = tick.now_s
        reach_m = 0.0 if room is None else self._reach_m(room)
        self.commanded_m = height_m + rise * min(
            away_m, reach_m, self._config.planner.storeys.climb_m_s
        )
        why = self._why_not(tick, wanted_m, away_m, room)
        if why is None:
            return False
        near = wanted_m == self._storeys.goal_m and away_m <= NEAR_HEIGHT_M
        return self._settle(tick, wanted_m) if near else self._give_up(tick, wanted_m, why)

    def _why_not(self, tick: Tick, wanted_m: float, away_m: float, room: Room | None) -> str | None:
        """What ends the change, or None to go on."""
        side = "above" if wanted_m > -tick.fused.position_ned_m[2] else "below"
        slack_m = NEAR_HEIGHT_M if wanted_m == self._storeys.goal_m else SETTLED_M
        if room is not None and room.ends and away_m - self._reach_m(room) > slack_m:
            return f"something is {room.free_m:.2f} m {side}"
        if tick.now_s - self._seen_s > BLIND_S:
            return f"nothing measures what is {side}"
        if tick.now_s - self._began_s > self._limit_s:
            return f"{wanted_m:.2f} m was not reached in {self._limit_s:.0f} s"
        return None

    def _give_up(self, tick: Tick, wanted_m: float, why: str) -> bool:
        """Back to where the change began; where even that fails, this is a storey of its own."""
        self._barred.append((wanted_m, tick.fused.point))
        if wanted_m != self._came_from_m:
            tick.say("height", f"{why}: back to {self._came_from_m:.2f} m")
            self._wanted_m, self._began_s = self._came_from_m, math.nan
            return False
        tick.say("height", f"{why}: staying here")
        return self._settle(tick, round(-tick.fused.position_ned_m[2], 2))

    def _settle(self, tick: Tick, height_m: float) -> bool:
        self._open_at = tick.fused.point
        self._wanted_m = None
        self.present_m = self.commanded_m = height_m
        self._sensing.enter_height(height_m, tick.fused.point, tick.now_s)
        return True

    def _reach_m(self, room: Room) -> float:
        return max(0.0, room.free_m - self._config.guard.beam_stop_m)

    # ------------------------------------------------------------ which height

    def may_change(self, tick: Tick, height_m: float) -> bool:
        """True when beams and memory allow the whole way up or down to `height_m` from here."""
        now_m, point = -tick.fused.position_ned_m[2], tick.fused.point
        room = self._sensing.room(1 if height_m > now_m else -1, tick.now_s)
        if room is None or (room.ends and abs(height_m - now_m) > self._reach_m(room) + SETTLED_M):
            return False
        if height_m in _known_here(self._barred, point):
            return False
        radius_m = self._config.body.radius_m + SHAFT_MARGIN_M
        return self._sensing.maps.shaft_is_free(
            point, self.present_m, height_m, radius_m, own=False
        )

    @property
    def searching(self) -> bool:
        """True while there is a search that is not decided."""
        return self._search is not None and not self._search.decided

    def hits(self) -> FloatArray:
        """(n, 2) what a path at the present height has to keep clear of."""
        return self._hits_at(self.present_m)

    def ask(
        self, tick: Tick, here: Plan | NoPlan, goal: Point, tolerance_m: float
    ) -> Plan | NoPlan:
        """Begin a search with what was planned at the present height (returned, with its height).

        `ask_on` goes on with the other heights while `searching`.
        """
        question = Question(
            start=tick.fused.point,
            goal=goal,
            tolerance_m=tolerance_m,
            present_m=self.present_m,
            storeys=self._storeys,
            price=self._price,
            gain_m=self._config.planner.storeys.gain_m,
            looked_at_m=_known_here(self._looked, tick.fused.point),
        )
        planner = self._planner if self._guesses else self._wide_planner
        search = Search(planner, question, here, self._hits_at, thorough=not self._guesses)
        self._why_left_out = self._why_stay(tick, goal)
        if self._is_worth_it(here) and not search.would_stay and self._why_left_out is None:
            search.look_at(
                height_m
                for height_m in self._storeys.heights_m()
                if abs(height_m - self.present_m) > SAME_M and self.may_change(tick, height_m)
            )
        self._search = search
        return search.here

    def ask_on(self) -> Way | NoPlan | None:
        """One more height; the answer when that decides the search, else None."""
        search = self._search
        if search is None:
            return None
        search.step()
        return search.result() if search.decided else None

    def told(self, here: NoPlan) -> NoPlan:
        """`here` after `ask`, with why no other height was looked at where one might lead on."""
        if self._why_left_out is None or not self._is_worth_it(here):
            return here
        reason = f"{here.reason} at {self.present_m:.2f} m; others left out: {self._why_left_out}"
        return msgspec.structs.replace(here, reason=reason)

    def looked_round(self, point: Point) -> None:
        """The picture at the present height is complete around `point`."""
        self._looked.append((self.present_m, point))

    def towards(self, way: Way, point: Point) -> float:
        """Order the first change on the way to a storey, and return the height of it."""
        looked_at_m = _known_here(self._looked, point)
        stop_m = self._storeys.stops_m(self.present_m, way.height_m, looked_at_m)[0]
        self.change_to(stop_m)
        return stop_m

    def forget(self, tick: Tick, keep_disc_m: float) -> None:
        """Forget what closes the goal's height, and go back to it; noise may have closed a gap.

        The other heights stay as they were seen, or a flight would search them all again.
        """
        spacing_m = self._config.planner.storeys.spacing_m
        maps, point = self._sensing.maps, tick.fused.point
        self._barred.clear()
        self._looked.clear()
        if not self.at_goals_height:
            if not self.may_change(tick, self.goal_m):
                maps.forget_all(point, keep_disc_m)
                return
            self.change_to(self.goal_m)
        maps.forget_cutting(self.goal_m, spacing_m, point, keep_disc_m)

    def stop_guessing(self) -> bool:
        """Nothing leads on: from now on only what was seen counts. False when it did already."""
        guessed = self._guesses and self._sensing.maps.count > 1
        if guessed:
            self._guesses = False
        return guessed

    @property
    def proving(self) -> bool:
        """True while other heights are flown at only because they are not known to be closed."""
        return not self._guesses and not self.at_goals_height

    def _is_worth_it(self, here: Plan | NoPlan) -> bool:
        """True when other heights are to be looked at.

        Not when the vehicle seems boxed in, or the goal itself blocked: the one is mostly noise,
        the other true at any height.
        """
        use = self._config.planner.storeys.use
        if isinstance(here, NoPlan):
            return use != "never" and here.reason == Failure.CLOSED
        return use == "cheapest" or (use == "closed" and not self.at_goals_height)

    def prove(self, tick: Tick, goal: Point, tolerance_m: float) -> Plan | NoPlan:
        """A plan at the present height for a flight that shows whether it is closed."""
        return self._wide_planner.plan(tick.fused.point, goal, self.hits(), tolerance_m)

    def note_place(self, point: Point) -> None:
        """On the way: remember where there was room to change height."""
        if self.is_open(point):
            self._open_at = point

    def is_open(self, point: Point) -> bool:
        """True where there is room around, as far as is known."""
        return self._has_room(point, OPEN_M, OPEN_IN_FENCE_M)

    def may_land(self, point: Point) -> bool:
        """True where there is room for a descent, whose drift nothing corrects."""
        return self._has_room(point, ROOM_M, 0.0)

    def retreat(self, tick: Tick, here: Plan | NoPlan) -> Plan | None:
        """The way back to room for a change of height, where one is wanted and there is none."""
        point, place = tick.fused.point, self._open_at
        narrow = not self._has_room(point, ROOM_M, ROOM_IN_FENCE_M)
        if not narrow or place is None or not self._is_worth_it(here):
            return None
        late = tick.now_s > self._search_until_s
        if isinstance(here, Plan) or late or self._retreats >= RETREATS_MAX:
            return None
        back = self._planner.plan(point, place, self._sensing.map.hits(), SETTLED_M)
        if isinstance(back, NoPlan):
            return None
        self._retreats += 1
        return msgspec.structs.replace(back, height_m=self.present_m)

    def _has_room(self, point: Point, clearance_m: float, in_fence_m: float) -> bool:
        near_m = self._sensing.map.clearance_m((*point, 0.0), clearance_m)
        inside_m = self._config.guard.fence.inside_distance_m(*point)
        return near_m >= clearance_m and inside_m >= in_fence_m

    def _why_stay(self, tick: Tick, goal: Point) -> str | None:
        """At the goal another height cannot help; in a narrow place, late, or after too many
        changes it must not be tried. None where it may.
        """
        point = tick.fused.point
        if distance(point, goal) <= self._config.mission.goal_tolerance_m:
            return "the goal is here"
        if self.changes >= self._config.planner.storeys.changes_max:
            return f"{self.changes} changes of height are enough"
        if tick.now_s > self._search_until_s:
            return "too little of the mission's time is left"
        if not self._has_room(point, ROOM_M, ROOM_IN_FENCE_M):
            return "no room here to change height"
        return None

    def _hits_at(self, height_m: float) -> FloatArray:
        spacing_m = self._config.planner.storeys.spacing_m
        if self._config.planner.storeys.use == "never":
            spacing_m = 0.0
        maps = self._sensing.maps
        look = maps.guessed if self._guesses and spacing_m > 0.0 else maps.hits_cutting
        return look(height_m, spacing_m)

    def _storeys_about(self, goal_m: float) -> Storeys:
        guard = self._config.guard
        spacing_m = self._config.planner.storeys.spacing_m
        # Rounded like all storeys: heights are compared.
        return Storeys(round(goal_m, 6), spacing_m, guard.altitude_min_m, guard.altitude_max_m)


def _known_here(places: Iterable[tuple[float, Point]], point: Point) -> tuple[float, ...]:
    """The heights noted near `point`."""
    return tuple(height_m for height_m, at in places if distance(point, at) <= HERE_M)
