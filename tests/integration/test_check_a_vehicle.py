"""`autonomy check` against the mock PX4: what is wrong, set right, and read back."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.flying import ROOT
from tests.support.mock_px4 import MockProcess

pytestmark = pytest.mark.integration

WRONG = """
name: wrong
vehicle: {parameters: {COM_OBL_RC_ACT: 0, COM_OF_LOSS_T: 3, NAV_DLL_ACT: 2, MPC_XY_P: 2.0}}
"""
LIMIT_S = 600.0
"""A first look compiles the kernels, on a busy machine for minutes."""
GRAVE = {"COM_OBL_RC_ACT", "COM_OF_LOSS_T", "NAV_DLL_ACT", "MPC_XY_P"}
NO_GNSS = """
name: no_gnss
gnss: {present: false}
vehicle: {parameters: {COM_OBL_RC_ACT: 4, SYS_HAS_GPS: 0}}
"""


def check(connection: str, *options: str) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "autonomy.cli", "check", "--connection", connection, *options],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        timeout=LIMIT_S,
        stdin=subprocess.DEVNULL,
    )
    return done.returncode, done.stdout, done.stderr


def findings(connection: str, *options: str) -> tuple[int, dict[str, Any]]:
    code, out, errors = check(connection, "--json", *options)
    told = [line for line in errors.splitlines() if "compil" not in line]
    assert told == [] or "--yes" in options, errors
    document: dict[str, Any] = json.loads(out)
    return code, document


def room(folder: Path, text: str) -> str:
    path = folder / "room.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_wrong_parameters_are_found_set_read_back_and_put_back(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", room(tmp_path, WRONG)) as mock:
        code, before = findings(mock.connection)
        assert code == 6
        assert not before["ready"]
        bad = {f["subject"] for f in before["findings"] if not f["good"] and f["grave"]}
        assert bad == GRAVE

        code, _, errors = check(mock.connection, "--fix")
        assert code == 3
        assert "--yes" in errors, "without a terminal nothing is set unasked"

        code, out, _ = check(mock.connection, "--fix", "--yes")
        assert code == 0, out
        assert "COM_OBL_RC_ACT: 0 -> 5, read back" in out
        undo = next(line for line in out.splitlines() if line.startswith("to undo: "))
        settings = undo.split(mock.connection)[1].split()
        assert "COM_OBL_RC_ACT=0" in settings

        code, out, _ = check(mock.connection, *settings, "--yes")
        assert code == 0, out
        code, after = findings(mock.connection)
        assert code == 6
        assert {f["subject"] for f in after["findings"] if not f["good"] and f["grave"]} == GRAVE


def test_why_it_will_not_arm_without_a_global_position_is_told(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", room(tmp_path, NO_GNSS)) as mock:
        code, document = findings(mock.connection)
    assert code == 0, document
    sentences = [f["sentence"] for f in document["findings"] if f["subject"] == "arming"]
    assert len(sentences) == 1
    assert "it will not arm in hold, which needs a global position" in sentences[0]
    assert "arms it in Takeoff" in sentences[0]


def test_virtual_beams_are_looked_at_and_warned_of(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--no-beams") as mock:
        code, document = findings(mock.connection, "--beams", "virtual:default")
        assert code == 0, document
        beams = [f["sentence"] for f in document["findings"] if f["subject"] == "beams"]
        assert "does not see the real world" in beams[0]
        assert sum("Hz" in sentence for sentence in beams) == 6
        code, document = findings(mock.connection)
        assert code == 6
        assert any("no beam of front" in f["sentence"] for f in document["findings"])
