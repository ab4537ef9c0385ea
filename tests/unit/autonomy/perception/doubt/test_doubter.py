"""Which beams are doubted, which are believed again, and what their readings are worth then."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.model import BeamWord
from autonomy.perception.movers import Unrest
from hal.config import BeamsConfig
from hal.readings import RangeReading, RangeStatus
from hal.sim.scenario import BeamSimulation, Disc, Scenario
from tests.unit.autonomy.perception.doubt.rig import ONE_WALL, OPEN, ROOM, STEP, Turning, high

LEVEL = ("front", "right", "back", "left")
W = BeamWord


@settings(max_examples=6, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    half_angle_deg=st.sampled_from([0.0, 12.5]),
    rate_hz=st.sampled_from([10.0, 20.0]),
    speed_m_s=st.floats(0.0, 0.2),
)
def test_healthy_beams_are_believed(
    seed: int, half_angle_deg: float, rate_hz: float, speed_m_s: float
) -> None:
    model = BeamSimulation(half_angle_deg=half_angle_deg, rate_hz=rate_hz)
    flown = Turning(seed=seed, speed_m_s=speed_m_s, model=model).fly(30.0)
    assert flown.history == []


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("beam_silence", {W.STALE}),
        ("beam_slow:rate_hz=2", {W.STALE}),
        ("beam_dropout", {W.NO_SIGNAL}),
        ("beam_blocked", {W.TOO_NEAR}),
        ("beam_stuck", {W.STUCK, W.SATURATED}),
        ("beam_constant", {W.SATURATED}),
        ("beam_constant:range_m=0.5", {W.STUCK}),
        ("beam_noise:sigma_m=0.15", {W.JUMPING, W.INCONSISTENT}),
        ("beam_jump:probability=0.5", {W.JUMPING, W.INCONSISTENT}),
        ("beam_crosstalk:probability=1.0,other={other}", {W.CROSS_TALK}),
        ("beam_crosstalk:probability=0.3,other={other}", {W.CROSS_TALK}),
        ("beam_bias:bias_m=-0.3", {W.INCONSISTENT}),
        ("beam_bias:bias_m=0.3", {W.INCONSISTENT, W.SATURATED}),
    ],
)
@pytest.mark.parametrize("beam", ["front", "left"])
def test_every_kind_of_fault_is_found_by_its_name(
    fault: str, words: set[BeamWord], beam: str
) -> None:
    name, _, keys = fault.partition(":")
    keys = keys.format(other=LEVEL[(LEVEL.index(beam) + 1) % 4])
    line = f"{name}@8:beam={beam}" + (f",{keys}" if keys else "")
    flown = Turning(line).fly(30.0)
    assert {doubt.beam for _, doubt in flown.history} == {beam}
    when_s, doubt = flown.history[0]
    assert doubt.word in words
    assert 8.0 < when_s < 28.0
    assert beam in flown.words()
    if not words <= {W.STALE, W.NO_SIGNAL}:
        assert flown.taken_back_s <= 8.0, "what it showed when its fault began is still believed"


@pytest.mark.parametrize("min_m", [0.02, 0.25])
def test_a_blocked_lens_is_found_whatever_the_least_range(min_m: float) -> None:
    flown = Turning("beam_blocked@8:beam=left", beams=BeamsConfig(min_m=min_m)).fly(14.0)
    assert {doubt.beam for _, doubt in flown.history} == {"left"}
    assert "left" in flown.words()


def test_stamps_are_when_the_range_was_true_whatever_the_latency() -> None:
    """Drivers take the latency off; taken off twice, beams of two drivers look past each other."""
    said = [
        Turning("beam_bias@8:beam=left,bias_m=0.3", beams=BeamsConfig(latency_s=s)).fly(20.0)
        for s in (0.0, 0.1)
    ]
    assert said[0].history == said[1].history != []


@pytest.mark.parametrize("fault", ["beam_silence", "beam_dropout", "beam_blocked", "beam_constant"])
def test_a_beam_that_behaves_again_is_believed_again(fault: str) -> None:
    flown = Turning(f"{fault}@8/6:beam=right").fly(14.0)
    assert "right" in flown.words()
    assert flown.fly(16.0).words() == {}


def test_each_new_doubt_of_a_beam_lasts_longer() -> None:
    faults = [f"beam_blocked@{at_s}/2:beam=right" for at_s in (5, 15, 30)]
    flown = Turning(*faults)
    lasted = []
    since_s = None
    for _ in range(60 * 20):
        flown.fly(0.05)
        if since_s is None and flown.words():
            since_s = flown.now_s
        elif since_s is not None and not flown.words():
            lasted.append(flown.now_s - since_s)
            since_s = None
    assert len(lasted) == 3
    assert lasted[0] < lasted[1] < lasted[2]


def test_a_beam_that_still_contradicts_the_others_is_not_believed_again() -> None:
    assert Turning("beam_constant@8:beam=back").fly(60.0).words() == {"back": W.SATURATED}


def test_all_beams_that_stop_seeing_at_once_are_doubted() -> None:
    assert set(Turning("beam_constant@8").fly(12.0).words()) >= set(LEVEL)


@pytest.mark.parametrize("fault", ["beam_constant@8/5", "beam_stuck@8/5"])
@pytest.mark.parametrize("room", [ROOM, ONE_WALL])
def test_beams_that_were_all_doubted_are_believed_again_once_they_bear_each_other_out(
    fault: str, room: Scenario
) -> None:
    flown = Turning(fault, room=room).fly(13.0)
    assert set(flown.words()) >= set(LEVEL)
    assert flown.fly(25.0).words() == {}


@pytest.mark.parametrize("fault", ["beam_constant", "beam_stuck"])
def test_beams_that_stay_blind_never_bear_each_other_out(fault: str) -> None:
    flown = Turning(f"{fault}@8").fly(14.0)
    for _ in range(30):
        assert set(flown.fly(1.0).words()) >= set(LEVEL)


@pytest.mark.parametrize("seeing", [1, 2])
def test_fewer_than_three_beams_that_see_again_are_not_believed(seeing: int) -> None:
    back = [f"beam_constant@8/5:beam={beam}" for beam in LEVEL[:seeing]]
    blind = [f"beam_constant@8:beam={beam}" for beam in LEVEL[seeing:]]
    assert set(Turning(*back, *blind).fly(40.0).words()) >= set(LEVEL)


def test_two_beams_that_see_again_do_not_bear_each_other_out_while_the_others_are_silent() -> None:
    silent = [f"beam_silence@13:beam={beam}" for beam in LEVEL[2:]]
    assert set(Turning("beam_constant@8/5", *silent).fly(40.0).words()) >= set(LEVEL)


def test_what_moves_accuses_nobody_and_what_moves_elsewhere_nobody_else() -> None:
    fault = "beam_bias@8:beam=front,bias_m=-0.3"
    here, elsewhere = (Unrest((n, 0.0), 2.0, left=False) for n in (0.0, 9.0))
    assert Turning(fault, moving=(elsewhere, here)).fly(25.0).history == []
    assert set(Turning(fault, moving=(elsewhere,)).fly(25.0).words()) == {"front"}


def test_one_thing_that_is_gone_has_left_where_things_move_and_else_the_beams_are_blind() -> None:
    pillar = Disc(centre_ne_m=(0.6, 0.1), radius_m=0.2)
    room = OPEN.model_copy(update={"obstacles": (pillar,)})
    somewhere = (Unrest((-2.0, 0.0), 0.3, left=True),)
    assert Turning("beam_constant@8", room=room, moving=somewhere).fly(14.0).history == []
    assert set(Turning("beam_constant@8", room=room).fly(14.0).words()) >= set(LEVEL)


def test_a_look_past_what_has_just_left_is_no_denial() -> None:
    fault = "beam_bias@8:beam=front,bias_m=0.4"
    marked = []
    for moving in ((), (Unrest((0.0, 0.0), 2.0, left=True),)):
        flown, suspects = Turning(fault, moving=moving), 0
        for _ in range(50):
            flown.fly(0.2)
            judged = flown.doubt.judge(flown.readings)
            suspects += sum(one.status is RangeStatus.SUSPECT for one in judged)
        marked.append(suspects)
    assert marked[0] > 0
    assert marked[1] == 0


def test_beams_that_never_saw_anything_are_doubted_when_the_floor_is_missed() -> None:
    rising = Turning("beam_constant", height=lambda now_s: min(0.9, 0.15 * now_s))
    assert set(rising.fly(8.0).words()) >= {*LEVEL, "down"}


def test_the_open_is_no_reason_to_doubt() -> None:
    assert Turning(room=OPEN).fly(20.0).history == []


@pytest.mark.parametrize("kind", ["beam_constant@8:beam=front,range_m=0.4", "beam_stuck@8:beam=up"])
def test_one_frozen_beam_in_the_open_does_not_accuse_the_others(kind: str) -> None:
    flown = Turning(kind, room=OPEN).fly(30.0)
    assert {doubt.beam for _, doubt in flown.history} <= {"front"}


def test_a_frozen_beam_in_the_open_is_found() -> None:
    fault = "beam_constant@8:beam=front,range_m=0.4"
    assert Turning(fault, room=OPEN).fly(16.0).words()["front"] in (W.STUCK, W.INCONSISTENT)


def test_one_frozen_beam_by_a_wall_does_not_accuse_the_others() -> None:
    flown = Turning("beam_stuck@8.2:beam=front", room=ONE_WALL).fly(30.0)
    assert {doubt.beam for _, doubt in flown.history} == {"front"}


@pytest.mark.parametrize("at_s", [8.0, 8.5, 9.0, 9.4, 10.1])
def test_all_beams_that_freeze_while_one_sees_a_wall_are_doubted(at_s: float) -> None:
    frozen = Turning(f"beam_stuck@{at_s}", room=ONE_WALL, height=high).fly(at_s + 5.0)
    assert set(frozen.words()) >= set(LEVEL)


def test_beams_that_go_blind_in_the_open_are_doubted_where_the_floor_was_in_reach() -> None:
    flown = Turning("beam_constant@8", room=OPEN, height=lambda _: 0.8).fly(10.0)
    assert set(flown.words()) == set(LEVEL)


def test_above_the_reach_of_the_beam_down_nobody_can_tell_blindness_from_the_open() -> None:
    assert Turning("beam_constant@8", room=OPEN, height=high).fly(20.0).history == []


@pytest.mark.parametrize("beam", ["up", "down"])
@pytest.mark.parametrize("range_m", [0.4, 0.7])
def test_a_beam_up_or_down_that_says_one_value_in_level_flight_is_found(
    beam: str, range_m: float
) -> None:
    fault = f"beam_constant@5:beam={beam},range_m={range_m}"
    flown = Turning(fault, room=OPEN).fly(16.0)
    assert set(flown.words()) == {beam}


@pytest.mark.parametrize("bias_m", [-0.3, -0.2])
def test_a_floor_that_leaps_while_the_vehicle_stays_is_no_floor(bias_m: float) -> None:
    flown = Turning(f"beam_bias@8:beam=down,bias_m={bias_m}", speed_m_s=0.0).fly(10.0)
    assert flown.words() == {"down": W.INCONSISTENT}


@pytest.mark.parametrize("half_angle_deg", [0.0, 12.5])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.2])
def test_an_edge_on_the_floor_is_no_reason_to_doubt(
    half_angle_deg: float, speed_m_s: float
) -> None:
    flown = Turning(
        room=STEP,
        speed_m_s=speed_m_s,
        half_angle_deg=half_angle_deg,
        height=lambda _: 0.8,
        way_m=0.8,
    )
    assert flown.fly(30.0).history == []


def test_without_motion_a_repeated_range_is_no_reason_to_doubt() -> None:
    still = Turning(
        rate_rad_s=0.0,
        speed_m_s=0.0,
        model=BeamSimulation(sigma_m=0.0, sigma_fraction=0.0, dropout_probability=0.0),
    )
    assert still.fly(30.0).history == []


@pytest.mark.parametrize(("beam", "range_m"), [("down", 0.5), ("up", 0.6), ("down", 0.95)])
def test_a_beam_up_or_down_that_does_not_follow_the_height_is_stuck(
    beam: str, range_m: float
) -> None:
    def rising(now_s: float) -> float:
        return 0.8 if now_s < 8.0 else min(1.2, 0.8 + 0.1 * (now_s - 8.0))

    flown = Turning(f"beam_constant@5:beam={beam},range_m={range_m}", height=rising).fly(16.0)
    assert flown.words() == {beam: W.STUCK}


def test_a_height_that_changes_with_healthy_beams_is_no_reason_to_doubt() -> None:
    def waves(now_s: float) -> float:
        return 0.9 + 0.3 * math.sin(0.5 * now_s)

    assert Turning(height=waves).fly(30.0).history == []


def test_what_is_believed_is_passed_on_untouched() -> None:
    flown = Turning(room=OPEN).fly(1.0)
    assert flown.doubt.judge(flown.readings) is flown.readings


def test_a_doubted_reading_is_suspect_and_a_near_one_of_a_level_beam_no_measurement() -> None:
    flown = Turning("beam_blocked@3:beam=front", "beam_blocked@3:beam=down").fly(6.0)
    assert set(flown.words()) == {"front", "down"}

    def judged(beam: str, range_m: float) -> RangeReading:
        reading = RangeReading(9.0, beam, RangeStatus.VALID, range_m, 1e-4, 0.02, 1.0)
        return flown.doubt.judge((reading,))[0]

    assert judged("front", 0.5).status is RangeStatus.SUSPECT
    assert judged("front", 0.1).status is RangeStatus.NO_SIGNAL
    assert judged("down", 0.1).status is RangeStatus.SUSPECT
    assert judged("left", 0.1).status is RangeStatus.VALID
    assert judged("nobody", 0.1).status is RangeStatus.VALID


def test_the_same_calls_give_the_same_words() -> None:
    first, second = (Turning("beam_jump@5:beam=left", seed=3).fly(25.0) for _ in range(2))
    assert first.history == second.history


def test_a_loop_that_stood_still_does_not_call_the_beams_silent() -> None:
    flown = Turning(room=ROOM).fly(3.0)
    flown.now_s += 5.0
    assert [d.since_s >= 8.0 for _, d in flown.fly(0.1).history] == [True] * len(flown.history)
    assert flown.fly(2.0).words() == {}
