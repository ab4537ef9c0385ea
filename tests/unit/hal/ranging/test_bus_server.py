"""Several sensors on one bus: each measures, is lost, and comes back; nobody speaks for another."""

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.clock import SimClock
from hal.ranging.quarantine import Quarantine
from hal.readings import RangeReading, RangeStatus
from tests.support import i2c_rig
from tests.support.fake_tof import Target, still
from tests.support.i2c_rig import NAMES, Bench
from tests.unit.hal.ranging.served import Served, of

RANGES_M = {beam: 0.20 + 0.1 * number for number, beam in enumerate(NAMES)}
WIRINGS = (i2c_rig.behind_a_multiplexer, i2c_rig.with_xshut_lines)


def distinct(wire: Callable[[SimClock], Bench]) -> Callable[[SimClock], Bench]:
    """Every beam sees something else, so that a mix-up shows."""

    def wired(clock: SimClock) -> Bench:
        bench = wire(clock)
        for beam, tof in bench.tofs.items():
            tof.view = still(RANGES_M[beam])
        return bench

    return wired


def assert_true(readings: list[RangeReading]) -> None:
    for reading in readings:
        if reading.status is RangeStatus.VALID:
            assert reading.range_m == pytest.approx(RANGES_M[reading.beam], abs=1e-3), reading.beam


def assert_all_measure(served: Served, seconds: float = 1.0) -> None:
    readings = served.run(seconds)
    for beam in NAMES:
        assert len(of(readings, beam)) >= 15 * seconds, served.station(beam).trouble
    assert_true(readings)
    assert all(served.station(beam).trouble == "" for beam in NAMES)


@pytest.fixture(params=WIRINGS, ids=lambda wire: wire.__name__)
def served(request: pytest.FixtureRequest) -> Served:
    started = Served(distinct(request.param))
    started.run(2.0)
    return started


def test_six_sensors_measure_at_more_than_the_loops_rate(served: Served) -> None:
    readings = served.run(5.0)
    for beam in NAMES:
        assert len(of(readings, beam)) > 20 * 5
    assert_true(readings)
    assert served.bench.mux.most_connected <= 1


def test_sensors_with_lines_are_given_their_addresses_one_after_another() -> None:
    served = Served(distinct(i2c_rig.with_xshut_lines))
    served.run(2.0)
    assert [served.bench.tofs[beam].address for beam in NAMES] == [0x30 + n for n in range(6)]
    assert served.bench.bus.crowd == 1
    assert [served.station(beam).starts for beam in NAMES] == [1] * 6


def test_stamps_rise_and_are_in_the_middle_of_the_measurement(served: Served) -> None:
    for beam in NAMES:
        stamps = [reading.stamp_s for reading in of(served.run(1.0), beam)]
        assert stamps == sorted(set(stamps))
    now_s = served.clock.now_s()
    assert all(reading.stamp_s < now_s - 0.01 for reading in served.readings)


def test_single_refusals_of_the_bus_cost_no_restart(served: Served) -> None:
    starts = [served.station(beam).starts for beam in NAMES]
    for _ in range(20):
        for beam in NAMES:
            served.bench.bus.nacks[served.bench.tofs[beam].address] = 1
        served.run(0.1)
    assert [served.station(beam).starts for beam in NAMES] == starts
    assert sum(served.station(beam).errors for beam in NAMES) >= 20
    assert_all_measure(served)


def test_a_reset_chip_is_recognised_and_started_anew(served: Served) -> None:
    before = served.station("left").starts
    served.bench.tofs["left"].restart()
    readings = served.run(1.0)
    assert served.station("left").starts > before
    assert len(of(readings, "left")) > 8
    assert_true(readings)
    assert_all_measure(served)


def test_a_chip_that_freezes_is_started_anew(served: Served) -> None:
    chip = served.bench.tofs["back"]
    before = served.station("back").starts
    chip.frozen = True
    served.run(0.6)
    assert served.station("back").starts > before
    assert served.station("back").trouble
    chip.frozen = False
    served.run(2.0)
    assert_all_measure(served)


