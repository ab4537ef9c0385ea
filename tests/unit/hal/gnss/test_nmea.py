"""Sentences to solutions: an epoch is told once, whole, and no better than it is."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.gnss import nmea
from hal.gnss.solution import Solution
from hal.readings import FixType
from tests.support import gnss
from tests.support.gnss import LATITUDE_DEG, LONGITUDE_DEG, gga, gsa, gst, rmc, sentence


class Listener:
    """Sentences in, solutions out."""

    def __init__(self, range_error_m: float = 4.0) -> None:
        self.epochs = nmea.Epochs(range_error_m)
        self.now_s = 10.0

    def hear(self, *lines: bytes) -> list[Solution]:
        solutions = []
        for line in lines:
            fields = nmea.parse(line.rstrip())
            assert fields is not None
            solutions += self.epochs.take(fields, self.now_s)
            self.now_s += 0.01
        return solutions

    def one(self, *lines: bytes) -> Solution:
        (solution,) = self.hear(*lines) + self.epochs.end()
        return solution


def test_an_epoch_of_all_three_sentences_is_told_with_the_last_of_them() -> None:
    listener = Listener()
    assert listener.hear(rmc(36_000.2), gga(36_000.2)) == []
    (solution,) = listener.hear(gst(36_000.2))
    assert solution.latitude_deg == pytest.approx(LATITUDE_DEG, abs=1e-8)
    assert solution.longitude_deg == pytest.approx(LONGITUDE_DEG, abs=1e-8)
    assert solution.amsl_m == pytest.approx(489.4)
    assert solution.epoch_s == pytest.approx(36_000.2)
    assert solution.period_s == 86_400.0
    assert solution.received_s == 10.0
    assert solution.fix_type is FixType.FIX_3D
    assert solution.horizontal_accuracy_m == pytest.approx(0.5)
    assert solution.vertical_accuracy_m == pytest.approx(1.2)
    assert solution.satellites == 12


def test_what_the_epochs_before_had_is_waited_for_and_no_more() -> None:
    listener = Listener()
    for time_s in (1.0, 2.0, 3.0):
        told = [s.epoch_s for s in listener.hear(gga(time_s), rmc(time_s))]
        assert told == ([] if time_s == 1.0 else [time_s - 1.0])
    assert [s.epoch_s for s in listener.hear(gga(4.0))] == [3.0]
    assert [s.epoch_s for s in listener.hear(rmc(4.0))] == [4.0]
    assert listener.hear(gst(4.0)) == []  # told already
    assert [s.epoch_s for s in listener.hear(gga(5.0), rmc(5.0), gga(6.0))] == [5.0]


def test_a_sentence_that_was_lost_delays_its_epoch_and_no_other() -> None:
    listener = Listener()
    for time_s in (1.0, 2.0, 3.0, 4.0):
        listener.hear(gga(time_s), rmc(time_s))
    assert listener.hear(gga(5.0)) == []
    assert [s.epoch_s for s in listener.hear(gga(6.0))] == [5.0]
    assert [s.epoch_s for s in listener.hear(rmc(6.0))] == [6.0]


def test_a_veto_is_waited_for_also_after_a_lost_sentence() -> None:
    listener = Listener()
    for time_s in (1.0, 2.0, 3.0, 4.0):
        listener.hear(gga(time_s), rmc(time_s))
    listener.hear(gga(5.0))
    (_, solution) = listener.hear(gga(6.0), rmc(6.0, "V"))
    assert solution.fix_type is FixType.NO_FIX


def test_an_epoch_without_gga_is_none() -> None:
    listener = Listener()
    assert listener.hear(rmc(1.0), gst(1.0), rmc(2.0), gst(2.0)) + listener.epochs.end() == []


def test_the_end_of_an_epoch_tells_once() -> None:
    listener = Listener()
    listener.hear(gga(1.0))
    assert len(listener.epochs.end()) == 1
    assert listener.epochs.end() == []


def test_sentences_of_any_constellation_are_read_and_others_are_not() -> None:
    assert nmea.is_read(b"$GPGGA,")
    assert nmea.is_read(b"$GLRMC,")
    for other in (b"$GNGLL,", b"$GNVTG,", b"$PUBX,00", b"$", b"$GN"):
        assert not nmea.is_read(other)


@pytest.mark.parametrize(
    ("quality", "fix_type"),
    [
        (0, FixType.NO_FIX),
        (1, FixType.FIX_3D),
        (2, FixType.DGPS),
        (3, FixType.FIX_3D),
        (4, FixType.RTK_FIXED),
        (5, FixType.RTK_FLOAT),
        (6, FixType.NO_FIX),  # dead reckoning
        (7, FixType.NO_FIX),  # typed in
        (8, FixType.NO_FIX),  # simulated
        (9, FixType.NO_FIX),
    ],
)
def test_qualities_are_translated(quality: int, fix_type: FixType) -> None:
    assert Listener().one(gga(1.0, quality)).fix_type is fix_type


def test_a_warning_of_rmc_undoes_the_fix() -> None:
    assert Listener().one(gga(1.0, 4), rmc(1.0, "V")).fix_type is FixType.NO_FIX


@pytest.mark.parametrize(
    ("mode", "fix_type"), [(1, FixType.NO_FIX), (2, FixType.FIX_2D), (3, FixType.DGPS)]
)
def test_gsa_tells_two_dimensions_from_three(mode: int, fix_type: FixType) -> None:
    assert Listener().one(gsa(mode), gga(1.0, 2)).fix_type is fix_type


def test_no_fix_stays_none_also_in_two_dimensions() -> None:
    assert Listener().one(gsa(2), gnss.no_fix_gga(1.0)).fix_type is FixType.NO_FIX


def test_an_old_gsa_says_nothing() -> None:
    listener = Listener()
    listener.hear(gsa(2, vdop="5.0"))
    listener.now_s += 3.0
    solution = listener.one(gga(1.0))
    assert solution.fix_type is FixType.FIX_3D
    assert solution.vertical_accuracy_m == pytest.approx(0.8 * 1.5 * 4.0)


def test_accuracy_comes_from_dilutions_where_gst_is_not_sent() -> None:
    solution = Listener(range_error_m=5.0).one(gsa(), gga(1.0))
    assert solution.horizontal_accuracy_m == pytest.approx(0.8 * 5.0)
    assert solution.vertical_accuracy_m == pytest.approx(1.3 * 5.0)


@pytest.mark.parametrize("hole", ["north", "east", "up"])
@pytest.mark.parametrize("written", ["", "0.0", "-1.0", "nan"])
def test_a_gst_with_a_hole_is_not_believed(hole: str, written: str) -> None:
    solution = Listener().one(gga(1.0), gst(1.0, **{hole: written}))
    assert solution.horizontal_accuracy_m == pytest.approx(3.2)


@pytest.mark.parametrize("hdop", ["", "nan"])
def test_without_any_accuracy_it_is_useless(hdop: str) -> None:
    assert Listener().one(gga(1.0, hdop=hdop)).horizontal_accuracy_m == 1e4


def test_south_and_west_are_negative() -> None:
    solution = Listener().one(gga(1.0, latitude_deg=-33.5, longitude_deg=-70.25))
    assert (solution.latitude_deg, solution.longitude_deg) == pytest.approx((-33.5, -70.25))


@pytest.mark.parametrize(
    "where", ["4723.8,Q,00832.7,E", "4723.8,N,00832.7,", ",N,00832.7,E", "4723.8,N,,E"]
)
def test_a_place_with_a_hole_is_none(where: str) -> None:
    solution = Listener().one(sentence(f"GNGGA,100000.00,{where},1,12,0.8,489.4,M,47.3,M,,"))
    assert math.isnan(solution.latitude_deg) or math.isnan(solution.longitude_deg)


@pytest.mark.parametrize("clock", ["", "1000xx.00", "250000.00"])
def test_a_time_that_is_none_is_told_as_none(clock: str) -> None:
    lines = sentence(f"GNGGA,{clock},4723.8,N,00832.7,E,1,12,0.8,489.4,M,47.3,M,,")
    fields = nmea.parse(lines.rstrip())
    assert fields is None or Listener().one(lines).epoch_s is None


def test_a_receiver_without_time_still_tells_that_it_has_no_fix() -> None:
    solution = Listener().one(gnss.no_fix_gga())
    assert (solution.fix_type, solution.epoch_s) == (FixType.NO_FIX, None)


def test_epochs_without_time_are_told_one_by_one() -> None:
    listener = Listener()
    assert [len(listener.hear(gnss.no_fix_gga())) for _ in range(4)] == [0, 1, 1, 2]


FIELD = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="$*,"))


@settings(deadline=None, max_examples=200)
@given(
    st.sampled_from(["GNGGA", "GPRMC", "GNGST", "GNGSA", "GAGGA"]),
    st.lists(
        st.one_of(
            FIELD,
            st.integers(-(10**9), 10**9).map(str),
            st.floats().map(str),
            st.sampled_from(["", "100000.00", "4723.8", "N", "E", "1", "0.8", "A", "M"]),
        ),
        max_size=22,
    ),
)
def test_any_content_of_a_checked_sentence_is_read_or_refused(kind: str, fields: list[str]) -> None:
    line = sentence(",".join([kind, *fields])).rstrip()
    parsed = nmea.parse(line)
    if parsed is None:
        return
    epochs = nmea.Epochs(4.0)
    for solution in epochs.take(parsed, 0.0) + epochs.end():
        assert isinstance(solution.fix_type, FixType)
        assert all(
            isinstance(value, float) for value in (*solution.place, solution.horizontal_accuracy_m)
        )
