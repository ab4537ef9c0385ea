"""GPS_RAW_INT to fixes: accuracies are honest, nonsense is refused and counted."""

import pytest

from hal.errors import ReadingRefused
from hal.gnss.autopilot_gnss import GpsRawInt
from hal.readings import FixType


def gps(**changes: int) -> GpsRawInt:
    fields = {
        "time_usec": 2_303_276_000,
        "fix_type": 3,
        "lat": 473_981_442,
        "lon": 85_456_036,
        "alt": 489_405,
        "eph": 70,
        "epv": 110,
        "satellites_visible": 10,
        "h_acc": 900,
        "v_acc": 1780,
    } | changes
    return GpsRawInt(**fields)


def test_a_measured_message_becomes_a_fix() -> None:
    fix = gps().reading(5.0)
    assert (fix.stamp_s, fix.fix_type, fix.satellites) == (5.0, FixType.FIX_3D, 10)
    assert fix.latitude_deg == pytest.approx(47.3981442)
    assert fix.longitude_deg == pytest.approx(8.5456036)
    assert fix.amsl_m == pytest.approx(489.405)
    assert fix.horizontal_accuracy_m == pytest.approx(0.9)
    assert fix.vertical_accuracy_m == pytest.approx(1.78)


@pytest.mark.parametrize(
    ("number", "fix_type"),
    [
        (0, FixType.NO_GPS),
        (1, FixType.NO_FIX),
        (2, FixType.FIX_2D),
        (4, FixType.DGPS),
        (5, FixType.RTK_FLOAT),
        (6, FixType.RTK_FIXED),
        (7, FixType.FIX_3D),
        (8, FixType.DGPS),
    ],
)
def test_fix_types_are_translated(number: int, fix_type: FixType) -> None:
    assert gps(fix_type=number).reading(0.0).fix_type is fix_type


def test_an_accuracy_that_was_not_sent_comes_from_the_dilution() -> None:
    fix = gps(h_acc=0, v_acc=0).reading(0.0)
    assert fix.horizontal_accuracy_m == pytest.approx(2.8)
    assert fix.vertical_accuracy_m == pytest.approx(4.4)


def test_no_fix_is_told_with_a_useless_accuracy() -> None:
    fix = gps(fix_type=1, lat=0, lon=0, alt=0, h_acc=0, v_acc=0, eph=65535, epv=65535).reading(0.0)
    assert not fix.fix_type.has_position
    assert fix.horizontal_accuracy_m >= 1e4


@pytest.mark.parametrize(
    "changes",
    [
        {"fix_type": 9},
        {"lat": 0, "lon": 0},
        {"lat": 910_000_000},
        {"lon": -1_810_000_000},
        {"alt": 20_000_000},
        {"alt": -2_000_000},
        {"h_acc": 2_000_000},
        {"v_acc": 0, "epv": 65535},
    ],
)
def test_a_fix_that_cannot_be_is_refused(changes: dict[str, int]) -> None:
    with pytest.raises(ReadingRefused):
        gps(**changes).reading(0.0)


def test_unknown_satellites_are_none_to_count_on() -> None:
    assert gps(satellites_visible=255).reading(0.0).satellites == 0
