"""Frames out of bytes: none is missed, none is invented, every byte is accounted for."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.gnss.framing import PAYLOAD_MAX, SENTENCE_MAX, Frame, Framer, Protocol
from tests.support.gnss import gga, nav_pvt, sentence, ubx

FRAMES = [gga(36_000.0), nav_pvt(1.0), ubx(0x0A, 0x04, b"text $GNGGA in it\r\n"), ubx(1, 2, b"")]


def contents(frames: list[Frame]) -> list[bytes]:
    return [frame.content for frame in frames]


def bare(data: bytes) -> bytes:
    """A frame as it is handed on: without its line end."""
    return data.removesuffix(b"\r\n") if data[:1] == b"$" else data


def accounted(framer: Framer) -> bool:
    return framer.bytes_taken == framer.bytes_framed + framer.bytes_dropped + framer.bytes_pending


def test_both_protocols_come_from_one_stream() -> None:
    framer = Framer()
    frames = framer.feed(b"".join(FRAMES), 5.0)
    assert contents(frames) == [bare(data) for data in FRAMES]
    assert [frame.protocol for frame in frames] == [Protocol.NMEA] + 3 * [Protocol.UBX]
    assert (framer.bytes_dropped, framer.bytes_pending, framer.frames) == (0, 0, 4)
    assert framer.bytes_framed == sum(map(len, FRAMES))


def test_a_frame_bears_the_time_of_its_first_byte() -> None:
    framer = Framer()
    one, two = gga(1.0), nav_pvt(1.0)
    assert framer.feed(b"noise" + one[:10], 5.0) == []
    assert framer.feed(one[10:20], 6.0) == []
    frames = framer.feed(one[20:] + two[:1], 7.0)
    frames += framer.feed(two[1:], 8.0)
    assert [frame.received_s for frame in frames] == [5.0, 7.0]


@pytest.mark.parametrize("data", FRAMES)
def test_every_flipped_bit_is_noticed(data: bytes) -> None:
    for position in range(len(bare(data)) * 8):
        spoilt = bytearray(data)
        spoilt[position // 8] ^= 1 << position % 8
        framer = Framer()
        frames = framer.feed(bytes(spoilt), 0.0) + framer.gap()
        # The case of a checksum's hexadecimal digit means nothing.
        assert contents(frames) in ([], [bytes(spoilt).removesuffix(b"\r\n")])
        assert not frames or spoilt.upper() == data.upper()
        assert accounted(framer)


def test_a_wrong_checksum_is_counted_and_the_next_frame_is_found() -> None:
    framer = Framer()
    wrong_pvt = nav_pvt(1.0)[:-1] + b"\x00"
    frames = framer.feed(b"$GNGGA,1*00\r\n" + b"$GNGGA,1\r\n" + wrong_pvt + FRAMES[0], 0.0)
    assert contents(frames) == [bare(FRAMES[0])]
    assert framer.checksum_errors == 3
    assert accounted(framer)


def test_binary_data_in_a_sentence_ends_the_sentence_and_not_the_frame() -> None:
    framer = Framer()
    frames = framer.feed(FRAMES[0][:20] + FRAMES[1] + FRAMES[0][:20] + FRAMES[0], 0.0)
    assert contents(frames) == [FRAMES[1], bare(FRAMES[0])]
    assert framer.broken_off == 2
    assert framer.bytes_dropped == 40


def test_a_length_that_cannot_be_is_not_waited_for() -> None:
    framer = Framer()
    huge = b"\xb5\x62\x02\x15" + (PAYLOAD_MAX + 1).to_bytes(2, "little")
    odd_pvt = b"\xb5\x62\x01\x07\x5d\x00"
    assert contents(framer.feed(huge + odd_pvt + FRAMES[1], 0.0)) == [FRAMES[1]]
    assert framer.oversized == 2


def test_the_largest_payload_is_taken() -> None:
    data = ubx(0x02, 0x15, bytes(PAYLOAD_MAX))
    assert contents(Framer().feed(data, 0.0)) == [data]


@pytest.mark.parametrize("excess", [0, 1, 100_000])
def test_a_huge_line_is_dropped_and_does_not_fill_memory(excess: int) -> None:
    framer = Framer()
    body = "GNTXT," + "a" * (SENTENCE_MAX - len("$GNTXT,*00") + excess)
    data = sentence(body)
    frames = framer.feed(data, 0.0)
    assert bool(frames) is (excess == 0)
    assert framer.oversized == (excess > 0)
    framer.feed(b"$" + b"a" * 100_000, 0.0)
    assert framer.bytes_pending <= SENTENCE_MAX


def test_silence_ends_a_frame_that_will_not_end_and_brings_out_what_it_hid() -> None:
    framer = Framer()
    assert framer.feed(b"\xb5\x62\x02\x15\x00\x04" + FRAMES[0] + FRAMES[1], 3.0) == []
    frames = framer.gap()
    assert contents(frames) == [bare(FRAMES[0]), FRAMES[1]]
    assert [frame.received_s for frame in frames] == [3.0, 3.0]
    assert (framer.broken_off, framer.bytes_pending) == (1, 0)
    assert accounted(framer)


def test_what_is_abandoned_is_not_continued() -> None:
    framer = Framer()
    framer.feed(FRAMES[0][:20], 0.0)
    framer.abandon()
    assert framer.feed(FRAMES[0][20:], 0.0) == []
    assert (framer.broken_off, framer.bytes_dropped) == (1, len(FRAMES[0]))


def test_a_line_end_belongs_to_its_sentence_and_to_no_other() -> None:
    framer = Framer()
    framer.feed(bare(FRAMES[0]) + b"\n\n", 0.0)
    assert framer.bytes_dropped == 1
    framer.feed(bare(FRAMES[0]) + b"\r", 0.0)
    framer.abandon()
    framer.feed(b"\n", 0.0)
    assert framer.bytes_dropped == 2


PIECES = st.one_of(
    st.sampled_from(FRAMES),
    st.binary(max_size=40),
    st.sampled_from([b"\xb5", b"\xb5\x62", b"$", b"$G", b"\r", b"\n", b"\xb5\x62\x01\x07\x5c\x00"]),
    st.builds(lambda data, cut: data[:cut], st.sampled_from(FRAMES), st.integers(0, 90)),
)


@settings(deadline=None, max_examples=150)
@given(st.lists(PIECES, max_size=12), st.lists(st.integers(1, 60), max_size=60))
def test_frames_and_counts_do_not_depend_on_how_the_bytes_are_cut(
    pieces: list[bytes], cuts: list[int]
) -> None:
    data = b"".join(pieces)
    whole, cut = Framer(), Framer()
    at_once = contents(whole.feed(data, 0.0))
    in_pieces: list[bytes] = []
    start = 0
    for size in [*cuts, len(data)]:
        in_pieces += contents(cut.feed(data[start : start + size], 0.0))
        start += size
        assert accounted(cut)
    assert in_pieces == at_once
    for name in (
        "bytes_taken",
        "bytes_framed",
        "bytes_dropped",
        "frames",
        "checksum_errors",
        "oversized",
        "broken_off",
    ):
        assert getattr(cut, name) == getattr(whole, name), name


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=200).filter(lambda b: b"$" not in b and b"\xb5" not in b))
def test_a_frame_after_any_garbage_is_found(garbage: bytes) -> None:
    framer = Framer()
    found = contents(framer.feed(garbage + FRAMES[1] + garbage + FRAMES[0], 0.0))
    assert found == [FRAMES[1], bare(FRAMES[0])]
