"""The search for a room that breaks the flight: rooms, judgement, hunts, shrinking."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.sim.scenario import Disc, Scenario, load_scenario
from tools.hunt import campaign, report, shrink
from tools.hunt.genome import LENGTH, decoded, random_vector
from tools.hunt.search import cost, goal_of_hunt, hunt
from tools.hunt.trial import Trial, fly


def trial(name: str = "hunt 0.0", **changes: object) -> Trial:
    values: dict[str, object] = {
        "name": name,
        "vector": (0.5,) * LENGTH,
        "ending": "goal_reached",
        "failure": "",
        "clearance_m": 0.2,
        "length_m": 3.0,
        "optimum_m": 2.0,
        "navigation_s": 30.0,
        "stops": 1,
        "replans": 1,
        "mode": "stop",
        "faults": (),
    }
    return Trial(**(values | changes))  # type: ignore[arg-type]  # one dict for fields of all types


@given(st.lists(st.floats(-1.0, 2.0), min_size=LENGTH, max_size=LENGTH))
@settings(deadline=None, max_examples=60)
def test_every_vector_is_a_room_that_a_flight_may_be_asked_to_fly_in(vector: list[float]) -> None:
    scenario, mode = decoded(vector, "any")
    assert mode in ("stop", "rolling")
    assert scenario.fence.inside_distance_m(*scenario.goal_ne_m) > 0.3
    for obstacle in scenario.obstacles:
        assert obstacle.distance_m(0.0, 0.0) >= 0.35
        assert obstacle.distance_m(*scenario.goal_ne_m) >= 0.35
    assert len(scenario.faults) <= 1


def test_a_number_names_one_room() -> None:
    assert decoded(random_vector(7), "a") == decoded(random_vector(7), "a")
    assert decoded(random_vector(7), "a") != decoded(random_vector(8), "a")


def test_a_vector_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match=f"a room has {LENGTH} numbers"):
        decoded([0.5] * (LENGTH - 1), "short")


def test_a_hunt_flies_as_many_rooms_as_asked_and_gets_worse() -> None:
    """On a landscape without flights: clearance grows with the distance from one corner."""

    def pretend(vector: tuple[float, ...], name: str) -> Trial:
        return trial(name, vector=vector, clearance_m=sum(vector) / LENGTH)

    trials = list(hunt(0, 120, pretend))
    assert goal_of_hunt(0) == "clearance"
    assert [t.name for t in trials] == [f"hunt 0.{n}" for n in range(len(trials))]
    assert 120 <= len(trials) < 136
    first = min(t.clearance_m for t in trials[:48])
    assert min(t.clearance_m for t in trials) < first - 0.02
    assert trials == list(hunt(0, 120, pretend))


def test_what_breaks_a_promise_costs_least() -> None:
    fine = trial()
    touched = trial(failure="collision", clearance_m=0.14)
    late = trial(failure="no verdict", ending="budget", navigation_s=20.0)
    wrong = trial(failure="wrong verdict", ending="unreachable")
    raised = trial(failure="raised", ending="raised")
    assert cost(touched, "clearance") < cost(trial(clearance_m=0.14), "clearance")
    assert cost(late, "stall") < cost(fine, "stall")
    assert cost(wrong, "detour") < cost(fine, "detour") == -1.5
    assert all(cost(raised, goal) == -100.0 for goal in ("clearance", "stall", "detour"))


def test_a_flight_is_judged() -> None:
    room, _ = decoded(random_vector(3), "3")
    flight = fly(room, "stop", "3")
    assert flight.failure == ""
    assert flight.ending == "goal_reached"
    assert 1.0 <= flight.detour < 3.0
    assert fly(room, "stop", "3") == flight


def test_a_body_that_does_not_fit_collides_and_the_room_shrinks_to_what_it_touches() -> None:
    """The simulated body is made larger than the configured one: it has to touch the pillar."""
    far = [Disc(centre_ne_m=(3.0, -2.0), radius_m=0.2)]
    scenario = Scenario.model_validate(
        {
            "name": "too big",
            "obstacles": [*far, Disc(centre_ne_m=(1.0301, 0.7702), radius_m=0.2)],
            "goal_ne_m": (2.0, 1.5),
            "beams": {"sigma_m": 0.0, "sigma_fraction": 0.0, "dropout_probability": 0.0},
            "vehicle": {"body_radius_m": 0.4},
            "faults": ({"kind": "gnss_loss", "after": "liftoff"},),
        }
    )
    assert fly(scenario, "rolling", "too big").failure == "collision"
    small = shrink.shrunk(scenario, shrink.fails_as("collision", "rolling"))
    assert len(small.obstacles) == 1
    assert small.faults == ()
    assert small.beams.sigma_m == small.estimator.velocity_sigma_m_s == 0.0
    (pillar,) = small.obstacles
    assert isinstance(pillar, Disc)
    assert pillar.centre_ne_m == (1.0, 0.8)


def test_what_does_not_fail_cannot_be_shrunk() -> None:
    with pytest.raises(ValueError, match="nothing to shrink"):
        shrink.shrunk(Scenario(name="fine"), lambda _: False)


def test_a_room_is_kept_as_a_scenario_document(tmp_path: Path) -> None:
    for number in range(12):
        scenario, _ = decoded(random_vector(number), f"room {number}")
        shrink.save(scenario, tmp_path / "room.yaml", "found somewhere")
        assert load_scenario(str(tmp_path / "room.yaml")) == scenario


def test_a_campaign_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert campaign.blocks(200, 0, 13500) == ["random-0013500", "random-0013600"]
    assert campaign.blocks(300, 2) == [
        "random-0000000",
        "hunt-00000",
        "random-0000100",
        "hunt-00001",
        "random-0000200",
    ]
    monkeypatch.setattr(campaign, "BLOCK", 2)
    campaign.fly_block("random-0000000", tmp_path)
    before = (tmp_path / "random-0000000.jsonl").stat().st_mtime_ns
    told: list[str] = []
    trials = list(campaign.run(tmp_path, 2, 0, 1, told.append))
    assert [t.name for t in trials] == ["random 0", "random 1"]
    assert told == ["1 of 1 blocks are there already"]
    assert (tmp_path / "random-0000000.jsonl").stat().st_mtime_ns == before


def test_the_report_counts_and_names_what_failed() -> None:
    trials = [
        trial("random 1"),
        trial("random 2", ending="unreachable", optimum_m=None),
        trial("hunt 0.5", failure="collision", clearance_m=0.1, faults=("beam_bias",)),
    ]
    text = report.section(trials, "abc")
    assert "| random | 2 | 1 | 1 | 0 | 0 | 0 | 0 | 0 | 0.200 | 1.50 | 30 |" in text
    assert "| all | 3 | 2 | 1 | 0 | 1 | 0 | 0 | 0 | 0.100 | 1.50 | 30 |" in text
    assert "`hunt 0.5`: collision (stop, beam_bias), clearance 0.100 m" in text


def test_the_worst_come_from_different_hunts() -> None:
    trials = [trial(f"hunt 0.{n}", clearance_m=0.1 + 0.01 * n) for n in range(5)]
    trials += [trial("hunt 3.1", clearance_m=0.19), trial("random 9", navigation_s=90.0)]
    names = [t.name for t in report.worst(trials)]
    assert names[:2] == ["hunt 0.0", "hunt 3.1"]
    assert len({name.split(".")[0] for name in names}) == len(names)
