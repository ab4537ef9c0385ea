"""The ladder from "no way" to the verdict: fixed, finite, never reset."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.mission.ladder import Ladder, Rung


def test_nine_attempts_look_forget_nearby_forget_all_twice_and_end() -> None:
    ladder = Ladder(9)
    look, forget = Rung.LOOK_AGAIN, Rung.FORGET_ALL
    assert [ladder.climb() for _ in range(9)] == [
        look, look, Rung.FORGET_NEARBY, look, look, forget, look, forget, Rung.VERDICT
    ]  # fmt: skip
    assert ladder.failures == 9


@pytest.mark.parametrize("attempts", [2, 0, -1])
def test_fewer_than_three_attempts_are_no_ladder(attempts: int) -> None:
    with pytest.raises(ValueError, match="at least 3"):
        Ladder(attempts)


@settings(deadline=None)
@given(st.integers(3, 60))
def test_every_ladder_forgets_nearby_then_all_and_ends_where_it_says(attempts: int) -> None:
    ladder = Ladder(attempts)
    rungs = [ladder.climb() for _ in range(attempts)]
    assert rungs.count(Rung.FORGET_NEARBY) == 1
    assert 1 <= rungs.count(Rung.FORGET_ALL) <= 2
    assert rungs[attempts - 2] is Rung.FORGET_ALL
    assert rungs.index(Rung.FORGET_NEARBY) < rungs.index(Rung.FORGET_ALL)
    assert rungs.index(Rung.VERDICT) == attempts - 1
    assert ladder.climb() is Rung.VERDICT
