"""A flight looked back at: flown again, judged by what must be true, told in words, shown."""

import gzip
import math
import re
from collections.abc import Callable
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from autonomy.cli import main
from autonomy.config import Config, GuidanceConfig
from autonomy.errors import BadInput, ExitCode
from autonomy.flightlog.reader import FlightLog
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.logbook import report_of_log
from autonomy.model import (
    BeamDoubt,
    BeamWord,
    Command,
    Ending,
    Environment,
    Event,
    FilterHealth,
    MissionState,
    Outcome,
)
from autonomy.report import report_rows
from autonomy.review import reel as reel_module
from autonomy.review import worker
from autonomy.review.explain import (
    BETWEEN,
    DOING,
    LOST,
    MAXIMUM,
    MINIMUM,
    explain,
    speed_row,
    speed_rule,
)
from autonomy.review.history import History, Moment, history_of
from autonomy.review.invariants import PATH_STATES, Verdict, check
from autonomy.review.page import guard_stretches, page_of
from autonomy.review.reel import PERIOD_S, reel_of
from autonomy.service.contract import EventView, Hits, PlanView, Reel, Room, State, Track
from autonomy.t3drm.speed import speed_for_clearance
from autonomy.tally import Tally
from hal.readings import FlightMode
from hal.vehicle import guard
from tests.support.recorded import fly
from tests.support.ulog_file import as_px4_saw_it

Change = Callable[[Moment], Moment]


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> History:
    path, _ = fly(tmp_path_factory.mktemp("reviewed"), scenario="default")
    return history_of(path)


def altered(history: History, at: int, **fields: object) -> History:
    """The history with one moment changed."""
    moments = list(history.moments)
    moments[at] = msgspec.structs.replace(moments[at], **fields)
    return replace(history, moments=moments)


def cruising(history: History) -> int:
    """A moment in the middle of the flight, well under way."""
    return next(
        k for k, m in enumerate(history.moments) if m.ahead_m is not None and m.speed_m_s > 0.15
    )


def verdict(history: History, name: str) -> Verdict:
    return next(v for v in check(history) if v.name == name)


def test_a_flight_flown_again_is_the_recorded_one(history: History) -> None:
    assert history.difference is None
    assert history.damage is None
    assert history.outcome is not None
    assert len(history.replans) >= 2
    assert all(len(r.persistence) == len(r.hits) for r in history.replans)
    assert history.events[0].stamp_s >= history.start_s


def test_a_good_flight_keeps_every_promise(history: History) -> None:
    verdicts = check(history)
    assert [v.name for v in verdicts if not v.kept] == []
    assert all(v.worst is not None and v.worst >= 0.0 for v in verdicts)


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("clearance", {"clearance_m": 0.149}),
        ("stopping", {"ahead_m": 0.05}),
        ("fence", {"position_ned_m": (99.0, 0.0, -1.0)}),
        ("altitude", {"position_ned_m": (1.0, 0.0, -2.1)}),
        ("altitude", {"position_ned_m": (1.0, 0.0, -0.29)}),
        ("speed", {"sent_ned_m_s": (0.2, 0.2, 0.0)}),
    ],
)
def test_a_broken_promise_is_found_where_it_was_broken(
    history: History, name: str, fields: dict[str, object]
) -> None:
    at = cruising(history)
    found = verdict(altered(history, at, **fields), name)
    assert not found.kept
    assert found.worst is not None
    assert found.worst < 0.0
    assert found.broken_s == found.at_s == history.moments[at].now_s - history.start_s
    assert verdict(history, name).kept


def test_a_late_setpoint_is_found(history: History) -> None:
    at = cruising(history)
    moments = list(history.moments)
    late = [msgspec.structs.replace(m, now_s=m.now_s + 0.3) for m in moments[at:]]
    found = verdict(replace(history, moments=[*moments[:at], *late]), "stream")
    assert found.broken_s == pytest.approx(late[0].now_s - history.start_s)


def test_a_setpoint_after_the_vehicle_was_taken_is_found(history: History) -> None:
    last = len(history.moments) - 1
    assert history.moments[last].state is MissionState.DONE
    found = verdict(altered(history, last, sent_ned_m_s=(0.0, 0.0, 0.0)), "yield")
    assert not found.kept


def test_what_was_never_tried_is_not_called_broken(history: History) -> None:
    ground = replace(history, moments=[m for m in history.moments if not m.streaming][:5])
    assert all(v.kept for v in check(ground))
    assert verdict(ground, "clearance").worst is None


