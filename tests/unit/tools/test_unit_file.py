"""What runs without systemd runs as the unit says."""

import subprocess
import sys

import pytest

from tools import unit_file


def test_the_interpreter_has_the_units_settings_and_this_processs_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("AUTONOMY_TEST", "here")
    environment = unit_file.environment()
    assert environment["PYTHONMALLOC"] == "malloc"
    assert environment["AUTONOMY_TEST"] == "here"
    assert "NUMBA_CACHE_DIR" not in environment or environment["NUMBA_CACHE_DIR"] != (
        "/var/cache/autonomy"
    )


def test_a_command_is_started_so() -> None:
    prints = "import os, sys; print(os.environ['PYTHONMALLOC'], file=sys.stderr)"
    process = unit_file.started([sys.executable, "-c", prints], subprocess.PIPE)
    assert process.stderr is not None
    said = process.communicate(timeout=60.0)[1]
    assert said.strip() == b"malloc"


def test_the_unit_asks_for_more_than_its_share_of_the_processor() -> None:
    assert -20 <= unit_file.niceness() < 0
