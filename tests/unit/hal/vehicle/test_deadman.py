"""The deadman's rule on a simulated clock, and its thread without waiting for wall-clock time."""

import logging
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.clock import SimClock
from hal.config import DeadmanConfig
from hal.vehicle.deadman import Deadman, DeadmanRule, Watch

CONFIG = DeadmanConfig(timeout_s=0.25, hold_after_s=1.0)


class Calls:
    """Counts the deadman's actions on a vehicle that is in Offboard until the Hold number
    `granted`; the first `failures` calls of on_dead raise."""

    def __init__(self, failures: int = 0, granted: int = 1) -> None:
        self.stops = 0
        self.holds = 0
        self.offboard = True
        self._failures = failures
        self._granted = granted

    def stop(self) -> None:
        self.stops += 1

    def hold(self) -> bool:
        if not self.offboard:
            return False
        self.holds += 1
        if self.holds <= self._failures:
            raise RuntimeError("planted")
        self.offboard = self.holds < self._failures + self._granted
        return True


def deadman(clock: SimClock, calls: Calls) -> Deadman:
    return Deadman(CONFIG, calls.stop, calls.hold, clock)


def test_a_loop_that_never_fed_is_not_watched() -> None:
    assert DeadmanRule(CONFIG).poll(1e6) is Watch.RELEASED


@pytest.mark.parametrize(
    ("silence_s", "state"),
    [(0.0, Watch.FED), (0.25, Watch.FED), (0.2501, Watch.SILENT), (50.0, Watch.SILENT)],
)
def test_silence_begins_after_the_timeout_and_first_of_all_stops_the_vehicle(
    silence_s: float, state: Watch
) -> None:
    rule = DeadmanRule(CONFIG)
    rule.feed(10.0)
    assert rule.poll(10.0 + silence_s) is state


def test_a_stopped_vehicle_is_given_to_the_autopilot_after_hold_after_s() -> None:
    rule = DeadmanRule(CONFIG)
    rule.feed(0.0)
    assert rule.poll(0.5) is Watch.SILENT
    assert rule.poll(1.499) is Watch.SILENT
    assert rule.poll(1.5) is Watch.DEAD
    assert rule.poll(99.0) is Watch.DEAD


def test_feeding_gives_a_dead_loop_the_vehicle_back() -> None:
    rule = DeadmanRule(CONFIG)
    rule.feed(0.0)
    rule.poll(1.0)
    assert rule.poll(2.0) is Watch.DEAD
    rule.feed(2.0)
    assert rule.poll(2.1) is Watch.FED
    assert rule.poll(2.3) is Watch.SILENT


def test_a_released_loop_may_be_silent() -> None:
    rule = DeadmanRule(CONFIG)
    rule.feed(0.0)
    rule.release()
    assert rule.poll(100.0) is Watch.RELEASED


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(st.sampled_from(["feed", "release", "wait"]), st.floats(0.0, 0.9)), max_size=40
    )
)
def test_whatever_happens_the_state_follows_from_the_last_feed(
    story: list[tuple[str, float]],
) -> None:
    rule, now_s = DeadmanRule(CONFIG), 0.0
    fed_s: float | None = None
    silent_s: float | None = None
    for action, wait_s in story:
        now_s += wait_s
        if action == "feed":
            rule.feed(now_s)
            fed_s, silent_s = now_s, None
        elif action == "release":
            rule.release()
            fed_s = silent_s = None
        state = rule.poll(now_s)
        if fed_s is None:
            assert state is Watch.RELEASED
        elif now_s - fed_s <= CONFIG.timeout_s:
            assert state is Watch.FED
        else:
            silent_s = now_s if silent_s is None else silent_s
            dead = now_s - silent_s >= CONFIG.hold_after_s
            assert state is (Watch.DEAD if dead else Watch.SILENT)


def run(watch: Deadman, clock: SimClock, seconds: float, before: Watch) -> Watch:
    for _ in range(round(seconds / 0.05)):
        clock.advance(0.05)
        before = watch.step(before)
    return before


def test_a_silent_loop_is_stopped_at_every_look_and_handed_over_once() -> None:
    clock, calls = SimClock(), Calls()
    watch = deadman(clock, calls)
    watch.feed()
    state = run(watch, clock, 0.25, Watch.RELEASED)
    assert (state, calls.stops) == (Watch.FED, 0)
    state = run(watch, clock, 0.95, state)
    assert state is Watch.SILENT
    assert calls.stops == 19
    assert watch.handovers == 0
    state = run(watch, clock, 5.0, state)
    assert state is Watch.DEAD
    assert (calls.holds, watch.stops, watch.handovers) == (1, 1, 1)


