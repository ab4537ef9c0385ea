"""Changing height in place: as far as a beam shows room, and no farther."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import Config
from autonomy.mission.heights import (
    BLIND_S,
    NEAR_HEIGHT_M,
    RETREATS_MAX,
    SEARCH_SHARE,
    SETTLED_M,
    Heights,
)
from autonomy.mission.sensing import Sensing
from autonomy.mission.tick import Tick
from autonomy.model import Inputs, NoPlan, Plan
from autonomy.perception.projection import Ray, RayKind
from autonomy.t3drm.planner import Planner
from hal.readings import (
    Attitude,
    FlightMode,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleStatus,
)

CONFIG = Config()
DT_S = 0.05
STATUS = VehicleStatus(
    stamp_s=0.0,
    mode=FlightMode.OFFBOARD,
    landed=LandedState.IN_AIR,
    armed=True,
    armable=True,
    link_age_s=0.0,
)
GOAL = (2.0, 0.0)


@dataclass
class Lift:
    """A vehicle between floor and ceiling that flies at the height it is told, a metre from a wall
    to the north that reaches from `wall_m[0]` to `wall_m[1]`."""

    height_m: float = 1.0
    floor_m: float = 0.0
    ceiling_m: float = 2.5
    silent: tuple[str, ...] = ()
    config: Config = CONFIG
    now_s: float = 0.0
    tick: Tick | None = None
    lowest_m: float = math.inf
    highest_m: float = -math.inf
    climb_m_s: float = 0.0
    said: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.sensing = Sensing(self.config)
        planner = Planner(self.config.planner, 0.15, self.config.guard.fence)
        self.heights = Heights(self.config, self.sensing, planner)
        self.sensing.fix_home()
        self.step()
        self.sensing.home_ned_m = (0.0, 0.0, 0.0)
        self.step()

    def beam(self, name: str, distance_m: float) -> RangeReading:
        silent = name in self.silent
        status, value = RangeStatus.VALID, distance_m
        if distance_m > 1.0:
            status, value = RangeStatus.OUT_OF_RANGE, 1.0
        if silent:
            status, value = RangeStatus.NO_SIGNAL, 0.0
        return RangeReading(
            beam=name,
            stamp_s=self.now_s,
            range_m=value,
            status=status,
            variance_m2=1e-4,
            min_m=0.02,
            max_m=1.0,
        )

    def step(self) -> Tick:
        self.now_s += DT_S
        inputs = Inputs(
            now_s=self.now_s,
            ranges=(
                self.beam("up", self.ceiling_m - self.height_m),
                self.beam("down", self.height_m - self.floor_m),
            ),
            local_position=LocalPosition(
                self.now_s, (0.0, 0.0, -self.height_m), (0.0, 0.0, -self.climb_m_s)
            ),
            attitude=Attitude(self.now_s, 0.0, 0.0, 0.0, 0.0),
            gnss=None,
            status=STATUS,
        )
        self.tick = Tick(inputs, self.sensing.step(inputs), DT_S)
        return self.tick

    def follow(self) -> None:
        """One tick of flight towards the commanded height, at PX4's gain of 1 per second."""
        self.climb_m_s = self.heights.commanded_m - self.height_m
        self.height_m += DT_S * self.climb_m_s

    def change(self, limit_s: float = 60.0) -> None:
        """Until the change has ended."""
        end_s = self.now_s + limit_s
        while self.now_s < end_s:
            tick = self.step()
            ended = self.heights.change(tick)
            self.said += [event.why for event in tick.events]
            self.lowest_m = min(self.lowest_m, self.height_m)
            self.highest_m = max(self.highest_m, self.height_m)
            if ended:
                return
            self.follow()
        raise AssertionError("the change of height did not end")


def begun(**keys: object) -> Lift:
    lift = Lift(**keys)  # type: ignore[arg-type]  # the keys of Lift
    lift.heights.begin(lift.now_s, lift.height_m, 1.0)
    return lift


def test_a_flight_begins_at_the_goals_height_when_it_is_near_enough() -> None:
    lift = begun(height_m=1.1)
    assert lift.heights.at_goals_height
    assert lift.heights.commanded_m == 1.0
    assert lift.heights.changes == 0


def test_the_first_climb_to_the_goals_height_is_made_in_place() -> None:
    lift = begun(height_m=0.4)
    begun_as = (lift.heights.changing, lift.heights.at_goals_height)
    lift.change()
    assert begun_as == (True, False)
    assert lift.heights.at_goals_height
    assert lift.height_m == pytest.approx(1.0, abs=2.0 * SETTLED_M)


