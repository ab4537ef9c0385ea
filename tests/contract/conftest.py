"""One mock PX4 for a module of contract tests: starting it takes longer than most of them."""

from collections.abc import Iterator

import pytest

from autonomy.embedded import EmbeddedPx4
from tests.contract.rigs import SCENARIO


@pytest.fixture(scope="module")
def px4() -> Iterator[EmbeddedPx4]:
    """The mock PX4 in a process of its own."""
    with EmbeddedPx4(SCENARIO, 5) as running:
        yield running
