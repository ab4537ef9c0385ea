"""The harness flies every planner alike: same take-off, turning, arrival, ladder and landing."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.mission.guarded import Guarded
from autonomy.model import Command, Ending, MissionState
from autonomy.simulation import SimulatedFlight, Simulation, goal_of
from hal.config import Fence
from hal.frames import wrap_pi
from hal.sim.scenario import Disc, Scenario
from tests.unit.tools.bench.rivals.hand_made import CRAFT
from tools.bench.rivals import NAMES, config_of, flyer
from tools.bench.rivals.harness import RivalPilot, Unguarded, fence_hits
from tools.bench.rivals.interface import Answer, GivesUp, View
from tools.bench.rivals.roster import UNGUARDED

POST = Scenario(
    name="a post",
    obstacles=(Disc(centre_ne_m=(0.75, 0.1), radius_m=0.06),),
    goal_ne_m=(1.5, 0.0),
    fence=Fence.rectangle((-1.0, 2.5), (-1.5, 1.5)),
)


class Says:
    """A rival that always answers the same."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        self.views: list[View] = []

    def decide(self, view: View) -> Answer:
        self.views.append(view)
        return self.answer


def flown(name: str, scenario: Scenario = POST, seed: int = 0) -> SimulatedFlight:
    config = config_of(name, scenario)
    route = (goal_of(scenario, config),)
    made = flyer(name, config, route)
    return Simulation(scenario, config, route, seed, flyer=made).run(keep_commands=True)


def flown_by(
    says: Says, *, guarded: bool = True, limit_s: float = 600.0, scenario: Scenario = POST
) -> SimulatedFlight:
    config = config_of("bug2", scenario)
    mission = config.mission.model_copy(update={"time_limit_s": limit_s})
    config = config.model_copy(update={"mission": mission})
    route = (goal_of(scenario, config),)
    pilot = RivalPilot(config, route, says)
    made = Guarded(pilot, config) if guarded else Unguarded(pilot)
    return Simulation(scenario, config, route, 0, flyer=made).run(keep_commands=True)


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_flies_past_a_post_and_stops_at_the_goal(name: str) -> None:
    flight = flown(name)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert flight.final_error_m < 0.2
    assert flight.max_speed_m_s < 0.3
    if name != "t3drm-printed":
        assert not flight.collided
        # Turning all the while: round once in six seconds.
        yaws = [c.decision.fused.yaw_rad for c in flight.commands if c.decision.fused is not None]
        assert max(yaws) - min(yaws) > 6.0


@pytest.mark.parametrize("name", ["astar", "tangentbug/unguarded"])
def test_a_seed_gives_the_same_flight_bit_for_bit(name: str) -> None:
    assert flown(name, seed=4).commands == flown(name, seed=4).commands


def test_as_printed_the_nose_points_where_it_flies_and_nothing_is_swept() -> None:
    sideways = POST.model_copy(update={"obstacles": (), "goal_ne_m": (0.0, 1.3)})
    flight = flown("t3drm-printed", sideways)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    cruising = [c.decision for c in flight.commands if c.decision.state is MissionState.CRUISE]
    last = cruising[-20].fused
    assert last is not None
    assert abs(wrap_pi(last.yaw_rad - math.pi / 2.0)) < 0.2


def limits(commands: list[Command]) -> set[str]:
    return {limit for command in commands for limit in command.guard.limits}


def test_the_guard_sees_every_setpoint_and_unguarded_it_sees_none() -> None:
    onward = Says((0.2, 0.0))
    guarded, bare = flown_by(onward, limit_s=25.0), flown_by(onward, guarded=False, limit_s=25.0)
    assert limits(guarded.commands)
    assert not limits(bare.commands)
    for command in bare.commands:
        assert command.setpoint is command.decision.setpoint
        assert (command.wire_setpoint is None) == (command.setpoint is None)


def test_a_rivals_name_with_the_suffix_leaves_out_the_guard() -> None:
    config = config_of("dwa", POST)
    route = (goal_of(POST, config),)
    assert isinstance(flyer("dwa", config, route), Guarded)
    assert isinstance(flyer("dwa" + UNGUARDED, config, route), Unguarded)


