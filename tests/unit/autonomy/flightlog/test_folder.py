"""Old flights make room for new ones: the oldest first, and nothing that is not ours to delete."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import LogConfig
from autonomy.flightlog.folder import logs_in, make_room
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.flightlog.schema import FlightHeader

NOW_S = 1_800_000_000.0
DAY_S = 86_400.0
KEEP_ALL = LogConfig(keep_mb=0.0)


def flight(folder: Path, name: str, *, days_old: float, padding: int = 0) -> Path:
    """A finished flight with its report; the report is as large as it has to be."""
    with FlightRecorder(folder / f"{name}.mcap", FlightHeader(config_json="{}")) as recorder:
        pass
    report = recorder.path.with_name(f"{name}.mcap.report.json")
    report.write_bytes(b" " * padding)
    for path in (recorder.path, report):
        os.utime(path, (NOW_S - days_old * DAY_S,) * 2)
    return recorder.path


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_the_oldest_flights_go_with_all_that_lies_beside_them(tmp_path: Path) -> None:
    for number in range(4):
        flight(tmp_path, f"f{number}", days_old=4 - number, padding=1_000_000)
    (tmp_path / "f0.foxglove.mcap").write_bytes(b"made from it")
    (tmp_path / "f0.mcap.hold.json").write_bytes(b"{}")
    told = make_room(tmp_path, LogConfig(keep_mb=2.5), NOW_S)
    assert names(tmp_path) == {
        f"f{n}.mcap{suffix}" for n in (2, 3) for suffix in ("", ".report.json")
    }
    assert told == (
        "deleted the flight f0.mcap (1.0 MB): log.keep_mb is 2.5",
        "deleted the flight f1.mcap (1.0 MB): log.keep_mb is 2.5",
    )
    assert make_room(tmp_path, LogConfig(keep_mb=2.5), NOW_S) == ()


def test_flights_beyond_their_age_go_and_the_newest_stays_however_old(tmp_path: Path) -> None:
    flight(tmp_path, "a", days_old=31)
    flight(tmp_path, "b", days_old=29)
    assert make_room(tmp_path, LogConfig(keep_days=30), NOW_S) == (
        "deleted the flight a.mcap (0.0 MB): log.keep_days is 30.0",
    )
    assert make_room(tmp_path, LogConfig(keep_days=1), NOW_S) == ()
    assert names(tmp_path) == {"b.mcap", "b.mcap.report.json"}


def test_a_date_that_is_set_back_makes_no_older_flight_the_newest(tmp_path: Path) -> None:
    paths = []
    for days_old in (1.0, 40.0):  # the second was flown with the date set back
        with FlightRecorder.in_folder(tmp_path, config_json="{}") as recorder:
            paths.append(recorder.path)
        os.utime(recorder.path, (NOW_S - days_old * DAY_S,) * 2)
    before = flight(tmp_path, "another start of the computer", days_old=0.0)
    header = FlightHeader(config_json="{}", host_boot="another", started_s=1e9)
    before.unlink()
    with FlightRecorder(before, header):
        pass
    assert logs_in(tmp_path) == [before, *paths]
    make_room(tmp_path, LogConfig(keep_mb=0.0, keep_days=30), NOW_S)
    assert paths[1].exists()


def test_nothing_is_deleted_where_nothing_was_asked_for(tmp_path: Path) -> None:
    for number in range(3):
        flight(tmp_path, f"f{number}", days_old=4000 - number, padding=100_000)
    assert make_room(tmp_path, KEEP_ALL, NOW_S) == ()
    assert len(logs_in(tmp_path)) == 3


def test_a_clock_that_was_never_set_makes_no_flight_old(tmp_path: Path) -> None:
    old = flight(tmp_path, "a", days_old=0)
    flight(tmp_path, "b", days_old=0)
    os.utime(old, (3600.0, 3600.0))  # written an hour after 1970 began
    assert make_room(tmp_path, LogConfig(keep_days=30), NOW_S) == ()


def test_a_flight_that_is_being_written_stays(tmp_path: Path) -> None:
    with FlightRecorder(tmp_path / "flying.mcap", FlightHeader(config_json="{}")) as recorder:
        os.utime(recorder.path, (NOW_S - 100 * DAY_S,) * 2)
        flight(tmp_path, "newer", days_old=1, padding=2_000_000)
        flight(tmp_path, "newest", days_old=0)
        told = make_room(tmp_path, LogConfig(keep_mb=0.001, keep_days=1), NOW_S)
        assert [text.split()[3] for text in told] == ["newer.mcap"]
        assert recorder.path.exists()
    os.utime(recorder.path, (NOW_S - 100 * DAY_S,) * 2)
    told = make_room(tmp_path, LogConfig(keep_days=1), NOW_S)
    assert [text.split()[3] for text in told] == ["flying.mcap"]


def test_what_others_wrote_stays(tmp_path: Path) -> None:
    (tmp_path / "rosbag.mcap").write_bytes(b"\x89MCAP0\r\n" + b"not ours")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "link.mcap").symlink_to(tmp_path / "rosbag.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    for path in tmp_path.iterdir():
        if not path.is_symlink():
            os.utime(path, (NOW_S - 400 * DAY_S,) * 2)
    flight(tmp_path, "newest", days_old=0)
    before = names(tmp_path)
    assert make_room(tmp_path, LogConfig(keep_mb=0.0001, keep_days=1), NOW_S) == ()
    assert names(tmp_path) == before


def test_a_name_that_begins_like_another_is_another_flight(tmp_path: Path) -> None:
    flight(tmp_path, "room[1]", days_old=40)
    flight(tmp_path, "room[1].b", days_old=2)
    flight(tmp_path, "newest", days_old=0)
    told = make_room(tmp_path, LogConfig(keep_days=30), NOW_S)
    assert len(told) == 1
    assert "room[1].b.mcap" in names(tmp_path)
    assert "room[1].mcap" not in names(tmp_path)


def test_a_folder_that_is_not_there_or_cannot_be_read_never_raises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert make_room(tmp_path / "absent", LogConfig(), NOW_S) == ()
    (told,) = make_room(Path(__file__), LogConfig(), NOW_S)
    assert "old flights cannot be looked through (Not a directory)" in told
    flight(tmp_path, "a", days_old=40)
    flight(tmp_path, "b", days_old=0)

    def refuse(_: Path, *, missing_ok: bool = False) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refuse)
    (told,) = make_room(tmp_path, LogConfig(keep_days=30), NOW_S)
    assert told.endswith("a.mcap: cannot be deleted to make room (Permission denied)")


@settings(deadline=None, max_examples=25)
@given(
    sizes=st.lists(st.integers(0, 40_000), min_size=1, max_size=6),
    keep_bytes=st.integers(1, 120_000),
)
def test_what_stays_fits_and_nothing_newer_went_before_something_older(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int], keep_bytes: int
) -> None:
    folder = tmp_path_factory.mktemp("logs")
    for number, padding in enumerate(sizes):
        flight(folder, f"f{number}", days_old=len(sizes) - number, padding=padding)
    whole = {path.name: path.stat().st_size for path in folder.iterdir()}
    make_room(folder, LogConfig(keep_mb=keep_bytes / 1e6), NOW_S)
    left = [path.stem for path in logs_in(folder)]
    assert left == [f"f{n}" for n in range(len(sizes) - len(left), len(sizes))]
    size = sum(path.stat().st_size for path in folder.iterdir())
    assert size <= keep_bytes or len(left) == 1
    if len(left) < len(sizes):  # and none went that need not have gone
        last_gone = f"f{len(sizes) - len(left) - 1}"
        back = sum(bytes_ for name, bytes_ in whole.items() if name.split(".")[0] == last_gone)
        assert size + back > keep_bytes