def test_a_goal_many_metres_higher_is_climbed_to_however_long_that_takes() -> None:
    high = Config.model_validate({"guard": {"altitude_max_m": 9.0}})
    lift = begun(ceiling_m=10.0, config=high)
    assert lift.heights.aim(1.0, 8.0)
    lift.change()
    assert lift.said == []
    assert lift.heights.at_goals_height


def test_a_climb_that_gets_nowhere_is_given_up() -> None:
    lift = begun()
    lift.heights.change_to(1.6)
    began_s = lift.now_s
    while not lift.said:
        tick = lift.step()
        lift.heights.change(tick)
        lift.said += [event.why for event in tick.events]
        assert lift.now_s - began_s < 18.0
    assert lift.said == ["1.60 m was not reached in 17 s: back to 1.00 m"]


def test_a_change_ends_at_the_storey_with_its_own_map() -> None:
    lift = begun()
    left = lift.sensing.map
    lift.heights.change_to(1.22)
    assert lift.heights.flown_at_m == 1.22
    lift.change()
    assert lift.heights.present_m == lift.heights.commanded_m == 1.22
    assert abs(lift.height_m - 1.22) <= SETTLED_M
    assert lift.sensing.map is not left
    assert lift.said == []


@given(
    ceiling=st.floats(1.1, 2.3),
    floor=st.floats(0.0, 0.9),
    wanted=st.sampled_from((0.34, 0.78, 1.44)),
)
@settings(deadline=None, max_examples=40)
def test_no_change_of_height_comes_nearer_to_a_surface_than_the_beams_stop(
    ceiling: float, floor: float, wanted: float
) -> None:
    lift = begun(ceiling_m=ceiling, floor_m=floor)
    room_above_m, room_below_m = ceiling - 1.0, 1.0 - floor
    lift.heights.change_to(wanted)
    lift.change()
    stop_m = CONFIG.guard.beam_stop_m - 0.01
    assert lift.highest_m <= max(1.0, ceiling - min(stop_m, room_above_m))
    assert lift.lowest_m >= min(1.0, floor + min(stop_m, room_below_m))
    assert lift.heights.present_m in (wanted, 1.0)
    if lift.heights.present_m == 1.0:
        assert lift.said[0].startswith("something is ")
        assert lift.said[0].endswith("back to 1.00 m")
        assert not lift.heights.may_change(lift.step(), wanted)


@pytest.mark.parametrize(("beam", "wanted"), [("up", 1.22), ("down", 0.78)])
def test_without_the_beam_that_looks_there_the_height_is_not_changed(
    beam: str, wanted: float
) -> None:
    lift = begun(silent=(beam,))
    assert not lift.heights.may_change(lift.step(), wanted)
    lift.heights.change_to(wanted)
    lift.change()
    assert lift.heights.present_m == 1.0
    assert max(lift.highest_m - 1.0, 1.0 - lift.lowest_m) < 0.01
    assert lift.said == [
        f"nothing measures what is {'above' if beam == 'up' else 'below'}: back to 1.00 m"
    ]


def test_a_height_that_was_not_reached_is_not_tried_again_here_until_all_is_forgotten() -> None:
    lift = begun(silent=("up",))
    lift.heights.change_to(1.22)
    lift.change()
    lift.silent = ()
    lift.step()
    assert not lift.heights.may_change(lift.step(), 1.22)
    assert lift.heights.may_change(lift.step(), 1.44)
    lift.heights.forget(lift.step(), 0.14)
    assert lift.heights.may_change(lift.step(), 1.22)


def test_a_beam_lost_on_the_way_stops_the_climb_and_a_moments_loss_only_delays_it() -> None:
    lift = begun()
    lift.heights.change_to(1.88)
    for _ in range(20):
        assert not lift.heights.change(lift.step())
        lift.follow()
    lift.silent = ("up",)
    for _ in range(10):  # what was measured counts until it is stale
        lift.heights.change(lift.step())
    tick = lift.step()
    lift.heights.change(tick)
    assert lift.heights.commanded_m == pytest.approx(-tick.fused.position_ned_m[2])
    lift.silent = ()
    lift.change()
    assert lift.heights.present_m == 1.88
    assert BLIND_S > 0.5


