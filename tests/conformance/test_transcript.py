"""The suite notices what it is there to notice."""

import math

from tests.conformance.conftest import reference_scenario
from tests.conformance.link import MockLink
from tests.conformance.transcript import Expected, Options, Row, Seen, compare, sequences
from tests.conformance.vehicle import Vehicle

EXPECTED = [
    Expected(0.0, "ack", "400 0"),
    Expected(0.0, "text", "6 Armed\t"),
    Expected(5.0, "text", "6 Landing detected\t", Options(tolerance=1.0)),
    Expected(7.0, "text", "6 Disarmed at # m\t", Options(since="Landing detected")),
    Expected(0.5, "heartbeat", "157 HOLD 4", Options(brief=True)),
    Expected(1.5, "heartbeat", "157 LAND 4"),
]
SEEN = [
    Seen(0.01, "ack", "400 0"),
    Seen(0.02, "text", "6 Armed\t"),
    Seen(5.9, "text", "6 Landing detected\t"),
    Seen(7.9, "text", "6 Disarmed at 12 m\t"),
    Seen(1.1, "heartbeat", "157 LAND 4"),
]


def off(seen: list[Seen]) -> list[Row]:
    return [row for row in compare(EXPECTED, seen) if row.share > 1.0]


def test_what_is_as_measured_passes_also_without_its_brief_states() -> None:
    assert off(SEEN) == []
    brief = Seen(0.3, "heartbeat", "157 HOLD 4")
    assert off([*SEEN[:4], brief, SEEN[4]]) == []


def test_missing_surplus_late_and_other_words_are_noticed() -> None:
    (missing,) = off(SEEN[1:])
    assert math.isnan(missing.seen_s)
    (surplus,) = off([*SEEN, Seen(2.0, "text", "6 Something else\t")])
    assert math.isnan(surplus.measured_s)
    (late,) = off([Seen(0.2, "ack", "400 0"), *SEEN[1:]])
    assert late.seen_s == 0.2
    assert len(off([Seen(0.0, "ack", "400 1"), *SEEN[1:]])) == 2


def test_order_counts_within_a_channel_only() -> None:
    assert off(sorted(SEEN, key=lambda s: s.channel)) == []
    swapped = [SEEN[0], SEEN[2]._replace(at_s=0.0), SEEN[1], *SEEN[3:]]
    assert off(swapped) != []


def test_a_time_since_an_anchor_follows_the_anchor() -> None:
    assert off([*SEEN[:3], SEEN[3]._replace(at_s=7.0), SEEN[4]])[0].what.startswith("6 Disarmed")


def test_an_autopilot_that_disarms_early_does_not_conform() -> None:
    link = MockLink(reference_scenario())
    try:
        link.plant.autopilot.set_parameter("COM_DISARM_PRFLT", 9.0)
        sequence = next(s for s in sequences() if s.name == "arm_again_and_auto_disarm")
        rows = compare(sequence.seen, Vehicle(link, {}).play(sequence))
        late = [row for row in rows if row.share > 1.0 and row.channel == "text"]
        assert [row.what for row in late] == ["6 Disarmed by auto preflight disarming\t"]
    finally:
        link.close()