def test_each_silence_has_its_own_hand_over() -> None:
    clock, calls = SimClock(), Calls()
    watch = deadman(clock, calls)
    state = Watch.RELEASED
    for _ in range(3):
        calls.offboard = True
        watch.feed()
        state = run(watch, clock, 3.0, state)
    assert (calls.holds, watch.stops, watch.handovers) == (3, 3, 3)


def test_a_hand_over_that_fails_is_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    clock, calls = SimClock(), Calls(failures=2)
    watch = deadman(clock, calls)
    watch.feed()
    run(watch, clock, 5.0, Watch.RELEASED)
    assert (calls.holds, watch.handovers) == (3, 1)
    assert "planted" in caplog.text


def test_a_hold_that_the_vehicle_does_not_show_is_asked_again_until_it_does() -> None:
    clock, calls = SimClock(), Calls(granted=3)
    watch = deadman(clock, calls)
    watch.feed()
    state = run(watch, clock, 2.6, Watch.RELEASED)
    assert calls.holds == 1, "the heartbeat had no time to tell"
    run(watch, clock, 10.0, state)
    assert (calls.holds, watch.handovers, calls.offboard) == (3, 1, False)


def test_a_vehicle_that_a_pilot_took_is_not_handed_over() -> None:
    clock, calls = SimClock(), Calls()
    calls.offboard = False
    watch = deadman(clock, calls)
    watch.feed()
    state = run(watch, clock, 5.0, Watch.RELEASED)
    assert (state, calls.holds, watch.handovers) == (Watch.DEAD, 0, 0)


def test_a_vehicle_that_comes_back_to_offboard_while_nobody_flies_it_is_held() -> None:
    clock, calls = SimClock(), Calls()
    calls.offboard = False
    watch = deadman(clock, calls)
    watch.feed()
    state = run(watch, clock, 5.0, Watch.RELEASED)
    calls.offboard = True
    run(watch, clock, 0.1, state)
    assert (calls.holds, watch.handovers) == (1, 1)


def test_the_thread_stops_a_silent_vehicle_and_ends_with_the_context() -> None:
    clock, stopped = SimClock(), threading.Event()
    with Deadman(CONFIG, stopped.set, lambda: True, clock) as watch:
        watch.feed()
        clock.advance(0.3)
        assert stopped.wait(5.0)
    watch.close()
    assert "deadman" not in {thread.name for thread in threading.enumerate()}


def test_a_hand_over_is_told_once_and_what_fails_there_stops_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock, calls, told = SimClock(), Calls(granted=3), list[float]()

    def tell(now_s: float) -> None:
        told.append(now_s)
        raise OSError("planted")

    watch = Deadman(CONFIG, calls.stop, calls.hold, clock, tell)
    watch.feed()
    state = Watch.FED
    for _ in range(120):
        clock.advance(0.05)
        state = watch.step(state)
    assert calls.holds == 3
    assert len(told) == 1
    assert told[0] == pytest.approx(1.3, abs=0.1)
    assert "it will be tried again" in caplog.text


class Terminal(logging.Handler):
    """A terminal that keeps what had been done when it was told."""

    def __init__(self, calls: Calls) -> None:
        super().__init__()
        self._calls = calls
        self.done: list[tuple[int, int]] = []

    def emit(self, _record: logging.LogRecord) -> None:
        self.done.append((self._calls.stops, self._calls.holds))


def test_the_vehicle_is_stopped_and_handed_over_before_a_word_is_said() -> None:
    clock, calls = SimClock(), Calls()
    terminal, log = Terminal(calls), logging.getLogger("hal.vehicle.deadman")
    watch = deadman(clock, calls)
    log.addHandler(terminal)
    try:
        watch.feed()
        run(watch, clock, 5.0, Watch.RELEASED)
    finally:
        log.removeHandler(terminal)
    assert terminal.done[0] == (1, 0)
    assert terminal.done[1][1] == 1
    assert len(terminal.done) == 2


def test_a_loop_that_wakes_up_while_hold_is_asked_for_knows_whose_hold_it_is() -> None:
    clock, counted = SimClock(), list[int]()

    def hold() -> bool:
        counted.append(watch.handovers)
        return True

    watch = Deadman(CONFIG, lambda: None, hold, clock)
    watch.feed()
    run(watch, clock, 2.0, Watch.RELEASED)
    assert counted == [1]
    assert watch.handovers == 1
