from collections import Counter
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import parse_fault
from hal.sim.link_faults import FaultyChannel


def channel(
    *lines: str, direction: Literal["up", "down"] = "down", seed: int = 1
) -> FaultyChannel[int]:
    faults = tuple(map(parse_fault, lines))
    return FaultyChannel(faults, direction, np.random.default_rng(seed), FaultClock())


def through(channel: FaultyChannel[int], count: int, period_s: float = 0.01) -> list[int]:
    """What arrives while numbers are sent one by one, and long after."""
    arrived = []
    for number in range(count):
        channel.put(number * period_s, number)
        arrived += channel.take(number * period_s)
    return arrived + channel.take(1e6)


def test_a_sound_link_passes_everything_at_once_and_in_order() -> None:
    sound = channel("gnss_loss")
    assert sound.sound
    assert through(sound, 100) == list(range(100))


def test_a_lost_link_passes_nothing_for_as_long_as_it_is_lost() -> None:
    assert through(channel("link_loss@0.2/0.3"), 100) == [*range(20), *range(50, 100)]


@pytest.mark.parametrize(("direction", "arrives"), [("up", 0), ("down", 10)])
def test_a_fault_of_one_direction_leaves_the_other_alone(
    direction: Literal["up", "down"], arrives: int
) -> None:
    assert len(through(channel("link_loss:direction=up", direction=direction), 10)) == arrives


def test_what_is_late_comes_late_and_not_before() -> None:
    late = channel("link_delay:delay_s=0.1")
    late.put(1.0, 7)
    assert late.take(1.099) == []
    assert late.take(1.1) == [7]
    assert late.take(2.0) == []


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_packets_are_lost_as_often_as_asked(share: float) -> None:
    arrived = through(channel(f"link_drop:probability={share}"), 2000)
    assert len(arrived) == pytest.approx(2000 * (1.0 - share), abs=120)
    assert arrived == sorted(arrived)


def test_packets_that_come_twice_come_twice_and_not_thrice() -> None:
    counts = Counter(through(channel("link_duplicate:probability=0.25"), 2000))
    assert set(counts) == set(range(2000))
    assert set(counts.values()) == {1, 2}
    assert sum(counts.values()) == pytest.approx(2500, abs=120)


def test_overtaken_packets_arrive_behind_those_of_the_next_moments() -> None:
    arrived = through(channel("link_reorder:probability=0.2,by_s=0.05"), 1000)
    assert sorted(arrived) == list(range(1000))
    assert arrived != sorted(arrived)
    assert max(abs(place - number) for place, number in enumerate(arrived)) <= 6


@settings(max_examples=60, deadline=None)
@given(
    st.sets(
        st.sampled_from(
            [
                "link_drop:probability=0.4",
                "link_duplicate:probability=0.4",
                "link_reorder:probability=0.4",
                "link_delay:delay_s=0.03,jitter_s=0.2",
                "link_loss@0.1/0.1",
            ]
        )
    ),
    st.integers(0, 50),
)
def test_nothing_is_invented_and_a_seed_repeats_itself(lines: set[str], seed: int) -> None:
    ordered = sorted(lines)
    arrived = through(channel(*ordered, seed=seed), 60)
    assert set(arrived) <= set(range(60))
    assert max(Counter(arrived).values(), default=0) <= 2
    assert arrived == through(channel(*ordered, seed=seed), 60)
