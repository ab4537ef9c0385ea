"""A flight is shown to people and programs, and never waits for either."""

import io
import json
import threading
from collections.abc import Iterator

import msgspec
import pytest
from rich.console import Console

from autonomy.model import (
    Command,
    Decision,
    Ending,
    Event,
    FusedState,
    GuardReport,
    MissionState,
)
from autonomy.progress import QUEUE_LINES, JsonScreen, LineScreen, LiveScreen, Progress
from autonomy.report import FlightReport
from autonomy.t3drm.timing import ReplanTime, TimingRecord

DECISION = Decision(
    now_s=1.0,
    state=MissionState.CRUISE,
    fused=FusedState(1.0, (0.5, 0.1, -1.0), (0.3, 0.4, 0.0), 0.0, 0.02, 1.0, ok=True),
    setpoint=None,
    distance_to_go_m=4.5,
    clearance_m=0.61,
    stops=2,
    replans=3,
)
TIMING = TimingRecord(
    0.0,
    tuple(ReplanTime(float(k), seconds, 1, 0.2) for k, seconds in enumerate((0.001, 0.004, 0.002))),
    0.007,
    0.001,
    60.0,
)
REPORT = FlightReport(
    ending=Ending.GOAL_REACHED,
    why="within 0.15 m of the goal",
    exit_code=0,
    route_ned_m=((4.0, 3.0, -1.0),),
    flight_time_s=61.5,
    path_length_m=5.5,
    straight_length_m=5.0,
    minimum_clearance_m=0.231,
    clearance_is_true=True,
    timing=TIMING,
    leg_kinds=("tangent", "arc"),
    log_path="flights/a.mcap",
)


def command(*events: Event) -> Command:
    decision = msgspec.structs.replace(DECISION, events=events)
    return Command(decision, None, None, GuardReport())


def shown(kind: str) -> str:
    out = io.StringIO()
    with Progress.create(kind, out) as progress:
        progress.note("connected to PX4")
        progress.tick(command(Event(1.0, "stop", "a hit 0.52 m ahead")))
        progress.report(REPORT)
    return out.getvalue()


def test_a_program_gets_one_object_a_line_and_the_report_last() -> None:
    first, second, *_, last = [json.loads(line) for line in shown("json").splitlines()]
    assert (first["type"], first["text"]) == ("note", "connected to PX4")
    assert (second["type"], second.get("name")) in [("event", "stop"), ("tick", None)]
    assert last["type"] == "report"
    assert last["ending"] == "goal_reached"
    assert [replan["seconds"] for replan in last["timing"]["replans"]] == [0.001, 0.004, 0.002]


def test_a_pipe_gets_lines_without_escapes() -> None:
    text = shown("auto")
    assert "\x1b" not in text
    assert "connected to PX4" in text
    assert "stop       a hit 0.52 m ahead" in text
    assert "Goal reached" in text
    assert "5.50 m, 1.10 times the straight 5.00 m" in text
    assert "0.231 m at least, from the centre (true); 0.081 m from the body" in text
    assert "7.0 ms in 3 plans, least 1.00, median 2.00, longest 4.00 ms" in text


def test_json_ticks_come_at_two_hertz_whatever_the_loop_does() -> None:
    out = io.StringIO()
    screen = JsonScreen(out)
    for step in range(100):
        screen.show(step / 20.0, DECISION)
    ticks = [json.loads(line) for line in out.getvalue().splitlines()]
    assert len(ticks) == 10
    assert ticks[0]["position_ned_m"] == [0.5, 0.1, -1.0]
    assert ticks[0]["distance_to_go_m"] == 4.5


def test_status_lines_come_every_few_seconds() -> None:
    out = io.StringIO()
    screen = LineScreen(Console(file=out, highlight=False))
    for step in range(220):
        screen.show(step / 20.0, DECISION)
    lines = out.getvalue().splitlines()
    assert len(lines) == 3
    assert "cruise     to go 4.50 m, clearance 0.61 m, speed 0.50 m/s" in lines[0]


def test_a_terminal_gets_a_panel_that_goes_away_and_a_report_that_stays() -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=80, highlight=False)
    screen = LiveScreen(console)
    screen.show(1.0, DECISION)
    screen.line(1.5, "stop", "a hit 0.52 m ahead")
    screen.show(2.0, msgspec.structs.replace(DECISION, distance_to_go_m=1.5))
    before = out.getvalue()
    screen.finish(REPORT)
    assert "cruise" in before
    assert "1.50 m" in before
    assert "━" * 16 in before
    assert "a hit 0.52 m ahead" in before
    assert "Goal reached" in out.getvalue()[len(before) :]


class StuckPipe(io.StringIO):
    """A reader that does not read until it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = threading.Event()
        self.reached = threading.Event()

    def write(self, text: str) -> int:
        self.reached.set()
        self.reads.wait()
        return super().write(text)


@pytest.fixture
def stuck() -> Iterator[StuckPipe]:
    pipe = StuckPipe()
    yield pipe
    pipe.reads.set()


def test_a_reader_that_does_not_read_never_stops_the_loop(stuck: StuckPipe) -> None:
    with Progress.create("json", stuck) as progress:
        progress.note("first")
        stuck.reached.wait()
        for _ in range(3 * QUEUE_LINES):
            progress.tick(command(Event(1.0, "event", "lost")))
        stuck.reads.set()
    assert len(stuck.getvalue().splitlines()) <= QUEUE_LINES + 3


class ClosedPipe(io.StringIO):
    """A reader that is gone."""

    def write(self, _: str) -> int:
        raise BrokenPipeError(32, "Broken pipe")


@pytest.mark.parametrize("kind", ["json", "auto"])
def test_a_reader_that_is_gone_does_not_end_the_flight(kind: str) -> None:
    with Progress.create(kind, ClosedPipe()) as progress:
        for _ in range(10):
            progress.tick(command(Event(1.0, "event", "unheard")))
        progress.report(REPORT)