def test_stretches_of_the_guard_begin_and_end_where_it_did(history: History) -> None:
    at = cruising(history)
    limited = history
    for k in (at, at + 1, at + 5):
        limited = altered(limited, k, limits=(guard.BEAM,))
    limited = altered(limited, at + 1, limits=(guard.BEAM, guard.SPEED))
    times = [m.now_s - history.start_s for m in history.moments]
    ours = [s for s in guard_stretches(limited) if s not in guard_stretches(history)]
    assert ours == [
        (times[at], times[at + 1], guard.BEAM),
        (times[at + 1], times[at + 1], guard.SPEED),
        (times[at + 5], times[at + 5], guard.BEAM),
    ]


def test_a_moment_is_told_in_words(history: History) -> None:
    at = cruising(history)
    told = explain(history, history.moments[at].now_s - history.start_s + 1e-6)
    assert DOING[history.moments[at].state] in told
    assert "Table 2 gave" in told
    assert "m ahead were seen free" in told
    assert "The plan was made at" in told
    assert "The guard" not in told
    limited = altered(history, at, limits=(guard.FREE_SPACE,))
    told = explain(limited, history.moments[at].now_s - history.start_s + 1e-6)
    assert guard.WORDS[guard.FREE_SPACE] in told


def test_the_reason_told_is_the_last_event_before(history: History) -> None:
    at = cruising(history)
    event = Event(history.moments[at].now_s, "replan", "a reason made for this test")
    told = explain(
        altered(history, at, events=(event,)), history.moments[at + 2].now_s - history.start_s
    )
    assert "because: a reason made for this test." in told


def test_every_state_and_every_rule_of_the_guard_has_words() -> None:
    assert set(DOING) == set(MissionState)
    rules = {
        value
        for name, value in vars(guard).items()
        if name.isupper() and isinstance(value, str) and not name.startswith("_")
    }
    assert set(guard.WORDS) == rules


def test_a_moment_beyond_the_log_is_refused_with_its_length(history: History) -> None:
    with pytest.raises(BadInput, match=r"covers 0 to \d+\.\d s; 9999 s is not in it"):
        explain(history, 9999.0)