def test_a_lost_chip_is_silent_and_the_others_do_not_wait_for_it(served: Served) -> None:
    served.bench.tofs["up"].powered = False
    served.run(0.3)
    readings = served.run(5.0)
    assert of(readings, "up") == []
    assert served.station("up").trouble
    for beam in NAMES[:4]:
        stamps = [reading.stamp_s for reading in of(readings, beam)]
        assert max(b - a for a, b in pairwise(stamps)) < 0.08, beam
    served.bench.tofs["up"].powered = True
    served.run(2.0)
    assert_all_measure(served)


def test_a_dip_of_the_supply_resets_all_and_all_come_back_as_themselves(served: Served) -> None:
    for tof in served.bench.tofs.values():
        tof.restart()
    served.bench.mux.brown_out()
    assert_true(served.run(3.0))
    assert_all_measure(served)


def test_a_multiplexer_that_lost_its_channel_is_told_again() -> None:
    served = Served(distinct(i2c_rig.behind_a_multiplexer))
    served.run(1.0)
    for _ in range(10):
        served.bench.mux.brown_out()
        served.run(0.05)
    assert_all_measure(served)


def test_a_bus_that_a_sensor_holds_low_is_freed_by_its_line() -> None:
    served = Served(distinct(i2c_rig.with_xshut_lines))
    served.run(2.0)
    culprit = served.bench.tofs["right"]
    resets = culprit.resets
    served.bench.bus.holder = lambda: culprit.resets == resets and culprit.enabled
    served.run(2.0)
    assert served.server.rescues >= 1
    assert served.bench.bus.reopened >= 1
    assert_all_measure(served)


def test_a_bus_that_is_held_behind_a_multiplexer_is_freed_by_its_reset() -> None:
    held = {"low": False}

    def reset(high: bool) -> None:
        if not high:
            held["low"] = False

    def wire(clock: SimClock) -> Bench:
        bench = distinct(i2c_rig.behind_a_multiplexer)(clock)
        bench.mux_reset, bench.lines["gpiochip0/4"] = "gpiochip0/4", reset
        bench.bus.holder = lambda: held["low"]
        return bench

    served = Served(wire)
    served.run(1.0)
    held["low"] = True
    served.run(1.5)
    assert not held["low"]
    assert_all_measure(served)


def shorted(channel: int, since_s: float = 0.0) -> tuple[Served, dict[str, bool]]:
    """Six sensors behind a multiplexer with a reset line; behind `channel` SDA is at ground."""
    short = {"there": since_s == 0.0}

    def wire(clock: SimClock) -> Bench:
        bench = distinct(i2c_rig.behind_a_multiplexer)(clock)
        bench.mux_reset = "gpiochip0/4"
        bench.lines["gpiochip0/4"] = lambda high: None if high else bench.mux.brown_out()
        bench.bus.holder = lambda: short["there"] and bool(bench.mux.mask >> channel & 1)
        return bench

    served = Served(wire)
    served.run(since_s)
    short["there"] = True
    return served, short


@pytest.mark.parametrize("since_s", [0.0, 1.0])
def test_a_short_behind_one_channel_takes_one_beam_only(since_s: float) -> None:
    served, short = shorted(2, since_s)
    served.run(1.5)
    starts = {beam: served.station(beam).starts for beam in NAMES}
    readings = served.run(60.0)
    guilty = served.station("back")
    assert of(readings, "back") == []
    assert "channel 2 of 0x70 holds the bus low" in guilty.trouble
    assert served.server.rescues <= 6
    for beam in NAMES:
        if beam != "back":
            stamps = [reading.stamp_s for reading in of(readings, beam)]
            assert max(b - a for a, b in pairwise(stamps)) < 0.3, beam
            assert served.station(beam).starts == starts[beam], beam
    short["there"] = False
    served.run(80.0)
    assert_all_measure(served)


def test_a_channel_that_behaves_again_is_forgiven() -> None:
    quarantine = Quarantine()
    assert not quarantine.knows((0x70, 1), 0.0)
    assert [quarantine.blame((0x70, 1), now_s) for now_s in (0.0, 1.0, 6.0, 25.0)] == [0, 4, 16, 64]
    assert quarantine.blame((0x70, 2), 26.0) == 0.0
    assert quarantine.knows((0x70, 1), 148.0)
    assert not quarantine.knows((0x70, 1), 150.0)
    assert quarantine.blame((0x70, 1), 150.0) == 0.0
    pauses = [quarantine.blame((0x70, 1), 150.0 + 400.0 * k / 10.0) for k in range(1, 9)]
    assert max(pauses) == 300.0