def test_a_climb_that_is_interrupted_stays_where_it_is_and_goes_on_later() -> None:
    lift = begun()
    lift.heights.change_to(1.44)
    for _ in range(10):
        lift.heights.change(lift.step())
        lift.follow()
    lift.heights.pause(lift.height_m)
    assert lift.heights.commanded_m == lift.height_m
    assert lift.heights.changing
    lift.change()
    assert lift.heights.present_m == 1.44


def test_where_even_the_way_back_fails_the_vehicle_stays_at_a_storey_of_its_own() -> None:
    lift = begun()
    lift.heights.change_to(1.44)
    for _ in range(16):
        lift.heights.change(lift.step())
        lift.follow()
    lift.silent = ("up", "down")
    lift.change()
    assert not lift.heights.changing
    assert lift.heights.present_m == round(lift.height_m, 2)
    assert 1.05 < lift.heights.present_m < 1.4


def test_under_a_ceiling_a_goals_height_counts_as_reached_when_it_is_near() -> None:
    lift = begun(height_m=1.0, ceiling_m=1.66)
    assert lift.heights.aim(1.0, 1.6)
    lift.change()
    assert lift.heights.at_goals_height
    assert 1.6 - lift.height_m <= NEAR_HEIGHT_M
    assert lift.height_m <= 1.66 - CONFIG.guard.beam_stop_m + 0.02


def test_a_next_goal_nearly_as_high_is_flown_to_without_a_stop() -> None:
    lift = begun()
    before = lift.sensing.map
    assert not lift.heights.aim(1.0, 1.1)
    assert lift.heights.commanded_m == 1.1
    assert lift.sensing.map is before


def closed_here(lift: Lift) -> NoPlan:
    wall = np.stack((np.full(600, 1.0), np.linspace(-11.0, 11.0, 600)), axis=1)
    found = Planner(lift.config.planner, 0.15, lift.config.guard.fence).plan((0.0, 0.0), GOAL, wall)
    assert isinstance(found, NoPlan)
    return found


def test_room_is_measured_from_the_centre_wherever_the_sensor_sits() -> None:
    mounts = [
        mount.model_copy(update={"down_m": {"up": -0.03, "down": 0.04}.get(mount.name, 0.0)})
        for mount in CONFIG.beams.mounts
    ]
    beams = CONFIG.beams.model_copy(update={"mounts": tuple(mounts)})
    lift = begun(config=CONFIG.model_copy(update={"beams": beams}), ceiling_m=1.8, floor_m=0.5)
    above, below = lift.sensing.room(1, lift.now_s), lift.sensing.room(-1, lift.now_s)
    assert above is not None
    assert below is not None
    assert above.free_m == pytest.approx(0.83)
    assert below.free_m == pytest.approx(0.54)


def test_never_means_never() -> None:
    lift = begun(config=Config.model_validate({"planner": {"storeys": {"use": "never"}}}))
    told = closed_here(lift)
    assert lift.heights.ask(lift.step(), told, GOAL, 0.09) is told
    assert not lift.heights.searching
    lift.heights.changes = CONFIG.planner.storeys.changes_max
    lift.heights.ask(lift.step(), told, GOAL, 0.09)
    assert lift.heights.told(told) is told


def test_where_beams_allow_other_heights_nothing_was_left_out() -> None:
    lift = begun()
    told = closed_here(lift)
    lift.heights.ask(lift.step(), told, GOAL, 0.09)
    assert lift.heights.searching
    assert lift.heights.told(told) is told


@pytest.mark.parametrize(("silent", "count"), [((), 7), (("up",), 3), (("up", "down"), 0)])
def test_only_heights_that_a_beam_allows_are_looked_at(silent: tuple[str, ...], count: int) -> None:
    lift = begun(silent=silent)
    lift.heights.ask(lift.step(), closed_here(lift), GOAL, 0.09)
    assert lift.heights.searching == (count > 0)
    if count:
        found = lift.heights.ask_on()
        assert found is None or not isinstance(found, NoPlan)


def test_a_ceiling_that_is_seen_ends_the_storeys() -> None:
    lift = begun(ceiling_m=1.7)
    tick = lift.step()
    allowed = [h for h in (0.34, 0.78, 1.22, 1.44, 1.66) if lift.heights.may_change(tick, h)]
    assert allowed == [0.34, 0.78, 1.22, 1.44]


def test_at_the_goal_or_after_too_many_changes_no_other_height_is_looked_at() -> None:
    lift = begun()
    told = closed_here(lift)
    lift.heights.ask(lift.step(), told, (0.1, 0.0), 0.09)
    assert not lift.heights.searching
    lift.heights.changes = CONFIG.planner.storeys.changes_max
    lift.heights.ask(lift.step(), told, GOAL, 0.09)
    assert not lift.heights.searching
    assert lift.heights.told(told).reason.endswith(
        "at 1.00 m; others left out: 40 changes of height are enough"
    )