class Balance(HTMLParser):
    """Counts what is open, and collects what a page would fetch."""

    VOID = frozenset({"meta", "br", "img", "link", "input"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.fetched += [
            value or "" for name, value in attrs if name in ("src", "href") and value is not None
        ]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_a_way_longer_than_the_bound_breaks_it_where_it_got_longer(history: History) -> None:
    bound_m = history.path_bound.bound_m
    assert verdict(history, "path").kept
    last = len(history.moments) - 1
    longer = altered(history, last, flown_m=bound_m + 0.2)
    broken = verdict(longer, "path")
    assert broken.broken_s == history.moments[last].now_s - history.start_s
    assert broken.worst == pytest.approx(-0.2)


def test_the_bound_is_not_judged_where_it_was_not_promised(history: History) -> None:
    unreachable = Outcome(Ending.UNREACHABLE, "closed in")
    for changed, why in (
        (replace(history, outcome=unreachable), "cannot be reached"),
        (replace(history, movers=True), "something moved"),
        (replace(history, tally=Tally()), "no way was planned"),
    ):
        judged = verdict(changed, "path")
        assert judged.kept
        assert judged.worst is None
        assert why in judged.why_not
    text = page_of(replace(history, movers=True), report_of_log(history.path))
    assert "not judged: something moved" in text


def test_report_explanation_and_map_tell_positions_as_the_service_s_page_did(
    history: History,
) -> None:
    at_s = history.moments[cruising(history)].now_s - history.start_s
    north, east, _ = history.moments[cruising(history)].position_ned_m
    alone = explain(history, at_s)
    assert f"at {north:.2f} m north, {east:.2f} m east about the take-off point" in alone
    served = replace(history, offset_ne_m=(2.0, -1.0))
    words = "in the service's frame, where it took off at (2.00, -1.00) m"
    told = explain(served, at_s)
    assert f"at {north + 2.0:.2f} m north, {east - 1.0:.2f} m east {words}" in told
    report = msgspec.structs.replace(report_of_log(history.path), origin_ne_m=(2.0, -1.0))
    goal = history.route[-1]
    assert dict(report_rows(report))["goal, NED"] == (
        f"({goal[0] + 2.0:g}, {goal[1] - 1.0:g}, {goal[2]:g}) m, {words}"
    )
    assert escape(words) in page_of(served, report)


def test_the_page_is_one_file_that_fetches_nothing(history: History) -> None:
    text = page_of(history, report_of_log(history.path))
    page = Balance()
    page.feed(text)
    assert page.open == []
    assert "script" not in text
    assert text.count("<svg") == 3 + len(history.replans)
    assert text.count("kept</span>") == len(check(history))
    assert "bit for bit" in text
    assert not re.search(r"@import|url\((?!#)", text)


def test_only_quantities_are_kept_on_one_line(history: History) -> None:
    text = page_of(history, report_of_log(history.path))
    whole = re.findall(r'<td class="number">(.*?)</td>', text)
    assert len(whole) > len(history.replans)
    assert max(map(len, whole)) < 25
    assert not re.search(r"<td>[\d.]+ (s|ms|m|%)</td>", text)


def test_px4s_own_log_is_laid_beside_it_on_the_page(history: History, tmp_path: Path) -> None:
    """A log whose clock says nothing of ours: the positions bring the two together."""
    ulog = as_px4_saw_it(FlightLog.open(history.path), tmp_path / "a.ulg", boot_s=-321.5)
    out = tmp_path / "flight.html"
    arguments = ["report", str(history.path), "--ulog", str(ulog)]
    answer = CliRunner().invoke(main, [*arguments, "--html", str(out)])
    assert answer.exit_code == 0, answer.output
    assert "by where the positions fit best: the positions of both are then 0." in answer.output
    page = out.read_text(encoding="utf-8")
    assert page.count("<svg") == 4 + len(history.replans)
    offboard_s = next(
        tick.inputs.now_s - history.start_s
        for tick in FlightLog.open(history.path)
        if tick.inputs.status.mode is FlightMode.OFFBOARD
    )
    told = re.search(r"<td[^>]*>(\d+\.\d+) s</td><td>Offboard</td>", page)
    assert told is not None
    assert float(told[1]) == pytest.approx(offboard_s, abs=0.1)
    answer = CliRunner().invoke(main, arguments)
    assert answer.exit_code == int(ExitCode.USAGE)
    assert "give --html as well" in answer.stderr


def test_the_page_shows_what_every_source_of_the_filter_came_to(history: History) -> None:
    page = page_of(history, report_of_log(history.path))
    section = page[page.index("The position filter") : page.index("Every plan")]
    last = history.moments[-1].health
    for name in ("position", "velocity", "gnss"):
        counts = f'<td>{name}</td><td class="number">{getattr(last, name).fused}</td>'
        assert counts in section
    assert "test ratio" in section
    assert "the frame jumped 0" in section


def test_the_page_tells_the_rows_of_table_2_and_what_was_wrong(history: History) -> None:
    report = report_of_log(history.path)
    page = page_of(history, report)
    rows = re.findall(
        r"<td>(maximum|between|minimum|zero)[^<]*</td><td[^>]*>(\d+\.\d) s</td>", page
    )
    assert "maximum" in {name for name, _ in rows}
    assert len(rows) > 1
    ways = [m.now_s for m in history.moments if m.streaming and m.state in PATH_STATES]
    assert sum(float(s) for _, s in rows) == pytest.approx(len(ways) / 20.0, abs=0.3)
    assert "<h2>What was wrong</h2><p>Nothing.</p>" in page
    at = cruising(history)
    since_s = history.moments[at].now_s
    doubt = BeamDoubt("left", BeamWord.STUCK, since_s, "it repeats itself", "back")
    wrong = altered(history, at, faults=("beam_doubted",), doubts=(doubt,))
    page = page_of(wrong, report)
    when = f"{since_s - history.start_s:.2f}"
    assert f">{when} to {when} s</td><td>beam doubted</td>" in page
    assert f">{when} to {when} s</td><td>beam left stuck: it repeats itself</td>" in page


@pytest.mark.parametrize(
    ("limit_m_s", "words"),
    [
        (0.2, "the maximum, 0.20 m/s: nothing near, or receding from it with room"),
        (0.1, "0.10 m/s, between minimum and maximum, for the clearance, which gave no room or"),
        (0.05, "the minimum"),
        (0.0, "the zero"),
    ],
)
def test_a_speed_limit_tells_its_row_of_table_2(
    history: History, limit_m_s: float, words: str
) -> None:
    guidance = GuidanceConfig(speed_min_m_s=0.05, speed_max_m_s=0.2)
    assert f"Table 2 gave {words}" in speed_rule(
        limited(history, limit_m_s), Config(guidance=guidance)
    )


def limited(history: History, limit_m_s: float, doubted: tuple[str, ...] = ()) -> Moment:
    """A moment under way with that limit, while those beams were not believed."""
    doubts = tuple(BeamDoubt(beam, BeamWord.STUCK, 1.0, "it repeats itself") for beam in doubted)
    moment = history.moments[cruising(history)]
    return msgspec.structs.replace(moment, speed_limit_m_s=limit_m_s, doubts=doubts)


@pytest.mark.parametrize(
    ("limit_m_s", "doubted", "row"),
    [
        (0.1, ("left",), LOST),
        (0.1, ("up",), BETWEEN),
        (0.12, ("left",), BETWEEN),
        (0.05, ("left",), MINIMUM),
        (0.0, ("left", "front"), LOST),
    ],
)
def test_half_the_speed_of_a_lost_beam_is_not_called_the_clearances(
    history: History, limit_m_s: float, doubted: tuple[str, ...], row: str
) -> None:
    moment = limited(history, limit_m_s, doubted)
    assert speed_row(moment, Config()) is row
    assert ("a beam was not believed" in speed_rule(moment, Config())) is (row is LOST)


@pytest.mark.parametrize(
    ("clearance_m", "receding", "row"),
    [
        (0.31, False, MAXIMUM),
        (0.25, True, MAXIMUM),
        (0.25, False, BETWEEN),
        (0.23, True, BETWEEN),
        (0.17, True, MINIMUM),
    ],
)
def test_the_row_told_is_the_one_that_was_flown(
    history: History, clearance_m: float, receding: bool, row: str
) -> None:
    limit_m_s = speed_for_clearance(clearance_m, Config().guidance, receding=receding)
    assert speed_row(limited(history, limit_m_s), Config()) is row


def test_a_log_of_before_there_was_health_says_so(history: History) -> None:
    old = [msgspec.structs.replace(m, health=FilterHealth()) for m in history.moments]
    page = page_of(replace(history, moments=old), report_of_log(history.path))
    assert "The log says nothing of it." in page


def test_the_same_log_gives_the_same_page(history: History) -> None:
    report = report_of_log(history.path)
    assert page_of(history, report) == page_of(history, report)


def test_texts_of_people_cannot_become_markup(history: History) -> None:
    event = Event(history.start_s, "stop", "<b onclick=x>&")
    text = page_of(altered(history, 0, events=(event,)), report_of_log(history.path))
    assert "<b onclick" not in text
    assert "&lt;b onclick=x&gt;&amp;" in text


def test_the_commands_write_the_page_and_explain(history: History, tmp_path: Path) -> None:
    out = tmp_path / "flight.html"
    answer = CliRunner().invoke(main, ["report", str(history.path), "--html", str(out)])
    assert answer.exit_code == 0, answer.output
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")
    answer = CliRunner().invoke(main, ["explain", str(history.path), "--at", "20"])
    assert answer.exit_code == 0
    assert answer.stdout.startswith("At ")
    answer = CliRunner().invoke(main, ["explain", str(history.path), "--at", "99999"])
    assert answer.exit_code == int(ExitCode.BAD_INPUT)
    assert "is not in it" in answer.stderr


def test_a_page_that_cannot_be_written_is_one_sentence(history: History, tmp_path: Path) -> None:
    answer = CliRunner().invoke(
        main, ["report", str(history.path), "--html", str(tmp_path / "no" / "such.html")]
    )
    assert answer.exit_code == int(ExitCode.BAD_INPUT)
    assert "cannot be written" in answer.stderr


def test_a_flight_that_broke_a_promise_ends_the_command_with_an_error(tmp_path: Path) -> None:
    def too_fast(command: Command) -> Command:
        if command.setpoint is None or command.decision.state is not MissionState.CRUISE:
            return command
        wild = msgspec.structs.replace(command.setpoint, velocity_ned_m_s=(0.9, 0.0, 0.0))
        return msgspec.structs.replace(command, setpoint=wild)

    path, _ = fly(tmp_path, scenario="empty", written=too_fast)
    out = tmp_path / "flight.html"
    answer = CliRunner().invoke(main, ["report", str(path), "--html", str(out)])
    assert answer.exit_code == int(ExitCode.INTERNAL)
    assert "no setpoint asked for more than the top speed" in answer.stderr
    text = out.read_text(encoding="utf-8")
    assert "broken at" in text
    assert "decisions differ" in text


# ---------------------------------------------------------------- for the page


def test_a_reel_shows_the_flight_as_it_was_told_live(history: History) -> None:
    reel = reel_of(history.path)
    assert reel.duration_s == pytest.approx(history.moments[-1].now_s - history.start_s, abs=0.01)
    times = [frame.at_s for frame in reel.frames]
    assert times == sorted(times)
    assert times[0] == 0.0
    assert max(b - a for a, b in pairwise(times)) < PERIOD_S + 0.06
    told = [message for frame in reel.frames for message in frame.messages]
    assert [event.why for event in told if isinstance(event, EventView)][1:] == [
        event.why for event in history.events
    ]
    track = [point for message in told if isinstance(message, Track) for point in message.points]
    assert math.dist(track[-1], history.route[-1][:2]) < 0.3
    last_hits = [message for message in told if isinstance(message, Hits)][-1]
    assert len(last_hits.points) > 20
    state = [message for message in told if isinstance(message, State)][-1]
    assert state.flight is not None
    assert state.flight.state == "done"
    assert {plan.environment for plan in told if isinstance(plan, PlanView)} <= set(Environment)


def test_a_reel_lies_where_the_service_flew_it(history: History, tmp_path: Path) -> None:
    log = FlightLog.open(history.path)
    reels = []
    for name, offset in (("first", (0.0, 0.0)), ("second", (0.6, -0.35))):
        path = tmp_path / f"{name}.mcap"
        with FlightRecorder(path, log.header, wait_when_full=True) as recorder:
            recorder.route(log.route(), log.resumed(), offset)
            for tick in islice(log, 300):
                recorder.tick(tick.inputs, tick.command, tick.step_s)
        reels.append(reel_of(path))
    places = [
        [
            *(p for m in told if isinstance(m, Room) for p in m.fence),
            *(p for m in told if isinstance(m, Track) for p in m.points),
            *(p for m in told if isinstance(m, State) and m.flight for p in m.flight.goals),
            *(m.vehicle.position for m in told if isinstance(m, State) and m.vehicle),
        ]
        for told in ([m for frame in reel.frames for m in frame.messages] for reel in reels)
    ]
    first, second = (np.asarray([point[:2] for point in each]) for each in places)
    assert len(first) > 100
    assert second - first == pytest.approx(np.tile((0.6, -0.35), (len(first), 1)))


def test_a_long_flight_has_fewer_frames_and_loses_no_event(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = reel_of(history.path)
    monkeypatch.setattr(reel_module, "FRAMES_MAX", 50)
    short = reel_of(history.path)
    assert len(short.frames) <= 52

    def told(reel: Reel, kind: type[EventView] | type[Track]) -> list[object]:
        messages = (m for frame in reel.frames for m in frame.messages if isinstance(m, kind))
        if kind is Track:
            return [point for m in messages if isinstance(m, Track) for point in m.points]
        return [m.number for m in messages if isinstance(m, EventView)]

    assert told(short, EventView) == told(whole, EventView)
    assert told(short, Track) == told(whole, Track)
    assert all(isinstance(frame.messages[-1], State) for frame in short.frames)


@pytest.mark.parametrize("what", ["reel", "report"])
def test_the_worker_writes_what_the_page_asks_for(
    history: History, what: str, monkeypatch: pytest.MonkeyPatch, capfdbinary: Any
) -> None:
    stood_back: list[int] = []
    monkeypatch.setattr(worker, "stand_back", lambda: stood_back.append(1))
    assert worker.main([what, str(history.path)]) == 0
    written = capfdbinary.readouterr()
    made = gzip.decompress(written.out)
    assert stood_back == [1]
    assert re.fullmatch(rb"(share [01]\.[0-9]{2}\n)+", written.err)
    if what == "reel":
        assert msgspec.json.decode(made, type=Reel).log == history.path.name
    else:
        assert b"What had to be true" in made


def test_the_worker_says_in_a_sentence_what_it_cannot_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(worker, "stand_back", lambda: None)
    (tmp_path / "a.mcap").write_bytes(b"no log")
    assert worker.main(["reel", str(tmp_path / "a.mcap")]) == 1
    assert "a.mcap" in capsys.readouterr().err
    assert worker.main(["dance", str(tmp_path / "a.mcap")]) == 2
