"""The ladder from "no way" to the verdict: fixed, finite, never reset."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.mission.ladder import Ladder, Rung


def test_nine_attempts_look_forget_nearby_forget_all_and_end() -> None:
    ladder = Ladder(9)
    look = Rung.LOOK_AGAIN
    assert [ladder.climb() for _ in range(9)] == [
        look, look, Rung.FORGET_NEARBY, look, look, Rung.FORGET_ALL, look, look, Rung.VERDICT
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
    assert rungs.count(Rung.FORGET_NEARBY) == rungs.count(Rung.FORGET_ALL) == 1
    assert rungs.index(Rung.FORGET_NEARBY) < rungs.index(Rung.FORGET_ALL) < attempts - 1
    assert rungs.index(Rung.VERDICT) == attempts - 1
    assert ladder.climb() is Rung.VERDICT
