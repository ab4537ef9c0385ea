"""The seeded random driver: the same moves as the state machine's, a million of them."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hal.frames import Vector3
from tools.guard_siege.siege import Ask, Siege, Stage, Violation, oldest_s
from tools.guard_siege.vehicle import Make

LENGTHS = (20, 400)
"""Ticks of a siege, at least and at most."""
TELL_EVERY = 50_000
"""Steps."""


@dataclass
class Tally:
    """What a run came to."""

    steps: int = 0
    sieges: int = 0
    kills: int = 0
    limits: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)

    def sentence(self) -> str:
        """How much was done, and what was found."""
        return (
            f"{self.steps} steps in {self.sieges} sieges, {self.kills} deaths of the program:"
            f" {len(self.violations)} violations"
        )


def stage(rng: np.random.Generator) -> Stage:
    """A room, what of it is seen, and a vehicle."""
    posts = tuple(
        (
            float(rng.uniform(-1.6, 1.6)),
            float(rng.uniform(-1.6, 1.6)),
            float(rng.choice([0.0, 0.1])),
        )
        for _ in range(int(rng.integers(0, 7)))
    )
    borders = []
    for _ in range(int(rng.integers(0, 3))):
        bearing = rng.uniform(-math.pi, math.pi)
        borders.append((math.cos(bearing), math.sin(bearing), float(rng.uniform(0.2, 1.5))))
    link_s, dead_s = float(rng.uniform(0.0, 0.1)), float(rng.uniform(0.0, 0.4))
    make = Make(
        link_s=link_s,
        dead_s=dead_s,
        braking_m_s2=float(rng.choice([0.5, 1.0, 3.0])),
        gain_per_s=0.95,
    )
    return Stage(
        fence=int(rng.integers(3)),
        posts=posts,
        borders=tuple(borders),
        ceiling_m=float(rng.choice([1.3, 1.6, math.inf])),
        sigma_m=float(rng.choice([0.0, 0.01, 0.02, 0.08])),
        make=make,
        yaw_rad=float(rng.uniform(-math.pi, math.pi)),
    )


def besiege(rng: np.random.Generator, tally: Tally, most: int, *, late: bool = True) -> None:
    """One siege of at most `most` ticks; raises Violation. `late`: what the guard sees has an age,
    drawn from a generator of its own: the same moves without it are another siege.
    """
    plan = stage(rng)
    ages = rng.spawn(1)[0]
    if late:
        oldest = oldest_s(plan.make)
        position_age_s, beams_age_s = (float(age) for age in ages.uniform(0.0, oldest, 2))
        plan = replace(plan, position_age_s=position_age_s, beams_age_s=beams_age_s)
    siege = Siege(plan)
    length = min(most, int(rng.integers(*LENGTHS)))
    tally.sieges += 1
    left, habit, astray = 0, _idle, (0.0, 0.0)
    for chance, tick, blind, lost, dies in rng.random((length, 5)):
        if left == 0:
            left, habit = int(rng.integers(1, 40)), _habit(rng, siege)
            astray = (float(rng.uniform(-1.0, 1.0)), float(rng.uniform(-1.0, 1.0)))
        left -= 1
        if chance < 0.02:
            siege.reveal(int(rng.integers(2)), float(rng.uniform(0.0, 0.4)))
        siege.mislead(*astray)
        tally.steps += 1
        tick_s = 0.05 if tick < 0.6 else 0.025 if tick < 0.8 else 0.075
        verdict = siege.tick(
            habit(),
            tick_s=tick_s,
            beams=bool(blind < 0.8),
            ok=bool(lost < 0.99),
            age=float(ages.random()),
        )
        tally.limits.update(verdict.limits)
        # Where room is what limits, the program dies most often.
        if dies < (0.3 if verdict.free_distance_m < siege.guard.horizon_m else 0.01):
            tally.kills += 1
            siege.kill()


def _idle() -> Ask:
    return Ask()


def _habit(rng: np.random.Generator, siege: Siege) -> Callable[[], Ask]:
    """A way to ask, kept up for some ticks."""
    kind = rng.random()
    if kind < 0.6:
        return _hunt(rng, siege)
    steady, offset = _vector(rng, 0.5, 0.3), _vector(rng, 0.4, 0.4)
    turn = float(rng.uniform(-3.1, 3.1))
    if kind < 0.7:
        return lambda: Ask(steady, turn_rad=0.05)
    if kind < 0.75:
        return lambda: Ask(_vector(rng, 0.5, 0.5), _vector(rng, 1.0, 1.0), float(rng.normal()))
    if kind < 0.8:
        return lambda: Ask(offset=offset, turn_rad=turn)
    if kind < 0.85:
        return lambda: Ask(steady, offset, turn)
    if kind < 0.9:
        return lambda: Ask(_vector(rng, 1e9, 1e9), _vector(rng, 1e300, 1e9))
    if kind < 0.93:
        return lambda: Ask(again=True)
    if kind < 0.97:
        return lambda: Ask(steady, age_s=float(rng.choice([0.0, 0.15, 0.25, -0.3, 5.0])))
    return _idle


def _hunt(rng: np.random.Generator, siege: Siege) -> Callable[[], Ask]:
    """Fly at, or past, a post or a border, straight or aside."""
    aside = float(rng.uniform(-1.6, 1.6)) if rng.random() < 0.5 else 0.0
    speed = float(rng.uniform(0.05, 0.3))
    pulled = rng.random() < 0.3
    if siege.world.posts and rng.random() < 0.8:
        post = siege.world.posts[int(rng.integers(len(siege.world.posts)))]
        bearing = None
    else:
        post, bearing = (0.0, 0.0, 0.0), float(rng.uniform(-math.pi, math.pi))

    def ask() -> Ask:
        north, east, _ = siege.vehicle.position
        at = math.atan2(post[1] - east, post[0] - north) if bearing is None else bearing
        to = (speed * math.cos(at + aside), speed * math.sin(at + aside), 0.0)
        return Ask(offset=to, turn_rad=0.05) if pulled else Ask(to, turn_rad=0.05)

    return ask


def _vector(rng: np.random.Generator, size: float, up: float) -> Vector3:
    bearing, length = rng.uniform(-math.pi, math.pi), size * rng.random()
    return (
        float(length * math.cos(bearing)),
        float(length * math.sin(bearing)),
        float(rng.uniform(-up, up)),
    )


def run(seed: int, steps: int, *, stop_at: int = 10, tell: Callable[[str], None] = print) -> Tally:
    """Sieges until `steps` ticks were flown; each has a seed of its own: (seed, number)."""
    tally = Tally()
    number = told = 0
    while tally.steps < steps and len(tally.violations) < stop_at:
        rng = np.random.default_rng((seed, number))
        try:
            besiege(rng, tally, steps - tally.steps)
        except Violation as violation:
            tally.violations.append(f"siege {number}: {violation}")
            tell(tally.violations[-1])
        number += 1
        if tally.steps >= told + TELL_EVERY:
            told = tally.steps
            tell(tally.sentence())
    return tally
