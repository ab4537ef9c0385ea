"""The lock file fits what pyproject.toml asks for, and one that does not is noticed."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.markers import Marker

from tools.lock import EXTRAS, LOCK, misfits, pins

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
TEXT = LOCK.read_text(encoding="utf-8")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")


def asking(**changes: list[str]) -> dict[str, Any]:
    """A project that asks for two packages, with `changes`."""
    project = {"dependencies": ["first>=1.0"], "requires-python": ">=3.11"}
    extras = {name: ["second>=2.0"] for name in EXTRAS}
    system = {"requires": ["builder>=3"]}
    return {
        "project": project | {"optional-dependencies": extras} | changes,
        "build-system": system,
    }


def locked(name: str, version: str, why: str = "    # via autonomy (pyproject.toml)\n") -> str:
    """An entry as uv writes it."""
    return f"{name}=={version} \\\n    --hash=sha256:{'0' * 64}\n{why}"


FITTING = locked("first", "1.2") + locked("second", "2.0") + locked("builder", "3.1", "")


def test_the_lock_file_fits_what_is_asked_for() -> None:
    assert misfits(PROJECT, TEXT) == []


def test_every_entry_has_a_hash_and_no_place_of_its_own() -> None:
    assert all(pin.hashes for pin in pins(TEXT))
    assert "://" not in TEXT


@pytest.mark.parametrize("python", PYTHONS)
def test_each_python_finds_at_most_one_version_of_a_package(python: str) -> None:
    facts = {"python_version": python, "python_full_version": f"{python}.1"}
    chosen = [p.name for p in pins(TEXT) if p.marker is None or Marker(p.marker).evaluate(facts)]
    assert len(chosen) == len(set(chosen))
    assert {"numba", "numpy", "scipy", "mavsdk"} <= set(chosen)


def test_the_image_s_python_is_one_of_those_it_is_made_for() -> None:
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    base = re.search(r"^ARG BASE=python:(\d+\.\d+)\.\d+-\S+@sha256:[0-9a-f]{64}$", dockerfile, re.M)
    assert base is not None
    assert base[1] in PYTHONS


def test_what_fits_is_not_complained_about() -> None:
    assert misfits(asking(), FITTING) == []


def test_a_package_that_is_not_locked_is_named() -> None:
    wanting = asking(dependencies=["first>=1.0", "third>=0.1"])
    assert misfits(wanting, FITTING) == ["third is not locked"]


def test_a_version_that_is_too_old_is_named() -> None:
    sentences = misfits(asking(dependencies=["first>=1.3"]), FITTING)
    assert sentences == ["first is locked at 1.2, pyproject.toml asks for >=1.3"]


def test_a_package_that_nobody_asks_for_any_more_is_named() -> None:
    for why in ("    # via autonomy (pyproject.toml)\n", ""):
        sentences = misfits(asking(), FITTING + locked("old", "1.0", why))
        assert sentences == ["old is locked, but pyproject.toml asks for it no more"]


def test_what_others_need_in_turn_may_be_there() -> None:
    assert misfits(asking(), FITTING + locked("deeper", "1.0", "    # via first\n")) == []


def test_a_line_without_a_version_is_refused() -> None:
    with pytest.raises(ValueError, match="no pinned version"):
        list(pins("first>=1.0\n"))


def test_an_entry_without_a_hash_is_named() -> None:
    bare = FITTING.replace(f"--hash=sha256:{'0' * 64}", "", 1)
    assert misfits(asking(), bare) == ["first 1.2 has no hash"]


def test_the_check_is_a_command_that_needs_no_network() -> None:
    command = [sys.executable, "-m", "tools.lock", "--check"]
    done = subprocess.run(
        command, cwd=ROOT, env={"PATH": ""}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "")
