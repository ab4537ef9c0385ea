"""Rooms in which something once went wrong, or nearly (tools/hunt): each has to end well."""

from pathlib import Path

import pytest

from hal.sim.scenario import load_scenario
from tools.hunt.trial import fly

ROOMS = sorted((Path(__file__).parent / "rooms").glob("*.yaml"))


def test_there_are_rooms() -> None:
    assert ROOMS


@pytest.mark.parametrize("path", ROOMS, ids=lambda path: path.stem)
def test_the_flight_ends_well(path: Path) -> None:
    """The mode is the last word of the file's name: NAME.rolling.yaml."""
    mode = path.suffixes[-2].removeprefix(".")
    flight = fly(load_scenario(str(path)), mode, path.stem)
    assert flight.failure == "", flight
