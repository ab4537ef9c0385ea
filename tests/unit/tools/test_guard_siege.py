"""The guard under siege: Hypothesis makes the moves of `python -m tools.guard_siege`."""

import math

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from hal.config import GuardConfig
from hal.setpoints import Setpoint
from hal.vehicle.guard import GuardVerdict, Sight
from tools.guard_siege import siege as under
from tools.guard_siege.driver import Tally, besiege, run
from tools.guard_siege.siege import Ask, Siege, Stage, Violation
from tools.guard_siege.vehicle import Make

metres = st.floats(-1.6, 1.6)
angles = st.floats(-math.pi, math.pi)
vectors = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
posts = st.lists(st.tuples(metres, metres, st.sampled_from([0.0, 0.1])), max_size=6).map(tuple)
borders = st.lists(
    st.tuples(angles, st.floats(0.2, 1.5)).map(lambda b: (math.cos(b[0]), math.sin(b[0]), b[1])),
    max_size=2,
).map(tuple)
makes = st.builds(
    Make,
    link_s=st.floats(0.0, 0.1),
    dead_s=st.floats(0.0, 0.4),
    braking_m_s2=st.floats(0.5, 3.0),
    gain_per_s=st.just(0.95),
)
ages = st.sampled_from([0.0, 0.1, 0.3])
stages = st.builds(
    Stage,
    fence=st.integers(0, 2),
    posts=posts,
    borders=borders,
    ceiling_m=st.sampled_from([1.3, 1.6, math.inf]),
    sigma_m=st.sampled_from([0.0, 0.01, 0.02, 0.08]),
    make=makes,
    yaw_rad=angles,
    position_age_s=ages,
    beams_age_s=ages,
)


class GuardUnderSiege(RuleBasedStateMachine):
    """Every tick is judged by the siege itself."""

    siege: Siege

    @initialize(stage=stages)
    def begin(self, stage: Stage) -> None:
        self.siege = Siege(stage)

    @rule(
        velocity=vectors, turn=st.floats(-4.0, 4.0), ticks=st.integers(1, 30), beams=st.booleans()
    )
    def push(
        self, velocity: tuple[float, float, float], turn: float, ticks: int, beams: bool
    ) -> None:  # Hypothesis names its arguments
        for _ in range(ticks):
            self.siege.tick(Ask(velocity, turn_rad=turn), beams=beams)

    @rule(offset=vectors, velocity=vectors, ticks=st.integers(1, 20))
    def pull(
        self, offset: tuple[float, float, float], velocity: tuple[float, float, float], ticks: int
    ) -> None:
        for _ in range(ticks):
            self.siege.tick(Ask(velocity, offset))

    @precondition(lambda self: self.siege.world.posts)
    @rule(which=st.integers(0, 5), aside=st.floats(-1.5, 1.5), ticks=st.integers(1, 60))
    def hunt(self, which: int, aside: float, ticks: int) -> None:
        posts = self.siege.world.posts
        north, east, _ = posts[which % len(posts)]
        for _ in range(ticks):
            here = self.siege.vehicle.position
            at = math.atan2(east - here[1], north - here[0]) + aside
            self.siege.tick(Ask((0.3 * math.cos(at), 0.3 * math.sin(at), 0.0), turn_rad=0.05))

    @rule(age_s=st.floats(-1.0, 1.0), velocity=vectors)
    def come_late(self, age_s: float, velocity: tuple[float, float, float]) -> None:
        self.siege.tick(Ask(velocity, age_s=age_s))

    @rule(ticks=st.integers(1, 12))
    def repeat(self, ticks: int) -> None:
        for _ in range(ticks):
            self.siege.tick(Ask(again=True))

    @rule(tick_s=st.sampled_from([0.025, 0.05, 0.075]), ok=st.booleans())
    def falter(self, *, tick_s: float, ok: bool) -> None:
        self.siege.tick(Ask(), tick_s=tick_s, ok=ok)

    @rule(north=st.floats(-1.0, 1.0), east=st.floats(-1.0, 1.0))
    def mislead(self, north: float, east: float) -> None:
        self.siege.mislead(north, east)

    @rule(part=st.floats(0.0, 1.0), velocity=vectors, ticks=st.integers(1, 10))
    def see_newer(self, part: float, velocity: tuple[float, float, float], ticks: int) -> None:
        for _ in range(ticks):
            self.siege.tick(Ask(velocity), age=part)

    @rule(which=st.integers(0, 1), further_m=st.floats(0.0, 0.4))
    def reveal(self, which: int, further_m: float) -> None:
        self.siege.reveal(which, further_m)

    @rule()
    def die(self) -> None:
        self.siege.kill()


