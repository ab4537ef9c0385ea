"""Every command in every README works as it is written there, from a fresh clone.

Short ones are run. What needs a vehicle, hours, root or a network is taken to where that would
begin: flights are prepared by the program's own door, other commands are read by their own
parser, and make says what it would do. A command in no row of the table fails.
"""

import argparse
import importlib
import importlib.util
import inspect
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, NoReturn

import click
import pytest
from click.testing import CliRunner

from autonomy import app, cli
from autonomy.report import FlyOptions
from tests.support.readmes import ROOT, Said, commands, readmes

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOG = ROOT / "tests" / "golden" / "flights" / "default_rolling.mcap"
AUTONOMY = r"(\.venv/bin/|\S+=\S+ )autonomy"
TOOL = r"(sudo )?\.venv/bin/python -m tools\."

PROGRAMS = ("python", "pip", "pre-commit")
"""Beside the project's own, what `.venv/bin` has for people."""

ALL = [said for readme in readmes() for said in commands(readme)]
DRONE = """vehicle: {connection: serial:///dev/ttyAMA0:921600}
mission: {altitude_m: 0.8}
"""
"""my-drone.yaml, as configs/README.md has it."""


class _Understood(Exception):
    """The command was read to its end."""


def run(words: list[str], _: pytest.MonkeyPatch) -> None:
    """To its end, and well."""
    if words[0].endswith("python"):
        done = subprocess.run([sys.executable, *words[1:]], check=False, capture_output=True)
        assert done.returncode == 0, done.stderr.decode()
        return
    result = CliRunner().invoke(cli.main, words[1:])
    assert result.exit_code == 0, result.output