def beside_a_wall(lift: Lift) -> None:
    """A hit 0.25 m east of where the vehicle is."""
    ray = Ray(lift.now_s, 0, RayKind.HIT, (0.0, 0.0, 0.0), 0.5 * math.pi, 0.0, 0.25, (0.0, 0.0))
    lift.sensing.map.update(lift.now_s, (ray,))


def test_in_a_narrow_place_no_height_is_looked_at_but_the_way_back_to_room() -> None:
    lift = begun()
    told = closed_here(lift)
    lift.heights.note_place((-0.8, 0.0))
    assert lift.heights.retreat(lift.step(), told) is None  # there is room here
    beside_a_wall(lift)
    lift.heights.note_place((0.0, 0.1))  # none here
    lift.heights.ask(lift.step(), told, GOAL, 0.09)
    assert not lift.heights.searching
    assert lift.heights.told(told).reason.endswith("others left out: no room here to change height")
    back = lift.heights.retreat(lift.step(), told)
    assert back is not None
    assert back.points[-1] == (-0.8, 0.0)
    assert back.height_m == 1.0
    assert lift.heights.retreat(lift.step(), open_here()) is None


@pytest.mark.parametrize(("proof_m", "clearance_m"), [(0.12, 0.12), (0.01, 0.06)])
def test_a_proof_is_flown_at_its_own_clearance_and_never_below_the_hard_one(
    proof_m: float, clearance_m: float
) -> None:
    keys = {"planner": {"storeys": {"proof_clearance_m": proof_m}}}
    lift = begun(config=Config.model_validate(keys))
    plan = lift.heights.prove(lift.step(), GOAL, 0.09)
    assert isinstance(plan, Plan)
    assert plan.keep_out_m == pytest.approx(0.15 + clearance_m)


def test_a_place_at_the_fence_is_a_narrow_one() -> None:
    lift = begun()
    lift.heights.note_place((-9.9, 0.0))
    beside_a_wall(lift)
    assert lift.heights.retreat(lift.step(), closed_here(lift)) is None


def test_late_in_a_mission_no_other_height_is_looked_at() -> None:
    lift = begun()
    told = closed_here(lift)
    lift.heights.note_place((-0.8, 0.0))
    lift.now_s += SEARCH_SHARE * CONFIG.mission.time_limit_s
    lift.step()
    lift.heights.ask(lift.step(), told, GOAL, 0.09)
    assert not lift.heights.searching
    assert lift.heights.told(told).reason.endswith("too little of the mission's time is left")
    beside_a_wall(lift)
    assert lift.heights.retreat(lift.step(), told) is None


def test_a_next_goal_is_flown_to_with_guesses_and_retreats_again() -> None:
    lift = begun()
    lift.heights.change_to(1.22)
    lift.change()
    stopped = [lift.heights.stop_guessing(), lift.heights.stop_guessing()]
    proves = [lift.heights.proving]
    assert not lift.heights.aim(1.22, 1.22)
    lift.heights.change_to(1.44)
    lift.change()
    assert not lift.heights.at_goals_height
    proves.append(lift.heights.proving)
    stopped.append(lift.heights.stop_guessing())
    assert stopped == [True, False, True]
    assert proves == [True, False]


def test_retreats_are_counted() -> None:
    lift = begun()
    lift.heights.note_place((-0.8, 0.0))
    beside_a_wall(lift)
    told = closed_here(lift)
    backs = [lift.heights.retreat(lift.step(), told) for _ in range(RETREATS_MAX + 1)]
    assert [back is not None for back in backs] == [True] * RETREATS_MAX + [False]
    lift.heights.aim(1.0, 1.0)
    assert lift.heights.retreat(lift.step(), told) is not None


def test_an_open_way_at_the_goals_height_ends_the_search_unless_cheapest_is_wanted() -> None:
    lift = begun()
    free = lift.heights.ask(lift.step(), open_here(), GOAL, 0.09)
    assert isinstance(free, Plan)
    assert free.height_m == 1.0
    assert not lift.heights.searching


def open_here() -> Plan:
    found = Planner(CONFIG.planner, 0.15, CONFIG.guard.fence).plan(
        (0.0, 0.0), GOAL, np.empty((0, 2))
    )
    assert isinstance(found, Plan)
    return found
