"""What a message tells people to install is there to be installed."""

import re
import tomllib
from pathlib import Path

from autonomy.cli import _OF_THE_SERVICE

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]


def test_every_extra_that_a_message_or_a_readme_names_exists() -> None:
    places = [*ROOT.glob("*.md"), *ROOT.glob("autonomy/**/*"), *ROOT.glob("hal/**/*")]
    named: set[str] = set()
    for path in places:
        if path.suffix in (".py", ".md") and path.is_file():
            text = path.read_text(encoding="utf-8")
            for inside in re.findall(r"(?:autonomy|\.)\[([a-z,]+)\]['\"`]", text):
                named.update(inside.split(","))
    assert {"service", "log", "hardware"} <= named
    assert named <= set(EXTRAS)


def test_the_service_s_libraries_are_those_of_its_extra() -> None:
    brought = {re.split(r"[>=<\[]", each)[0].replace("-", "_") for each in EXTRAS["service"]}
    assert set(_OF_THE_SERVICE) == brought
