"""NAV-PVT to solutions."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.gnss import ubx as driver
from hal.gnss.solution import Solution
from hal.readings import FixType
from tests.support import gnss
from tests.support.gnss import LATITUDE_DEG, LONGITUDE_DEG, nav_pvt


def decoded(frame: bytes) -> Solution:
    solution = driver.decode(frame, 10.0)
    assert solution is not None
    return solution


@pytest.mark.parametrize("size", [84, 92])
def test_the_fields_come_in_their_units(size: int) -> None:
    solution = decoded(nav_pvt(345_600.2, size=size))
    assert solution.latitude_deg == pytest.approx(LATITUDE_DEG, abs=1e-9)
    assert solution.longitude_deg == pytest.approx(LONGITUDE_DEG, abs=1e-9)
    assert solution.amsl_m == pytest.approx(489.4)
    assert solution.epoch_s == pytest.approx(345_600.2)
    assert solution.period_s == 604_800.0
    assert solution.horizontal_accuracy_m == pytest.approx(0.9)
    assert solution.vertical_accuracy_m == pytest.approx(1.78)
    assert (solution.received_s, solution.satellites) == (10.0, 14)


@pytest.mark.parametrize(
    ("fix", "flags", "fix_type"),
    [
        (0, 0x01, FixType.NO_FIX),
        (1, 0x01, FixType.NO_FIX),  # dead reckoning
        (2, 0x01, FixType.FIX_2D),
        (3, 0x01, FixType.FIX_3D),
        (3, 0x00, FixType.NO_FIX),  # not usable, says the receiver
        (3, 0x03, FixType.DGPS),
        (3, 0x43, FixType.RTK_FLOAT),
        (3, 0x83, FixType.RTK_FIXED),
        (3, 0x82, FixType.NO_FIX),
        (3, 0xC1, FixType.FIX_3D),  # reserved
        (4, 0x01, FixType.FIX_3D),
        (5, 0x01, FixType.NO_FIX),  # time only
        (6, 0x01, FixType.NO_FIX),
        (255, 0xFF, FixType.NO_FIX),
    ],
)
def test_fix_types_are_translated(fix: int, flags: int, fix_type: FixType) -> None:
    assert decoded(nav_pvt(1.0, fix, flags=flags)).fix_type is fix_type


def test_a_place_that_the_receiver_calls_invalid_is_none() -> None:
    assert decoded(nav_pvt(1.0, flags3=1)).fix_type is FixType.NO_FIX


def test_only_nav_pvt_is_read() -> None:
    assert driver.is_solution(nav_pvt(1.0))
    assert not driver.is_solution(gnss.ubx(0x01, 0x35, b""))
    assert not driver.is_solution(gnss.ubx(0x07, 0x01, b""))


@settings(deadline=None, max_examples=150)
@given(st.binary(min_size=92, max_size=92) | st.binary(min_size=84, max_size=84))
def test_any_payload_of_a_checked_frame_is_read_or_refused(payload: bytes) -> None:
    solution = driver.decode(gnss.ubx(0x01, 0x07, payload), 0.0)
    if solution is None:
        return
    (longitude,) = struct.unpack_from("<i", payload, 24)
    assert solution.longitude_deg == pytest.approx(longitude * 1e-7, abs=1e-9)
