"""What the turning still shows when beams are lost."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.config import Config
from autonomy.mission.coverage import Lookout, coverage, covering_beam
from autonomy.model import BeamDoubt, BeamWord

CONFIG = Config()
LEVEL = ("front", "right", "back", "left")


def doubted(beam: str, since_s: float = 1.0, word: BeamWord = BeamWord.STUCK) -> BeamDoubt:
    return BeamDoubt(beam, word, since_s, "it says one thing")


def test_with_all_beams_a_little_more_than_a_quarter_turn_shows_everything() -> None:
    full = coverage(CONFIG, ())
    assert full.sweep_rad == pytest.approx(math.radians(100.0))
    assert full.period_s == pytest.approx(1.5)
    assert full.share == 1.0


@given(st.sampled_from(LEVEL))
def test_without_one_each_bearing_is_seen_half_as_often_and_flown_half_as_fast(lost: str) -> None:
    left = coverage(CONFIG, {lost})
    assert left.sweep_rad == pytest.approx(math.radians(190.0))
    assert left.period_s == pytest.approx(3.0)
    assert left.share == pytest.approx(0.5)


@given(st.sets(st.sampled_from(LEVEL), min_size=2))
def test_without_two_it_does_not_go_on(lost: set[str]) -> None:
    assert coverage(CONFIG, lost).share == 0.0


def test_a_beam_up_or_down_does_not_cover_and_is_not_missed_in_the_plane() -> None:
    assert coverage(CONFIG, {"up", "down"}) == coverage(CONFIG, ())
    assert covering_beam(CONFIG, "up", {"up"}) == ""


def test_clockwise_turning_brings_the_beam_on_the_left_next() -> None:
    assert covering_beam(CONFIG, "front", {"front"}) == "left"
    assert covering_beam(CONFIG, "front", {"front", "left"}) == "back"
    assert covering_beam(CONFIG, "right", {"right"}) == "front"
    assert covering_beam(CONFIG, "right", set(LEVEL)) == ""


def test_a_lost_beam_is_told_once_with_why_and_what_covers_for_it() -> None:
    lookout = Lookout(CONFIG)
    lookout.step(1.0, (doubted("front"),))
    (event,) = lookout.news
    assert "front is not believed (stuck): it says one thing" in event.why
    assert "left next" in event.why
    assert lookout.lost_now == "lost: beam front"
    assert lookout.doubts[0].covered_by == "left"
    assert lookout.speed_max_m_s == pytest.approx(0.1)
    lookout.step(1.05, (doubted("front"),))
    assert lookout.news == ()
    assert lookout.lost_now == ""


def test_a_beam_that_is_believed_again_is_told_and_all_is_as_before() -> None:
    lookout = Lookout(CONFIG)
    lookout.step(1.0, (doubted("front"),))
    lookout.step(4.5, ())
    assert [event.why for event in lookout.news] == ["beam front is believed again, after 3.5 s"]
    assert lookout.now == coverage(CONFIG, ())
    assert lookout.doubts == ()


def test_a_late_reading_is_borne_for_as_long_as_the_configuration_says() -> None:
    lookout = Lookout(CONFIG)
    late = (doubted("front", 1.0, BeamWord.STALE),)
    lookout.step(1.45, late)
    assert lookout.doubts == ()
    lookout.step(1.5, late)
    assert lookout.lost_now == "lost: beam front"


def test_too_few_beams_count_from_the_loss_of_the_second() -> None:
    lookout = Lookout(CONFIG)
    lookout.step(1.0, (doubted("front", 1.0),))
    assert lookout.too_few(1.0) is None
    lookout.step(3.0, (doubted("front", 1.0), doubted("back", 3.0)))
    assert lookout.too_few(4.0) == (1.0, "back (stuck), front (stuck)")
    lookout.step(5.0, (doubted("back", 3.0),))
    assert lookout.too_few(5.0) is None


def test_a_lost_beam_up_or_down_slows_nothing_down() -> None:
    lookout = Lookout(CONFIG)
    lookout.step(1.0, (doubted("up"), doubted("down")))
    assert lookout.lost_now == ""
    assert lookout.speed_max_m_s == CONFIG.guidance.speed_max_m_s
    assert all("no change of height" in event.why for event in lookout.news)
