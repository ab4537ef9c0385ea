"""Serial GNSS: bytes that are nearly NMEA, nearly UBX, or noise, cut anywhere."""

import math
import struct
from functools import reduce
from operator import xor

import numpy as np

from hal.gnss.stream import GnssStream
from tools.fuzz.cases import Tally, Target, pieces, require, spoilt

_SENTENCES = (
    "GNGGA,100000.00,4723.888652,N,00832.736216,E,1,12,0.80,489.400,M,47.3,M,,",
    "GNRMC,100000.00,A,4723.888652,N,00832.736216,E,0.01,,221126,,,A,V",
    "GNGST,100000.00,1.2,,,,0.9,0.9,1.5",
    "GNGSA,A,3,01,02,03,04,,,,,,,,,1.2,0.8,0.9,1",
    "GNGGA,,,,,,0,00,99.99,,,,,,",
    "GPTXT,01,01,02,u-blox ag",
)
_ABSURD = (
    *("", "nan", "inf", "-inf", "1e38", "-1", "99999999999", "0x10", "9" * 60, "4723.9e3", "é"),
    *("-0", "N", "E", "240000.00", "235960.00", "000000.001", "9100.0", "18100.0", "..", "--1"),
)
_NAV_PVT_AT = {"lon": (24, "<i"), "lat": (28, "<i"), "hmsl": (36, "<i"), "hacc": (40, "<I")}
_WORDS = (0, 1, 0x7F, 0x80, 0xFF)


def _sentence(rng: np.random.Generator) -> bytes:
    fields = _SENTENCES[int(rng.integers(len(_SENTENCES)))].split(",")
    for _ in range(int(rng.integers(4))):
        at = int(rng.integers(len(fields)))
        match int(rng.integers(4)):
            case 0:
                fields[at] = _ABSURD[int(rng.integers(len(_ABSURD)))]
            case 1:
                fields[at] = spoilt(rng, fields[at].encode()).decode("latin-1")
            case 2:
                del fields[at:]
                fields.append("")
            case _:
                fields.insert(at, fields[at])
    body = ",".join(fields).encode("latin-1")
    return b"$%s*%02X\r\n" % (body, reduce(xor, body, 0))


def _ubx_frame(content: bytes) -> bytes:
    first = second = 0
    for byte in content:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return b"\xb5\x62" + content + bytes((first, second))


def _nav_pvt(rng: np.random.Generator) -> bytes:
    """A frame with a correct checksum and any fields, many of them at their limits."""
    payload = bytearray(92)
    struct.pack_into("<I", payload, 0, int(rng.integers(2**32)))
    payload[20], payload[21], payload[23] = 3, 1, 12
    for at, kind in _NAV_PVT_AT.values():
        low, high = (0, 2**32) if kind == "<I" else (-(2**31), 2**31)
        value = int(rng.integers(low, high)) if rng.random() < 0.5 else 473_981_442
        struct.pack_into(kind, payload, at, value)
    for _ in range(int(rng.integers(6))):
        payload[int(rng.integers(len(payload)))] = _WORDS[int(rng.integers(len(_WORDS)))]
    size = (92, 84, 0, 91, int(rng.integers(120)))[int(rng.integers(5))]
    body = bytes(payload[:size]) + bytes(max(0, size - 92))
    told = size if rng.random() < 0.9 else int(rng.integers(2**16))
    return _ubx_frame(b"\x01\x07" + struct.pack("<H", told) + body)


def _stream(rng: np.random.Generator, frame: str) -> bytes:
    parts: list[bytes] = []
    for _ in range(int(rng.integers(1, 30))):
        data = _sentence(rng) if frame == "nmea" else _nav_pvt(rng)
        match int(rng.integers(6)):
            case 0:
                data = spoilt(rng, data)
            case 1:
                data = rng.bytes(int(rng.integers(1, 60)))
            case 2 if parts:
                data = parts[int(rng.integers(len(parts)))]  # said again, later
        parts.append(data)
    return b"".join(parts)


def run(case: bytes) -> Tally:
    """The bytes in chunks of sizes that follow from themselves, 30 ms apart, with silences."""
    stream = GnssStream(latency_s=0.1, range_error_m=4.0, frozen_after_s=5.0, confirm_fixes=1)
    now_s, at, fixes = 1000.0, 0, []
    while at < len(case):
        size = 1 + case[at] % 61
        now_s += 0.03
        fixes += stream.feed(case[at : at + size], now_s)
        if size % 7 == 0:
            now_s += 0.2
            fixes += stream.gap()
        at += size
    fixes += stream.gap()
    for fix in fixes:
        numbers = (fix.stamp_s, fix.latitude_deg, fix.longitude_deg, fix.amsl_m)
        accuracies = (fix.horizontal_accuracy_m, fix.vertical_accuracy_m)
        require(all(map(math.isfinite, (*numbers, *accuracies))), f"{fix} is not finite")
        require(fix.stamp_s <= now_s, f"{fix} is from the future")
        require(fix.satellites >= 0, f"{fix} counts satellites below zero")
    counts = stream.counts()
    require(
        counts.bytes_taken == len(case)
        and counts.bytes_taken == counts.bytes_framed + counts.bytes_dropped + counts.bytes_pending,
        "a byte is in none of the counters",
    )
    require(
        counts.frames == counts.ignored + counts.unreadable + counts.read,
        "a frame is in none of the counters",
    )
    return Tally({"read": counts.read, "told": counts.told, **counts.lost()})


NMEA = Target("nmea", lambda rng: _stream(rng, "nmea"), run, pieces)
UBX = Target("ubx", lambda rng: _stream(rng, "ubx"), run, pieces)
