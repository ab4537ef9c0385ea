"""Virtual beams as messages: what PX4 and a ground station are shown, and what they are not."""

import json

import pytest

from hal.config import BeamsConfig
from hal.ranging.told_beams import INTERVAL_S, BeamTeller
from hal.readings import RangeReading, RangeStatus

UNKNOWN_CM = 65_535
NAMES = ("front", "right", "back", "left", "up", "down")


class Written:
    """A `hal.interfaces.MessageSink` that keeps what it was given."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, dict[str, object]]] = []

    def send_message(self, name: str, fields_json: str) -> None:
        self.messages.append((name, json.loads(fields_json)))

    def of(self, name: str) -> list[dict[str, object]]:
        return [fields for sent, fields in self.messages if sent == name]


def reading(
    beam: str, range_m: float = 0.5, status: RangeStatus = RangeStatus.VALID, stamp_s: float = 1.0
) -> RangeReading:
    return RangeReading(stamp_s, beam, status, range_m, 0.0004, 0.02, 1.0)


def told(*readings: RangeReading) -> Written:
    sink = Written()
    BeamTeller(sink, BeamsConfig()).tell(readings)
    return sink


def test_what_looks_down_is_never_told() -> None:
    sink = told(*(reading(name) for name in NAMES))
    orientations = {fields["orientation"] for fields in sink.of("DISTANCE_SENSOR")}
    assert orientations == {0, 2, 4, 6, 24}
    assert told(reading("down")).messages == []


@pytest.mark.parametrize(
    ("status", "range_m", "centimetres", "quality"),
    [
        (RangeStatus.VALID, 0.537, 54, 100),
        (RangeStatus.OUT_OF_RANGE, 1.0, 101, 100),
        (RangeStatus.TOO_NEAR, 0.02, 1, 100),
        (RangeStatus.NO_SIGNAL, 0.0, 0, 1),
    ],
)
def test_a_status_has_its_number(
    status: RangeStatus, range_m: float, centimetres: int, quality: int
) -> None:
    (fields,) = told(reading("left", range_m, status)).of("DISTANCE_SENSOR")
    assert fields["current_distance"] == centimetres
    assert fields["signal_quality"] == quality
    assert (fields["min_distance"], fields["max_distance"]) == (2, 100)
    assert fields["covariance"] == 4


def test_obstacle_distance_knows_the_sectors_that_are_looked_into_and_no_other() -> None:
    beams = (
        reading("front", 0.4),
        reading("right", 1.0, RangeStatus.OUT_OF_RANGE),
        reading("back", 0.0, RangeStatus.NO_SIGNAL),
        reading("up", 0.3),
    )
    (fields,) = told(*beams).of("OBSTACLE_DISTANCE")
    distances = fields["distances"]
    assert isinstance(distances, list)
    assert len(distances) == 72
    known = {number: cm for number, cm in enumerate(distances) if cm != UNKNOWN_CM}
    assert known == {0: 40, 18: 101}
    assert (fields["frame"], fields["increment"]) == (12, 5)


def test_no_more_is_sent_than_px4_passes_on() -> None:
    sink = Written()
    teller = BeamTeller(sink, BeamsConfig())
    for tick in range(41):
        teller.tell([reading("front", 0.5 + tick * 0.01, stamp_s=5.0 + tick * 0.05)])
    sent = sink.of("DISTANCE_SENSOR")
    assert [fields["current_distance"] for fields in sent[:2]] == [50, 52]
    assert len(sent) == pytest.approx(40 * 0.05 / INTERVAL_S, abs=1)
    assert sent[-1]["current_distance"] in (89, 90)
    assert len(sink.of("OBSTACLE_DISTANCE")) == len(sent)