@pytest.mark.parametrize("name", ["bug3", "t3drm-stop/unguarded", "", "/unguarded"])
def test_a_name_that_nobody_has_is_refused_with_those_that_there_are(name: str) -> None:
    with pytest.raises(ValueError, match=r"no planner is called .* use one of t3drm-rolling"):
        config_of(name, POST)


def test_a_route_of_two_goals_is_refused() -> None:
    config = config_of("bug2", POST)
    with pytest.raises(ValueError, match="one goal, not 2"):
        flyer("bug2", config, ((1.0, 0.0, -1.0), (2.0, 0.0, -1.0)))


def test_what_is_proved_ends_the_flight_and_a_doubt_climbs_the_ladder_first() -> None:
    proved = flown_by(Says(GivesUp("it is so", certain=True)))
    doubted = flown_by(Says(GivesUp("it seems so")))
    for flight in (proved, doubted):
        assert flight.outcome.ending is Ending.UNREACHABLE
    looks = [flight.navigation_time_s for flight in (proved, doubted)]
    assert looks[1] > looks[0] + 2.0 * (Config().mission.replan.attempts - 1)


def test_who_stays_where_it_is_lands_when_the_time_is_used_up() -> None:
    flight = flown_by(Says((0.0, 0.0)), limit_s=20.0)
    assert flight.outcome.ending is Ending.BUDGET
    assert flight.path_length_m < 1.0


def test_a_rival_is_shown_hits_the_fence_and_what_is_near() -> None:
    says = Says((0.05, 0.0))
    flown_by(says, limit_s=25.0)
    view = says.views[-1]
    post = np.hypot(view.hits[:, 0] - 0.75, view.hits[:, 1] - 0.1)
    assert (np.abs(post - 0.06) < 0.06).any()
    away = np.hypot(view.near[:, 0] - view.point[0], view.near[:, 1] - view.point[1])
    assert away.max() <= 1.5
    assert 0 < len(view.near) < len(view.hits)


def test_who_keeps_out_of_the_fences_hits_stays_inside_the_fence() -> None:
    config = config_of("bug2", POST)
    fence = config.guard.fence
    hits = fence_hits(config, CRAFT.keep_out_m)
    inside = [fence.inside_distance_m(*map(float, hit)) for hit in hits]
    assert max(inside) <= -CRAFT.keep_out_m + 1e-9
    corners = [(2.5, e) for e in np.linspace(-1.5, 1.5, 31)]
    reach = CRAFT.keep_out_m + 0.005

    def nearest(point: Point) -> float:
        return float(np.hypot(hits[:, 0] - point[0], hits[:, 1] - point[1]).min())

    assert all(CRAFT.keep_out_m - 1e-9 <= nearest(point) < reach for point in corners)


def test_who_asks_for_the_pilot_where_a_rival_flies_is_told_who_flies() -> None:
    config = config_of("dwa", POST)
    route = (goal_of(POST, config),)
    simulation = Simulation(POST, config, route, flyer=flyer("dwa/unguarded", config, route))
    with pytest.raises(TypeError, match="Unguarded"):
        _ = simulation.guarded


def test_only_the_paper_stops_and_flies_without_what_it_does_not_have() -> None:
    assert config_of("t3drm-rolling", POST).mission.replan.mode == "rolling"
    assert config_of("t3drm-stop", POST).mission.replan.mode == "stop"
    printed = config_of("t3drm-printed", POST)
    assert printed.mission.replan.mode == "stop"
    assert printed.planner.storeys.use == "never"
    assert not printed.movers.watch
    assert config_of("t3drm-stop", POST).movers.watch


WARM = """
from numba.core.dispatcher import Dispatcher
from tests.unit.tools.bench.rivals.test_harness import flown
from tools.bench.rivals import kernels, warm_up
from tools.bench.rivals.roster import RIVALS

def versions():
    every = [k for k in vars(kernels).values() if isinstance(k, Dispatcher)]
    return {k.py_func.__name__: list(k.signatures) for k in every}

warm_up()
before = versions()
for name in RIVALS:
    flown(name)
print("called in the air only:", [name for name in before if before[name] != versions()[name]])
"""


def test_nothing_of_the_rivals_is_compiled_once_they_are_warm() -> None:
    """In a process of its own, as others have called the kernels here."""
    told = subprocess.run(
        [sys.executable, "-c", WARM], capture_output=True, text=True, check=True, cwd=Path.cwd()
    )
    assert told.stdout.strip() == "called in the air only: []"
