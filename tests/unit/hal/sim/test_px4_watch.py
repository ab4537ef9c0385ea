import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.sim.px4_watch import Change, GnssWatch, HeartbeatWatch
from tests.support.px4 import Flight

TICK_S = 0.01
LIMIT_S = 10.0


def watch_heartbeats(beats_s: list[float], until_s: float) -> list[tuple[float, Change]]:
    """Changes noticed while heartbeats come at those times."""
    watch, changes, pending = HeartbeatWatch(), [], sorted(beats_s)
    for tick in range(round(until_s / TICK_S)):
        now_s = tick * TICK_S
        while pending and pending[0] <= now_s:
            watch.hear(pending.pop(0))
        change = watch.step(now_s, LIMIT_S)
        if change is not None:
            changes.append((now_s, change))
    return changes


def test_who_was_never_there_is_not_missed() -> None:
    assert watch_heartbeats([], 40.0) == []


def test_a_first_appearance_is_no_return() -> None:
    assert watch_heartbeats([float(s) for s in range(30)], 30.0) == []


def test_a_partner_is_missed_twelve_seconds_after_its_last_heartbeat_and_welcomed_back() -> None:
    beats = [0.0, 1.0, 2.0, 30.0]
    (lost_s, lost), (back_s, back) = watch_heartbeats(beats, 35.0)
    assert (lost, back) == (Change.LOST, Change.BACK)
    assert lost_s == pytest.approx(2.0 + 11.6, abs=0.05)
    assert back_s == pytest.approx(30.0, abs=0.02)


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(0.0, 60.0), max_size=12))
def test_lost_and_back_take_turns(beats_s: list[float]) -> None:
    kinds = [change for _, change in watch_heartbeats(beats_s, 80.0)]
    expected = [Change.LOST, Change.BACK] * len(kinds)
    assert kinds == expected[: len(kinds)]
    assert bool(kinds) == bool(beats_s)


def watch_fixes(gone_s: float, back_s: float, until_s: float) -> tuple[list[float], list[float]]:
    """(times of complaints, times at which the position was lost or taken back)."""
    watch, complaints, changes = GnssWatch(), [], []
    for tick in range(round(until_s / TICK_S)):
        now_s = tick * TICK_S
        complains, change = watch.step(now_s, fix=not gone_s <= now_s < back_s)
        complaints += [now_s] if complains else []
        changes += [now_s] if change is not None else []
    return complaints, changes


def test_without_a_fix_it_complains_and_gives_the_position_up_as_measured() -> None:
    complaints, changes = watch_fixes(1.0, 11.0, 20.0)
    assert [c - 1.0 for c in complaints] == pytest.approx([1.1, 5.1, 7.2], abs=0.02)
    assert changes == pytest.approx([1.0 + 5.1, 11.0 + 2.5], abs=0.02)


def test_a_short_gap_costs_a_complaint_at_most() -> None:
    assert watch_fixes(1.0, 1.9, 10.0) == ([], [])
    complaints, changes = watch_fixes(1.0, 4.0, 10.0)
    assert len(complaints) == 1
    assert changes == []


def station(flight: Flight, seconds: float) -> None:
    """Fly on with a ground station's heartbeat every second and zero velocity setpoints."""
    send = flight.velocity(0.0)
    for _ in range(round(seconds)):
        flight.pilot.ground_station.hear(flight.pilot.now_s)
        flight.fly(1.0, send)


def test_a_lost_ground_station_holds_then_returns_when_told_to() -> None:
    flight = Flight(0.2, NAV_DLL_ACT=2)
    flight.pilot.ground_station.hear(0.0)
    flight.fly(0.1)
    flight.take_off()
    station(flight, 2.0)
    flight.velocity(0.0)()
    assert flight.pilot.set_mode(6) == 0
    station(flight, 2.0)
    lost_after_s = flight.pilot.now_s
    while not flight.in_failsafe():
        flight.fly(0.05, flight.velocity(0.0))
        assert flight.pilot.now_s - lost_after_s < 15.0
    assert flight.mode().name == "HOLD"
    assert "Failsafe activated: entering Hold for 5 seconds" in flight.texts()
    flight.fly(4.8, flight.velocity(0.0))
    assert flight.mode().name == "HOLD"
    flight.fly(0.4, flight.velocity(0.0))
    assert flight.mode().name == "RETURN"


def test_setpoints_do_not_end_the_failsafe_of_a_lost_ground_station() -> None:
    flight = Flight(0.2, NAV_DLL_ACT=1)
    flight.pilot.ground_station.hear(0.0)
    flight.fly(0.1)
    flight.take_off()
    flight.pilot.ground_station.hear(flight.pilot.now_s)
    flight.velocity(0.0)()
    assert flight.pilot.set_mode(6) == 0
    flight.fly(20.0, flight.velocity(0.1))
    assert flight.in_failsafe()
    assert flight.mode().name == "HOLD"


def test_flight_termination_cuts_the_motors_for_good() -> None:
    flight = Flight(0.2)
    flight.take_off()
    assert flight.pilot.terminate() == 0
    assert flight.status() == 8
    flight.fly(2.0)
    assert flight.height_m == 0.0
    assert flight.pilot.base_mode == 129