TestGuardUnderSiege = GuardUnderSiege.TestCase
TestGuardUnderSiege.settings = settings(
    deadline=None, max_examples=40, stateful_step_count=15, derandomize=True
)


def test_the_driver_finds_nothing_and_tells_what_it_did() -> None:
    tally = run(0, 3000)
    assert tally.violations == []
    assert tally.steps == 3000
    assert tally.kills > 20
    assert {"speed", "acceleration", "yaw_rate", "free_space", "fence"} <= set(tally.limits)


@pytest.mark.parametrize("number", [576, 672, 2343])
def test_sieges_that_were_lost_once_are_held(number: int) -> None:
    besiege(np.random.default_rng((0, number)), Tally(), 1000, late=False)


def test_the_same_seed_is_the_same_siege() -> None:
    assert run(7, 600).limits == run(7, 600).limits


@pytest.mark.parametrize(
    ("weaker", "stage", "sentence"),
    [
        ({"speed_max_m_s": 0.4}, Stage(), None),
        (
            {"reaction_s": 0.0, "blind_s": 0.0, "braking_m_s2": 9.0, "beam_stop_m": 0.01},
            Stage(posts=((0.8, 0.0, 0.1),)),
            "touches a post",
        ),
        (
            {"reaction_s": 0.0, "blind_s": 0.0, "braking_m_s2": 9.0},
            Stage(borders=((1.0, 0.0, 0.5),)),
            "was not seen",
        ),
        (
            {"reaction_s": 0.0, "blind_s": 0.0, "braking_m_s2": 9.0},
            Stage(fence=1),
            "the fence was left",
        ),
        ({"blind_s": 0.0}, Stage(fence=1), "the fence was left"),
    ],
)
def test_the_oracle_notices_a_guard_with_weaker_numbers(
    weaker: dict[str, float],
    stage: Stage,
    sentence: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(under, "GuardConfig", lambda **given: GuardConfig(**(given | weaker)))
    siege = Siege(stage)

    def attack() -> None:
        for tick in range(200):
            siege.tick(Ask((0.3, 0.001 * (tick % 2), 0.0)))
            siege.kill()

    if sentence is None:
        attack()
        return
    with pytest.raises(Violation, match=sentence):
        attack()


def test_what_is_seen_late_takes_a_part_of_the_guard_s_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    weaker = {"reaction_s": 0.2, "blind_s": 0.0}
    monkeypatch.setattr(under, "GuardConfig", lambda **given: GuardConfig(**(given | weaker)))

    def attack(age_s: float) -> None:
        siege = Siege(Stage(borders=((1.0, 0.0, 0.8),), position_age_s=age_s))
        for tick in range(200):
            siege.tick(Ask((0.3, 0.001 * (tick % 2), 0.0)))

    attack(0.0)
    with pytest.raises(Violation, match="was not seen"):
        attack(0.25)


def test_the_oracle_names_what_is_no_number_or_has_no_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    siege = Siege(Stage())
    check = siege.guard.check

    def nameless(setpoint: Setpoint, sight: Sight) -> GuardVerdict:
        verdict = check(setpoint, sight)
        return GuardVerdict(verdict.setpoint, (), 0.0, 0.0)

    monkeypatch.setattr(siege.guard, "check", nameless)
    with pytest.raises(Violation, match="no limit named"):
        siege.tick(Ask((9.0, 0.0, 0.0)))
