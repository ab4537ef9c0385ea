"""The recorder never stands in the flight's way, and what it wrote survives whatever comes."""

import errno
import os
import queue
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from autonomy.errors import BadInput, NotReplayable
from autonomy.flightlog import recorder as recording
from autonomy.flightlog.reader import FlightLog, replay
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.flightlog.schema import FlightHeader, RouteRecord, decode
from autonomy.model import GuardReport, OperatorCommand
from hal.readings import StatusText
from tests.unit.autonomy.flightlog.records import plain_inputs, plain_step

HEADER = FlightHeader(config_json="{}", scenario="door", seed=7, versions={"autonomy": "0"})
ROUTE = ((4.0, 3.0, -1.0), (0.0, 0.0, -1.0))


def record(path: Path, ticks: int, *, wait_when_full: bool = True) -> FlightRecorder:
    with FlightRecorder(path, HEADER, wait_when_full=wait_when_full) as recorder:
        recorder.route(ROUTE)
        for index in range(ticks):
            inputs = plain_inputs(index / 20.0, 0.5 + index / 3000.0)
            recorder.tick(inputs, plain_step(inputs), 1e-4)
        recorder.text(StatusText(1.0, 4, "Takeoff detected"))
    return recorder


def test_a_flight_is_read_as_it_was_recorded(tmp_path: Path) -> None:
    recorder = record(tmp_path / "a.mcap", 100)
    assert recorder.notes() == ()
    log = FlightLog.open(recorder.path)
    assert log.header == HEADER
    assert log.route() == ROUTE
    assert [text.text for text in log.texts()] == ["Takeoff detected"]
    ticks = list(log)
    assert [tick.index for tick in ticks] == list(range(100))
    assert ticks[42].inputs == plain_inputs(42 / 20.0, 0.5 + 42 / 3000.0)
    assert ticks[42].command == plain_step(ticks[42].inputs)
    assert ticks[42].step_s == 1e-4
    assert log.damage is None


def test_where_the_flight_began_in_its_service_s_frame_is_kept(tmp_path: Path) -> None:
    with FlightRecorder(tmp_path / "b.mcap", HEADER, wait_when_full=True) as recorder:
        recorder.route(ROUTE, None, (0.6, -0.35))
    assert FlightLog.open(recorder.path).offset_ne_m() == (0.6, -0.35)
    assert FlightLog.open(record(tmp_path / "a.mcap", 1).path).offset_ne_m() == (0.0, 0.0)
    old = decode(b'{"goals_ned_m": [[4, 3, -1]]}', RouteRecord)
    assert old.offset_ne_m == (0.0, 0.0)


def test_other_programs_can_read_the_file(tmp_path: Path) -> None:
    recorder = record(tmp_path / "a.mcap", 10)
    with recorder.path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 10 * 3 + 2
    assert {channel.topic for channel in summary.channels.values()} == {
        "route",
        "inputs",
        "decisions",
        "guard",
        "texts",
    }
    assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema"}


def test_a_full_queue_drops_and_counts_and_the_replay_says_so(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path / "a.mcap", HEADER, queue_ticks=2)
    gate = threading.Lock()
    inputs = plain_inputs(0.0)
    command = plain_step(inputs)
    with gate:
        # The disk is busy: the thread waits inside an encoding for the gate.
        recorder._queue.put([("route", 0, _Gate(gate), plain_inputs(0.0))])
        while not recorder._queue.empty():
            threading.Event().wait(0.001)
        for _ in range(5):
            recorder.tick(inputs, command, 0.0)
    recorder.close()
    assert recorder.dropped == 3
    assert recorder.notes() == ("3 ticks are missing from the flight log: the disk was too slow",)


class _Gate(float):
    """A time that cannot be read before the gate opens."""

    def __new__(cls, gate: threading.Lock) -> "_Gate":
        self = super().__new__(cls, 0.0)
        self.gate = gate  # type: ignore[attr-defined]  # a plain attribute of a test double
        return self

    def __mul__(self, other: float) -> float:
        with self.gate:  # type: ignore[attr-defined]  # see above
            return 0.0


def test_a_gap_ends_the_replay(tmp_path: Path) -> None:
    with FlightRecorder(tmp_path / "a.mcap", HEADER) as recorder:
        for index in range(6):
            recorder._next += 2 * (index == 4)
            inputs = plain_inputs(float(index))
            recorder.tick(inputs, plain_step(inputs), 0.0)
    result = replay(FlightLog.open(recorder.path), plain_step)
    assert (result.ticks, result.gap) == (4, "ticks 4 to 5 were not recorded")
    assert not result.exact


def test_a_record_that_cannot_be_written_ends_recording_not_the_flight(tmp_path: Path) -> None:
    with FlightRecorder(tmp_path / "a.mcap", HEADER, queue_ticks=2) as recorder:
        inputs = plain_inputs(0.0)
        good = plain_step(inputs)
        bad = type(good)(good.decision, None, None, GuardReport((), np.float64(1.0), 0.0))
        recorder.tick(inputs, bad, 0.0)
        for _ in range(50):
            recorder.tick(inputs, good, 0.0)
    (note,) = recorder.notes()
    assert "recording ended before the flight did" in note
    assert "float64" in note