def test_while_one_is_addressed_nobody_else_listens_at_the_power_up_address() -> None:
    """Also when all were reset and the first is addressed before the others are missed."""
    served = Served(distinct(i2c_rig.with_xshut_lines))
    served.run(1.0)
    for tof in served.bench.tofs.values():
        tof.restart()
    served.bench.bus.crowd = 0
    served.run(1.0)
    assert served.bench.bus.crowd == 1
    assert_all_measure(served)


def test_a_held_bus_without_a_remedy_is_tried_again_now_and_then() -> None:
    served = Served(distinct(i2c_rig.behind_a_multiplexer))
    served.run(1.0)
    served.bench.bus.holder = lambda: True
    before = served.bench.bus.transfers
    assert served.run(5.0) == [] or served.run(5.0) == []
    assert served.bench.bus.transfers - before < 500
    served.bench.bus.holder = None
    served.run(3.0)
    assert_all_measure(served)


def test_another_chip_is_told_in_words_and_the_others_measure() -> None:
    def wire(clock: SimClock) -> Bench:
        bench = distinct(i2c_rig.behind_a_multiplexer)(clock)
        wrong = bench.tofs["down"]
        wrong.model = 0x1234
        wrong.reset()
        return bench

    served = Served(wire)
    readings = served.run(3.0)
    assert "says 1234" in served.station("down").trouble
    assert served.station("down").refusals >= 2
    assert of(readings, "down") == []
    assert len(of(readings, "front")) > 40


def test_a_laser_that_fails_is_no_signal_and_is_started_anew(served: Served) -> None:
    chip = served.bench.tofs["front"]
    fault = 3
    chip.view = lambda _now_s: Target(0.2, code=fault)
    before = served.station("front").starts
    readings = of(served.run(1.0), "front")
    assert {r.status for r in readings[1:]} == {RangeStatus.NO_SIGNAL}
    assert served.station("front").starts > before
    chip.view = still(RANGES_M["front"])
    served.run(1.5)
    assert_all_measure(served)


def test_ending_stops_every_sensor(served: Served) -> None:
    served.server.end()
    served.clock.advance(0.5)
    counts = [tof.measured for tof in served.bench.tofs.values()]
    served.clock.advance(1.0)
    for tof in served.bench.tofs.values():
        tof.run()
    assert [tof.measured for tof in served.bench.tofs.values()] == counts


FAULTS = st.sampled_from(["nack", "restart", "freeze", "power", "mux", "held", "all", "nothing"])


@settings(deadline=None, max_examples=6)
@given(
    st.sampled_from(WIRINGS),
    st.lists(st.tuples(FAULTS, st.sampled_from(NAMES), st.floats(0.001, 0.4)), max_size=8),
)
def test_after_any_faults_every_beam_tells_the_truth_again(
    wire: Callable[[SimClock], Bench], faults: list[tuple[str, str, float]]
) -> None:
    served = Served(distinct(wire))
    served.run(0.8)
    for fault, beam, seconds in faults:
        chip = served.bench.tofs[beam]
        strike(served, fault, beam)
        assert_true(served.run(seconds))
        chip.frozen, chip.powered = False, True
        served.bench.bus.nacks.clear()
        served.bench.bus.holder = None
    assert_true(served.run(2.5))
    assert_all_measure(served, 0.6)


def strike(served: Served, fault: str, beam: str) -> None:
    chip = served.bench.tofs[beam]
    if fault == "nack":
        served.bench.bus.nacks[chip.address] = 5
    elif fault == "restart":
        chip.restart()
    elif fault == "freeze":
        chip.frozen = True
    elif fault == "power":
        chip.powered = False
        chip.restart()
    elif fault == "mux":
        served.bench.mux.brown_out()
    elif fault == "held":
        served.bench.bus.holder = lambda: True
    elif fault == "all":
        for tof in served.bench.tofs.values():
            tof.restart()
