"""Who is wrong, when beams contradict each other."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from autonomy.perception.doubt.disagreement import (
    CONTRADICTIONS_MIN,
    all_at_odds,
    contradict,
    single_out,
)

BEAMS = range(4)


def table(against: dict[frozenset[int], float], in_favour: float = 5.0) -> list[list[list[float]]]:
    return [[[against.get(frozenset((a, b)), 0.0), in_favour] for b in BEAMS] for a in BEAMS]


@given(liar=st.sampled_from(BEAMS), weight=st.floats(CONTRADICTIONS_MIN, 100.0))
def test_a_beam_that_contradicts_three_which_agree_is_the_one(liar: int, weight: float) -> None:
    against = {frozenset((liar, other)): weight for other in BEAMS if other != liar}
    found = single_out(table(against), list(BEAMS))
    assert found is not None
    assert found[0] == liar


@given(weight=st.floats(CONTRADICTIONS_MIN, 100.0))
def test_when_all_contradict_all_nobody_is_singled_out(weight: float) -> None:
    pairs = table({frozenset(c): weight for c in itertools.combinations(BEAMS, 2)}, 0.0)
    assert single_out(pairs, list(BEAMS)) is None
    assert all_at_odds(pairs, list(BEAMS))


@given(one=st.sampled_from(BEAMS), other=st.sampled_from(BEAMS))
def test_two_that_contradict_each_other_alone_accuse_nobody(one: int, other: int) -> None:
    pairs = table({frozenset((one, other)): 50.0} if one != other else {})
    assert single_out(pairs, list(BEAMS)) is None
    assert not all_at_odds(pairs, list(BEAMS))


@given(liar=st.sampled_from(BEAMS))
def test_of_two_beams_that_are_left_neither_can_be_accused(liar: int) -> None:
    against = {frozenset((liar, other)): 50.0 for other in BEAMS if other != liar}
    assert single_out(table(against), [liar, (liar + 1) % 4]) is None


def test_a_few_contradictions_among_many_agreements_are_noise() -> None:
    pairs = table({frozenset((0, 1)): CONTRADICTIONS_MIN}, in_favour=100.0)
    assert not contradict(pairs, 0, 1)
    assert contradict(table({frozenset((0, 1)): CONTRADICTIONS_MIN}, in_favour=5.0), 0, 1)
    assert not contradict(table({frozenset((0, 1)): CONTRADICTIONS_MIN - 0.1}, 0.0), 0, 1)
