"""Several sources of one beam: none hides what another sees, echoes are dropped."""

from hypothesis import given, settings
from hypothesis import strategies as st

from hal.ranging.rival_sources import MOST_SOURCES, RivalSources, Source, Verdict
from hal.readings import RangeReading, RangeStatus

OWN, SECOND, COMPANION = Source(1, 0), Source(1, 1), Source(158, 7)
OWN_RING, RING = Source(1, ring=True), Source(158, ring=True)
FRESH_S = 0.3


def at(range_m: float, max_m: float = 1.0) -> RangeReading:
    return RangeReading(0.0, "b", RangeStatus.VALID, range_m, 1e-4, 0.02, max_m)


def free(max_m: float = 1.0) -> RangeReading:
    return RangeReading(0.0, "b", RangeStatus.OUT_OF_RANGE, max_m, 1e-4, 0.02, max_m)


BLIND = RangeReading(0.0, "b", RangeStatus.NO_SIGNAL, 0.0, 1e-4, 0.02, 1.0)


def verdicts(*said: tuple[float, Source, RangeReading]) -> list[str]:
    rivals = RivalSources(FRESH_S)
    return [rivals.judge(source, reading, now_s).value for now_s, source, reading in said]


def test_the_nearest_return_of_fresh_sources_counts() -> None:
    assert verdicts((0.0, OWN, at(0.5)), (0.1, SECOND, at(0.7)), (0.2, SECOND, at(0.4))) == [
        "believed",
        "overruled",
        "believed",
    ]


def test_a_return_counts_more_than_nothing_there() -> None:
    assert verdicts((0.0, OWN, at(0.9)), (0.1, SECOND, free(0.8)))[1] == "overruled"
    assert verdicts((0.0, OWN, free(0.8)), (0.1, SECOND, at(0.9)))[1] == "believed"


def test_of_two_that_see_nothing_the_farther_sight_counts() -> None:
    assert verdicts((0.0, OWN, free(0.8)), (0.1, SECOND, free(1.0)), (0.2, OWN, free(0.8))) == [
        "believed",
        "believed",
        "overruled",
    ]


def test_a_stale_source_hides_nobody() -> None:
    said = ((0.0, OWN, at(0.5)), (0.29, SECOND, at(0.7)), (0.31, SECOND, at(0.7)))
    assert verdicts(*said) == ["believed", "overruled", "believed"]


def test_an_invalid_source_hides_nobody_and_is_not_heard_beside_one_that_measures() -> None:
    assert verdicts(
        (0.0, OWN, at(0.5)), (0.1, OWN, BLIND), (0.15, SECOND, at(0.7)), (0.2, OWN, BLIND)
    ) == ["believed", "believed", "believed", "overruled"]


def test_an_echo_is_what_the_autopilot_says_after_a_companion_said_the_same() -> None:
    assert verdicts((0.0, COMPANION, at(0.5)), (0.2, SECOND, at(0.51)))[1] == "echo"
    assert verdicts((0.0, COMPANION, at(0.5)), (1.1, SECOND, at(0.51)))[1] == "believed"
    assert verdicts((0.0, COMPANION, BLIND), (0.2, SECOND, BLIND))[1] == "echo"
    assert verdicts((0.0, OWN, at(0.5)), (0.1, COMPANION, at(0.5)))[1] == "believed"


def test_what_the_autopilots_own_sensor_sees_is_no_echo_of_a_companion_that_said_it_before() -> (
    None
):
    own = [(0.1 * n, SECOND, at(0.9 - 0.05 * n)) for n in range(5)]
    chance = (0.5, COMPANION, at(0.3)), (0.55, COMPANION, free()), (0.6, SECOND, at(0.3))
    assert verdicts(*own, *chance)[-1] == "believed"
    assert verdicts(*own[:4], *chance)[-1] == "echo"


def test_an_echo_of_which_some_originals_were_lost_stays_one() -> None:
    heard = [n for n in range(40) if n % 7 < 4]
    originals = [(0.1 * n, COMPANION, at(0.2 + 0.015 * n)) for n in heard]
    echoes = [(0.1 * n + 0.02, SECOND, at(0.2 + 0.015 * n)) for n in range(40)]
    found = verdicts(*sorted([*originals, *echoes], key=lambda one: one[0]))
    assert found.count("echo") >= len(heard)


def test_a_companion_hides_nothing_that_the_autopilots_own_sensor_sees() -> None:
    said = (0.0, COMPANION, free()), (0.1, OWN, at(0.3)), (0.15, COMPANION, free())
    assert verdicts(*said) == ["believed", "believed", "overruled"]


def test_the_autopilots_ring_is_made_of_what_its_sensors_said() -> None:
    assert verdicts((0.0, OWN, at(0.5)), (0.1, OWN_RING, at(0.54)))[1] == "echo"
    assert verdicts((0.0, OWN, at(0.5)), (0.1, OWN_RING, at(0.4)))[1] == "believed"
    assert verdicts((0.0, OWN_RING, at(0.5)), (0.1, OWN, at(0.5)))[1] == "believed"
    assert verdicts((0.0, COMPANION, at(0.5)), (0.1, RING, at(0.5)))[1] == "believed"


def test_what_was_sent_before_the_newest_is_late() -> None:
    rivals = RivalSources(FRESH_S)
    said = [(0.0, 10.0), (0.1, 9.9), (0.2, 10.2), (0.3, 10.2), (0.4, 10.1)]
    verdicts = [rivals.judge(OWN, at(0.5), now_s, sent_s).value for now_s, sent_s in said]
    assert verdicts == ["believed", "late", "believed", "believed", "late"]


def test_a_made_up_time_hides_no_true_one_and_a_clock_that_began_anew_is_believed() -> None:
    rivals = RivalSources(FRESH_S)
    said = [
        (0.0, 10.0),
        (0.05, 1e9),
        (0.1, 10.1),
        *((0.2 + n / 10, 1.0 + n / 10) for n in range(5)),
    ]
    verdicts = [rivals.judge(OWN, at(0.5), now_s, sent_s).value for now_s, sent_s in said]
    assert verdicts == ["believed", "late", "believed", *["late"] * 3, *["believed"] * 2]


def test_made_up_sources_cost_bounded_memory_and_hide_no_return() -> None:
    rivals = RivalSources(FRESH_S)
    for number in range(10 * MOST_SOURCES):
        rivals.judge(Source(200, number), free(), 0.001 * number)
    assert rivals.judge(OWN, at(0.5), 0.1) is Verdict.BELIEVED


@settings(max_examples=80, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([OWN, SECOND, COMPANION, RING]),
            st.one_of(st.floats(0.03, 0.9).map(at), st.just(BLIND), st.just(free())),
        ),
        max_size=40,
    )
)
def test_what_is_believed_is_never_farther_than_the_last_word_of_another_companion(
    said: list[tuple[Source, RangeReading]],
) -> None:
    rivals, last = RivalSources(FRESH_S), dict[Source, RangeReading]()
    for number, (source, reading) in enumerate(said):
        verdict = rivals.judge(source, reading, 0.005 * number)  # all of them still fresh
        others = [r for s, r in last.items() if s != source and r.status is RangeStatus.VALID]
        if verdict is Verdict.BELIEVED:
            assert all(r.range_m >= reading.range_m or reading is BLIND for r in others)
            assert not (others and reading is BLIND)
        if verdict is not Verdict.ECHO:
            last[source] = reading
