"""Campaigns that are flown: killed and begun again, here and elsewhere, always the same rows."""

import functools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import psutil
import pytest

from autonomy.errors import BadInput
from tools.bench.__main__ import main
from tools.bench.campaign import flying
from tools.bench.campaign.case import Case, Row, differences
from tools.bench.campaign.cluster import cluster
from tools.bench.campaign.store import Store, rows_of
from tools.campaign import finished

ROOT = Path(__file__).parents[5]
SEEDS = 5
ASKED = ["--planner", "t3drm-rolling", "--world", "shipped:empty", "--seeds", str(SEEDS)]
CASES = [Case("t3drm-rolling", "shipped:empty", seed, "thin", "px4") for seed in range(SEEDS)]
PATIENCE_S = 300.0


def until(happened: object, what: str) -> None:
    ends_s = time.monotonic() + PATIENCE_S
    while not happened():  # type: ignore[operator]  # a function
        assert time.monotonic() < ends_s, what
        time.sleep(0.05)


def lines(folder: Path) -> int:
    newest = folder / "newest.jsonl"
    return newest.read_bytes().count(b"\n") if newest.exists() else 0


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Row]]:
    """A campaign on two processes, killed in the middle: its folder, and the rows there were."""
    folder = tmp_path_factory.mktemp("killed")
    command = [sys.executable, "-m", "tools.bench", "fly", str(folder), *ASKED, "--jobs", "2"]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    until(lambda: lines(folder) >= 1 or process.poll() is not None, "the first row")
    hands = psutil.Process(process.pid).children()
    process.send_signal(signal.SIGKILL)
    process.wait()
    psutil.wait_procs(hands, PATIENCE_S)
    assert not any(each.is_running() for each in hands), "processes outlive who began them"
    return folder, rows_of(folder)


@pytest.fixture(scope="module")
def complete(killed: tuple[Path, list[Row]]) -> list[Row]:
    """The same, begun again in this process."""
    folder, _ = killed
    assert main(["fly", str(folder), *ASKED, "--jobs", "1", "--mixed"]) == 0
    return rows_of(folder)


def test_a_killed_campaign_goes_on_and_nothing_is_flown_twice(
    killed: tuple[Path, list[Row]], complete: list[Row]
) -> None:
    _, before = killed
    assert 1 <= len(before) <= SEEDS
    assert [row.case for row in complete] == CASES
    # Computing times are never the same twice.
    assert all(row in complete for row in before)


def test_another_process_flies_the_same_rows(
    killed: tuple[Path, list[Row]], complete: list[Row]
) -> None:
    assert complete
    for row in killed[1][:2]:
        assert differences(row, flying.fly(row.case)) == ()
    assert len({row.length_m for row in complete}) == SEEDS


def test_a_row_names_the_command_that_shows_it(
    killed: tuple[Path, list[Row]],
    complete: list[Row],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder, _ = killed
    picture = tmp_path / "flight.png"
    words = complete[-1].again.split()
    assert words[:4] == ["python", "-m", "tools.bench", "show"]
    assert main([*words[3:], "--picture", str(picture)]) == 0
    assert "the same flight" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (folder / "configs" / f"{complete[0].config}.yaml").exists()


def test_a_row_that_is_not_what_is_flown_is_told(
    complete: list[Row], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Store(tmp_path) as store:
        store.keep(msgspec.structs.replace(complete[0], stops=99, commit="older"))
    assert main(["show", str(tmp_path), "0"]) == 1
    told = capsys.readouterr().out
    assert "not the same: stops" in told
    assert "then commit older" in told
    assert main(["show", str(tmp_path), "7"]) == 3
    assert "numbered from 0" in capsys.readouterr().err


def test_what_is_raised_in_flight_is_a_row() -> None:
    nowhere = flying.fly(Case("t3drm-rolling", "shipped:empty", -1, "thin", "px4"))
    assert nowhere.ending == "raised"
    assert "ValueError" in nowhere.why


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--world", "nowhere:1"], "names no world"),
        ([], "no world is named"),
        (["--world", "room:1", "--planner", "magic"], "no planner is called 'magic'"),
        (["--world", "room:1", "--sensors", "eyes"], "is not among thin"),
        (["--world", "room:1", "--response", "slow"], "is not among px4"),
    ],
)
def test_what_cannot_be_flown_is_told_before_anything_is(
    asked: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", str(tmp_path / "new"), *asked]) == 3
    assert said in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_rows_of_two_commits_are_not_mixed_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = (
        '[{"begun": "", "command": "", "computer": "", "order": {"planners": [], "worlds": [], '
        '"seeds": 1, "sensors": [], "response": []}, "versions": {"version": "0", "commit": '
        '"older", "python": "", "numpy": "", "numba": "", "machine": ""}}]'
    )
    (tmp_path / "campaign.json").write_text(record)
    assert main(["fly", str(tmp_path), "--world", "shipped:empty"]) == 3
    assert "was flown by commit older" in capsys.readouterr().err


@pytest.mark.parametrize("given", [[], ["dance"]])
def test_no_command_and_an_unknown_one_are_told_those_that_are(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(given) == 2
    assert "planners on known maps" in capsys.readouterr().err


# ---------------------------------------------------------------- a cluster


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A Dask scheduler and two workers, each a process on loopback."""
    environ = {**os.environ, "PYTHONPATH": str(ROOT)}
    told = tmp_path / "scheduler.json"
    quiet = {"env": environ, "cwd": tmp_path, "stderr": subprocess.DEVNULL}

    def start(what: str, *options: str) -> subprocess.Popen[bytes]:
        module = f"distributed.cli.dask_{what}"
        command = [sys.executable, "-m", module, "--scheduler-file", str(told), "--no-dashboard"]
        return subprocess.Popen([*command, *options], **quiet)  # type: ignore[call-overload,no-any-return]  # options

    begun = [start("scheduler", "--host", "127.0.0.1", "--port", "0")]
    try:
        until(told.exists, "the scheduler")
        address = msgspec.json.decode(told.read_bytes())["address"]
        begun += [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
        yield address, begun[1:]
    finally:
        for process in reversed(begun):
            process.kill()
            process.wait()


def test_a_cluster_that_loses_a_worker_flies_the_same_rows(
    complete: list[Row], scheduler: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, workers = scheduler
    came: list[Row] = []

    def kill_one(row: Row) -> str:
        came.append(row)
        if len(came) == 1:
            workers[0].kill()
        return ""

    fly = functools.partial(flying.fly, barn=None)
    with Store(tmp_path / "rows") as store:
        rows = finished(CASES, fly, store, cluster(address), wrong=kill_one)
    assert len(came) == SEEDS
    for ours, theirs in zip(complete, rows, strict=True):
        assert differences(ours, theirs) == ()


def test_a_scheduler_that_does_not_answer_is_told() -> None:
    with pytest.raises(BadInput, match="no scheduler answers at tcp://127"):
        list(cluster("tcp://127.0.0.1:9", answer_s=1)(CASES, flying.fly))


def test_a_world_that_cannot_be_made_is_a_row_and_no_end() -> None:
    case = Case("t3drm-rolling", "file:no/such/world.yaml", 0, "thin", "px4")
    row = flying.fly(case)
    assert (row.ending, row.family, row.reachable) == ("raised", "file", False)
    assert "no/such/world.yaml" in row.why
