"""Flights through the shipped worlds, flown once and looked at by many tests."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from tests.support.flying import Flying

MISSIONS = {
    "default": ("--goal", "4,3", "--sim", "default", "--mode", "stop"),
    "empty": ("--goal", "4,3", "--sim", "empty"),
    "door": ("--sim", "door", "--mode", "rolling"),
    "u_trap": ("--sim", "u_trap", "--mode", "stop"),
}


@pytest.fixture(scope="session")
def missions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Flying]]:
    """By scenario: the flight, begun but not ended. They are long and fly beside one another."""
    with ExitStack() as stack:
        yield {
            name: stack.enter_context(Flying(tmp_path_factory.mktemp(name), *arguments))
            for name, arguments in MISSIONS.items()
        }
