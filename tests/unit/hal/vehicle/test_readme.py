"""What hal/vehicle/README.md names as support for an assumption exists."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[4]
GOLDEN = ROOT / "tests" / "golden" / "px4"


def test_every_measured_sequence_that_supports_an_assumption_exists() -> None:
    readme = (ROOT / "hal" / "vehicle" / "README.md").read_text(encoding="utf-8")
    rows = readme.split("## What this program takes for granted")[1].splitlines()
    support = [row.rsplit(" | ", 1)[1] for row in rows if row.startswith("| ") and " | " in row]
    named = {name for cell in support for name in re.findall(r"`([a-z0-9_.]+)`", cell)}
    files = {name for name in named if name.endswith(".json")}
    assert files
    for name in files:
        assert (GOLDEN / name).is_file(), name
    sequences = json.loads((GOLDEN / "sequences.json").read_text())["sequences"]
    known = {s if isinstance(s, str) else s["name"] for s in sequences}
    assert {name for name in named - files if not name.startswith(".")} - known == set()
    assert len(named - files) > 10
