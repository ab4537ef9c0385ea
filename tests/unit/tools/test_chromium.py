"""The browser for the page's tests: found, installed by root, or asked for in a sentence."""

import ctypes.util
import os
from pathlib import Path

import pytest

from tools import chromium


def program(folder: Path, name: str, code: str = "") -> Path:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{code}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is all of PATH, on a computer that has the driver's library."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CHROMIUM", raising=False)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: f"lib{name}.so.1")
    return tmp_path


def test_the_one_that_is_named_goes_first(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named, found = program(path, "mine"), program(path, "chromium")
    assert chromium.installed() == str(found)
    monkeypatch.setenv("CHROMIUM", str(named))
    assert chromium.installed() == str(named)
    monkeypatch.setenv("CHROMIUM", str(path / "none"))
    with pytest.raises(chromium.NoBrowser, match="apt-get install chromium"):
        chromium.installed()


def test_root_gets_it_from_apt(path: Path) -> None:
    making = f"[ $1 = update ] || {{ echo > {path}/chromium; /bin/chmod +x {path}/chromium; }}"
    program(path, "apt-get", making)
    assert chromium.installed() == str(path / "chromium")


def test_a_browser_without_what_drives_it_gets_that(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(path, "chromium")
    program(path, "apt-get", f"echo $@ >> {path}/asked")
    assert chromium.missing() == []
    monkeypatch.setattr(ctypes.util, "find_library", lambda _: None)
    assert chromium.missing() == ["libatomic1"]
    assert chromium.installed() == str(path / "chromium")
    asked = (path / "asked").read_text().splitlines()
    assert asked == ["update -qq", "install -y -qq --no-install-recommends libatomic1"]


@pytest.mark.parametrize(("user", "code"), [(1000, "exit 0"), (0, "exit 100"), (0, "exit 0")])
def test_without_it_a_sentence_says_what_to_do(
    path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    user: int,
    code: str,
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: user)
    program(path, "apt-get", code)
    assert chromium.main() == 1
    assert "CHROMIUM=" in capsys.readouterr().err
