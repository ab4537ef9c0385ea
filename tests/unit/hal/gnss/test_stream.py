"""Bytes to fixes: both protocols, counters that add up, and nothing that raises."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from hal.gnss.stream import GnssStream
from hal.readings import FixType, GnssFix
from tests.support import gnss
from tests.support.gnss import gga, gsa, gst, moved_deg, nav_pvt, rmc, sentence


def a_stream(confirm_fixes: int = 1) -> GnssStream:
    return GnssStream(
        latency_s=0.1, range_error_m=4.0, frozen_after_s=5.0, confirm_fixes=confirm_fixes
    )


def adds_up(stream: GnssStream) -> bool:
    n = stream.counts()
    return (
        n.bytes_taken == n.bytes_framed + n.bytes_dropped + n.bytes_pending
        and n.frames == n.ignored + n.unreadable + n.read
        and n.solutions == n.told + n.absurd + n.untimely + n.frozen + n.outranked
    )


def test_nmea_becomes_fixes_when_the_line_falls_silent_and_later_with_the_last_sentence() -> None:
    stream = a_stream()
    for step in range(6):
        data = gga(step, latitude_deg=moved_deg(step)) + rmc(step)
        fixes = stream.feed(data, 10.0 + step) or stream.gap()
        assert [fix.stamp_s for fix in fixes] == [9.9 + step]
    assert (stream.feed(gga(7.0) + rmc(7.0), 17.0)) != []
    assert adds_up(stream)


def test_ubx_is_told_and_the_same_epochs_in_nmea_are_not() -> None:
    stream = a_stream()
    fixes: list[GnssFix] = []
    for step in range(5):
        fixes += stream.feed(nav_pvt(step, latitude_deg=moved_deg(step)), 10.0 + step)
        fixes += stream.feed(gga(step) + rmc(step) + gst(step), 10.1 + step)
    assert [fix.horizontal_accuracy_m for fix in fixes] == 5 * [0.9]
    assert stream.counts().outranked == 5
    assert adds_up(stream)


def test_nmea_takes_over_when_ubx_stops() -> None:
    stream = a_stream()
    stream.feed(nav_pvt(400_000.0), 10.0)
    fixes = []
    for step in range(1, 12):
        data = gga(step, latitude_deg=moved_deg(step)) + rmc(step) + gst(step)
        fixes += stream.feed(data, 10.0 + step)
    assert len(fixes) >= 3
    assert fixes[-1].stamp_s == 20.9
    assert adds_up(stream)


def test_frames_of_other_kinds_and_unreadable_ones_are_counted() -> None:
    stream = a_stream()
    stream.feed(gnss.ubx(0x01, 0x35, bytes(8)) + sentence("GNVTG,,T,,M,0.1,N,0.2,K,A"), 1.0)
    stream.feed(sentence("GNGGA,100000.00,xx.y,N,zz,E,1,12,q,w,M,47.3,M,,"), 1.0)
    counts = stream.counts()
    assert counts.ignored == 2
    assert counts.unreadable == 1
    assert adds_up(stream)


def test_a_stream_that_starts_anew_forgets_and_keeps_counting() -> None:
    stream = a_stream()
    stream.feed(nav_pvt(100.0), 1.0)
    stream.feed(nav_pvt(101.0)[:50], 2.0)
    stream.restart()
    assert stream.feed(nav_pvt(101.0)[50:], 2.1) == []
    assert len(stream.feed(nav_pvt(5.0), 3.0)) == 1
    assert stream.counts().told == 2
    assert adds_up(stream)


def test_loss_of_the_antenna_and_its_return_in_nmea() -> None:
    stream = a_stream(confirm_fixes=3)
    types: list[FixType] = []
    for step in range(12):
        lost = 4 <= step < 7
        data = gnss.no_fix_gga(step) if lost else gga(step, latitude_deg=moved_deg(step))
        data += rmc(step, "V" if lost else "A")
        fixes = stream.feed(data, 10.0 + step) + stream.gap()
        types += [fix.fix_type for fix in fixes]
    three_d, lost_fix = FixType.FIX_3D, FixType.NO_FIX
    assert types == 4 * [three_d] + 5 * [lost_fix] + 3 * [three_d]
    assert (stream.counts().losses, stream.counts().leaps) == (1, 2)


TIMES = st.floats(0.0, 700_000.0)
DEGREES = st.floats(-200.0, 200.0)
FRAMES = st.one_of(
    st.builds(gga, TIMES, st.integers(0, 9), latitude_deg=DEGREES, longitude_deg=DEGREES),
    st.builds(rmc, TIMES, st.sampled_from(["A", "V", ""])),
    st.builds(gst, TIMES, st.sampled_from(["0.3", "", "nan", "-1", "1e999"])),
    st.builds(gsa, st.integers(0, 4), st.sampled_from(["1.3", "", "nan", "-5"])),
    st.builds(
        nav_pvt,
        TIMES,
        st.integers(0, 6),
        flags=st.integers(0, 255),
        latitude_deg=DEGREES,
        longitude_deg=DEGREES,
        amsl_m=st.floats(-5_000.0, 20_000.0),
        horizontal_mm=st.integers(0, 2**32 - 1),
        vertical_mm=st.integers(0, 2**32 - 1),
        size=st.sampled_from([84, 92]),
    ),
    st.builds(gnss.no_fix_gga),
)


@st.composite
def spoilt(draw: st.DrawFn) -> bytes:
    """A frame with a byte changed, cut off, or repeated."""
    data = bytearray(draw(FRAMES))
    place = draw(st.integers(0, len(data) - 1))
    match draw(st.integers(0, 2)):
        case 0:
            data[place] = draw(st.integers(0, 255))
        case 1:
            del data[place:]
        case _:
            data[place:place] = data[: draw(st.integers(0, len(data)))]
    return bytes(data)


CHUNKS = st.one_of(FRAMES, FRAMES, spoilt(), st.binary(max_size=60), st.just(b""))


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(CHUNKS, st.floats(0.0, 2.0)), max_size=25), st.integers(1, 4))
def test_whatever_comes_the_fixes_are_numbers_and_the_counters_add_up(
    chunks: list[tuple[bytes, float]], confirm_fixes: int
) -> None:
    stream = a_stream(confirm_fixes)
    fixes: list[GnssFix] = []
    now_s = 10.0
    for data, step_s in chunks:
        now_s += step_s
        new = stream.feed(data, now_s) if data else stream.gap()
        assert all(fix.stamp_s <= now_s - 0.1 for fix in new)
        fixes += new
        assert adds_up(stream)
    assert len(fixes) == stream.counts().told
    stamps = [fix.stamp_s for fix in fixes]
    assert stamps == sorted(set(stamps))
    for fix in fixes:
        assert math.isfinite(fix.latitude_deg + fix.longitude_deg + fix.amsl_m)
        assert abs(fix.latitude_deg) <= 90.0
        if fix.fix_type.has_position:
            assert 0.0 < fix.horizontal_accuracy_m <= 1_000.0
            assert 0.0 < fix.vertical_accuracy_m <= 1_000.0


def test_a_clean_stream_at_five_hertz_loses_nothing() -> None:
    stream = a_stream(confirm_fixes=3)
    for step in range(500):
        time_s = 1_000.0 + 0.2 * step
        stream.feed(nav_pvt(time_s, latitude_deg=moved_deg(step)), 50.0 + 0.2 * step)
    counts = stream.counts()
    assert (counts.told, counts.bytes_dropped, counts.leaps) == (500, 0, 0)