def test_a_full_disk_ends_the_log_tells_it_at_once_and_never_ends_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    told: queue.Queue[str] = queue.Queue()
    with FlightRecorder(
        tmp_path / "a.mcap", HEADER, queue_ticks=2, wait_when_full=True, tell=told.put
    ) as recorder:
        inputs = plain_inputs(0.0)
        recorder.tick(inputs, plain_step(inputs), 0.0)
        monkeypatch.setattr(os, "fsync", full)
        monkeypatch.setattr(recording, "FLUSH_S", 0.0)
        for _ in range(200):  # in flight; none of them waits for a writer that is gone
            recorder.tick(inputs, plain_step(inputs), 0.0)
        recorder.text(StatusText(1.0, 4, "Takeoff detected"))
        sentence = told.get(timeout=30.0)
    assert sentence.endswith("recording ended before the flight did (No space left on device)")
    assert recorder.failure == sentence
    assert recorder.notes() == (sentence,)
    assert told.empty()
    assert recorder.dropped > 0


def closed_in_time(recorder: FlightRecorder) -> bool:
    closing = threading.Thread(target=recorder.close, daemon=True)
    closing.start()
    closing.join(30.0)
    return not closing.is_alive()


def test_a_bad_record_just_before_the_end_holds_nobody_up(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path / "a.mcap", HEADER)
    inputs = plain_inputs(0.0)
    good = plain_step(inputs)
    bad = type(good)(good.decision, None, None, GuardReport((), np.float64(1.0), 0.0))
    for command in (good, bad, good):
        recorder.tick(inputs, command, 0.0)
    assert closed_in_time(recorder)
    assert recorder.failure is not None
    assert "float64" in recorder.failure
    assert recorder.dropped == 2


def test_a_disk_that_is_full_at_the_very_end_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    monkeypatch.setattr(recording, "FLUSH_S", 1e6)
    recorder = FlightRecorder(tmp_path / "a.mcap", HEADER)
    assert closed_in_time(recorder)
    assert recorder.failure is not None
    assert "No space left" in recorder.failure


def test_a_folder_that_cannot_be_used_is_told_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="choose another place with --log-dir"):
        FlightRecorder.in_folder(tmp_path / "file" / "logs", config_json="{}")
    with pytest.raises(BadInput, match="cannot be created"):
        FlightRecorder(tmp_path / "absent" / "a.mcap", HEADER)


def test_an_operator_s_order_is_in_the_log_before_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "FLUSH_S", 1e6)
    path = tmp_path / "a.mcap"
    with FlightRecorder(path, HEADER) as recorder:
        recorder.route(ROUTE)
        while not path.stat().st_size:
            time.sleep(0.001)
        for index in range(3):
            inputs = plain_inputs(index / 20.0, 0.5)
            ordered = (OperatorCommand.STOP,) if index == 2 else ()
            inputs = msgspec.structs.replace(inputs, commands=ordered)
            recorder.tick(inputs, plain_step(inputs), 1e-4)
        ends_s = time.monotonic() + 20.0
        while len(ticks := list(FlightLog.open(path))) < 3 and time.monotonic() < ends_s:
            time.sleep(0.01)
    assert [tick.inputs.commands for tick in ticks] == [(), (), (OperatorCommand.STOP,)]


def test_two_flights_in_one_second_have_two_files(tmp_path: Path) -> None:
    paths = set()
    for _ in range(3):
        with FlightRecorder.in_folder(
            tmp_path / "logs", config_json="{}", scenario="worlds/maze.yaml", seed=3
        ) as recorder:
            paths.add(recorder.path)
    assert len(paths) == 3
    assert all("maze" in path.name for path in paths)
    header = FlightLog.open(recorder.path).header
    assert (header.scenario, header.seed) == ("worlds/maze.yaml", 3)
    assert {"autonomy", "python", "numpy", "numba"} <= set(header.versions)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of several chunks; its bytes are too many to be shown with a failing example."""
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "FLUSH_S", 0.0)
        record(path, 30)
    return path


@settings(deadline=None, max_examples=150)
@given(cut=st.floats(0.0, 1.0, exclude_max=True))
def test_a_log_cut_anywhere_is_read_up_to_the_cut(
    finished: Path, tmp_path_factory: pytest.TempPathFactory, cut: float
) -> None:
    whole = finished.read_bytes()
    path = tmp_path_factory.mktemp("cut") / "a.mcap"
    path.write_bytes(whole[: int(cut * len(whole))])
    try:
        log = FlightLog.open(path)
    except NotReplayable:
        assert cut < 0.05  # not even the header
        return
    ticks = list(log)
    assert [tick.index for tick in ticks] == list(range(len(ticks)))
    assert all(tick.command == plain_step(tick.inputs) for tick in ticks)


def test_a_length_beyond_all_memory_is_damage(finished: Path, tmp_path: Path) -> None:
    path, whole = tmp_path / "a.mcap", finished.read_bytes()
    tops = [at for at in range(7, len(whole)) if not any(whole[at - 4 : at + 1])]
    for at in tops[:100]:
        path.write_bytes(whole[:at] + b"\x80" + whole[at + 1 :])
        try:
            assert all(tick.command == plain_step(tick.inputs) for tick in FlightLog.open(path))
        except NotReplayable as refused:
            assert str(path) in str(refused)  # noqa: PT017 - either is right, nothing else is


@settings(deadline=None, max_examples=150)
@given(where=st.floats(0.0, 1.0, exclude_max=True), flip=st.integers(1, 255))
def test_a_damaged_log_never_gives_a_wrong_tick(
    finished: Path, tmp_path_factory: pytest.TempPathFactory, where: float, flip: int
) -> None:
    damaged = bytearray(finished.read_bytes())
    damaged[int(where * len(damaged))] ^= flip
    path = tmp_path_factory.mktemp("damaged") / "a.mcap"
    path.write_bytes(damaged)
    try:
        log = FlightLog.open(path)
        ticks = list(log)
    except NotReplayable:
        return
    assert all(tick.command == plain_step(tick.inputs) for tick in ticks)
