"""Every measured sequence of commands, played again."""

import pytest

from tests.conformance.conftest import Needs, note
from tests.conformance.link import MockLink
from tests.conformance.transcript import Sequence, compare, sequences
from tests.conformance.vehicle import Vehicle


@pytest.mark.parametrize("sequence", sequences(), ids=lambda s: s.name)
def test_a_sequence_goes_as_measured(
    vehicle: Vehicle, needs: Needs, sequence: Sequence, request: pytest.FixtureRequest
) -> None:
    needs(*sequence.needs)
    if isinstance(vehicle.link, MockLink):
        vehicle.thin()
    seen = vehicle.play(sequence)
    rows = compare(sequence.seen, seen)
    note(request, rows)
    off = [str(row) for row in rows if row.share > 1.0]
    assert not off, "measured     seen\n" + "\n".join(off)