def prepared(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight: options, configuration, world, faults and goals as before taking off."""

    def fly(options: FlyOptions) -> NoReturn:
        assert app.prepare(options).options == options
        raise _Understood

    monkeypatch.setattr(app, "fly", fly)
    with pytest.raises(_Understood):
        cli.main([*words[1:], "--debug"], standalone_mode=False)


def understood(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """By the parser of the program that it names."""
    words = [word for word in words if word != "sudo" and not re.match(r"[A-Z_]+=", word)]
    if words[0].endswith("autonomy"):
        _read_by_click(words[1:])
    else:
        assert words[:2] in ([".venv/bin/python", "-m"], ["python3", "-m"])
        _read_by_argparse(words[2], words[3:], monkeypatch)


def _read_by_click(words: list[str]) -> None:
    command: click.Command = cli.main
    while isinstance(command, click.Group):
        name, *words = words
        command = command.commands[name]
    command.make_context(command.name, words)


def _read_by_argparse(module: str, words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    parse = argparse.ArgumentParser.parse_args

    def read(parser: argparse.ArgumentParser, given: list[str] | None = None) -> NoReturn:
        parse(parser, given)
        raise _Understood

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", read)
    monkeypatch.setattr(sys, "argv", [module, *words])
    spec = importlib.util.find_spec(module)
    assert spec is not None
    if spec.submodule_search_locations is not None:
        module = f"{module}.__main__"
    main = importlib.import_module(module).main
    with pytest.raises(_Understood):
        main(words) if inspect.signature(main).parameters else main()


def said_by_make(words: list[str], _: pytest.MonkeyPatch) -> None:
    """What it would do, every target and step of it."""
    make = subprocess.run(
        ["make", "-n", *words[1:]], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert make.returncode == 0, make.stderr
    for tool in re.findall(r"python -m (tools[.\w]*)", make.stdout):
        assert importlib.util.find_spec(tool) is not None
    for folder in re.findall(r"(tests/\w+)", make.stdout):
        assert (ROOT / folder).is_dir()


def installable(words: list[str], _: pytest.MonkeyPatch) -> None:
    """Every extra exists."""
    wanted = re.search(r"\[([\w,]+)\]", words[-1])
    assert wanted is not None
    assert set(wanted[1].split(",")) <= set(PROJECT["optional-dependencies"])


def outside(words: list[str], _: pytest.MonkeyPatch) -> None:
    """A program of the system: the files of the project that it names exist."""
    for word in words:
        if word.startswith(("configs/", "tools/", "hal/", "autonomy/")):
            assert (ROOT / word).exists()


class Row(NamedTuple):
    """How a kind of command is checked, and why not more."""

    pattern: str
    check: Callable[[list[str], pytest.MonkeyPatch], None]
    why: str


TABLE = (
    Row(rf"{AUTONOMY} fly --help$", run, "short"),
    Row(rf"{AUTONOMY} fly .*(--goal|--fault)", prepared, "a minute or more, or a vehicle: flown by "
        "tests/integration/test_fly_missions.py, which is asked for below"),
    Row(rf"{AUTONOMY} report .*--(ulog|html)", understood, "seconds: tests/unit/autonomy/review"),
    Row(rf"{AUTONOMY} (config|report|explain|replay|export|plan) ", run, "short, on a kept log"),
    Row(rf"{AUTONOMY} (serve|status|stop|hold|resume|land)\b", understood, "lives until it is "
        "stopped: tests/integration/test_service_process.py"),
    Row(rf"{AUTONOMY} sim\b", understood, "lives until it is stopped: tests/integration"),
    Row(rf"{AUTONOMY} (check|calibrate) ", understood, "hardware: tests/integration, tests/unit"),
    Row(rf"{TOOL}config_page", understood, "writes: tests/unit/configs/test_config_page.py"),
    Row(rf"{TOOL}\w+", understood, "minutes to hours, and writes its page: tests/unit/tools"),
    Row(r"\.venv/bin/pre-commit install", outside, "changes the repository's hooks"),
    Row(r"make ", said_by_make, "sets up, or runs what runs this"),
    Row(r"\.venv/bin/pip install -e ", installable, "the network"),
    Row(r"sudo python3 -m tools\.deploy", understood, "root: tools.deploy.rehearsal"),
    Row(r"(sudo )?(systemctl|nano|cp|curl|debootstrap|systemd-nspawn) ", outside,
        "the system's, with root or on another computer"),
    Row(r"(docker|podman|buildah) ", outside, "a container engine"),
    Row(r"(git clone|cd) ", outside, "the network; the shell"),
)  # fmt: skip


def plain(command: str) -> str:
    """With a word for what another command would say."""
    return re.sub(r"\$\([^)]*\)", "secret", command)


def row_of(said: Said) -> Row:
    """The first row that knows the command."""
    for row in TABLE:
        if re.match(row.pattern, plain(said.command)):
            return row
    raise AssertionError(
        f"{said.place}: {said.command!r} is in no row of the table in {Path(__file__).name}: add "
        "one that says how it is checked, begin with .venv/bin/, or fence what is no command "
        "as ```text"
    )


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as a fresh clone is, with the reader's own files in it, as the current one."""
    for top in ("autonomy", "hal", "configs", "tests", "tools", "pyproject.toml", ".venv"):
        (tmp_path / top).symlink_to(ROOT / top)
    (tmp_path / "my-drone.yaml").write_text(DRONE, encoding="utf-8")
    shutil.copy(LOG, tmp_path / "LOG")
    (tmp_path / "px4.ulg").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path


@pytest.mark.parametrize("said", ALL, ids=[said.place for said in ALL])
def test_it_works_as_written(said: Said, clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = shlex.split(plain(said.command))
    assert "|" not in words, f"{said.place}: write one command a line"
    if words[0].startswith(".venv/bin/"):
        assert words[0].rpartition("/")[2] in {*PROGRAMS, *PROJECT["scripts"]}
    row_of(said).check(words, monkeypatch)


def test_an_unknown_command_is_told_with_its_place() -> None:
    with pytest.raises(AssertionError, match=r"README.md:3: 'rm -rf /' is in no row"):
        row_of(Said(ROOT / "README.md", 3, "rm -rf /"))


@pytest.mark.parametrize(
    ("command", "check"),
    [
        (".venv/bin/autonomy fly --goal 4,3 --sim nowhere", prepared),
        (".venv/bin/autonomy fly --goal 4,3 --config my-drone.yaml", prepared),
        (".venv/bin/autonomy fly --goal 4,3 --sim --fault gremlins", prepared),
        (".venv/bin/autonomy config check nothing.yaml", run),
        (".venv/bin/autonomy serve --simulated", understood),
        (".venv/bin/python -m tools.movers --look away", understood),
        ("make love", said_by_make),
        (".venv/bin/pip install -e '.[everything]'", installable),
        ("cp configs/nothing.yaml /etc", outside),
    ],
)
def test_what_would_not_work_is_noticed(
    command: str,
    check: Callable[[list[str], pytest.MonkeyPatch], None],
    clone: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises((Exception, SystemExit, pytest.fail.Exception)) as refused:
        check(shlex.split(command), monkeypatch)
    assert not isinstance(refused.value, _Understood)


def test_every_readme_s_commands_are_found() -> None:
    said = [(str(each.readme.relative_to(ROOT)), each.command) for each in ALL]
    assert ("README.md", "make fly") in said
    assert ("autonomy/service/README.md", "sudo systemctl enable --now --no-block autonomy") in said
    assert len(said) > 50


def test_the_reader_s_configuration_is_the_one_of_the_readme() -> None:
    assert DRONE in (ROOT / "configs" / "README.md").read_text(encoding="utf-8")


def test_the_flight_of_the_readme_is_flown_for_real() -> None:
    missions = (ROOT / "tests/integration/test_fly_missions.py").read_text(encoding="utf-8")
    assert "def test_the_goal_is_reached_and_nothing_was_touched" in missions
