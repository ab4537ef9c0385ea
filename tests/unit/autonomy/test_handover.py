"""`autonomy fly` beside a service that does not answer in time: no order is lost for it."""

import signal
from typing import cast

import pytest

from autonomy.errors import AutonomyError, BadInput
from autonomy.handover import _interrupts
from autonomy.progress import Progress
from autonomy.service.client import Client, NoService


class Slow:
    """A service that fails as often as there are errors, then takes orders."""

    def __init__(self, *errors: AutonomyError) -> None:
        self.errors = list(errors)
        self.taken: list[str] = []

    def command(self, name: str) -> None:
        if self.errors:
            raise self.errors.pop(0)
        self.taken.append(name)


class Said:
    """What a person reads."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


@pytest.mark.parametrize("error", [NoService("timed out"), BadInput("not now")])
def test_a_stop_that_was_not_delivered_is_told_and_asked_again(error: AutonomyError) -> None:
    service, said = Slow(error), Said()
    with _interrupts(cast("Client", service), cast("Progress", said)):
        for _ in range(3):
            signal.raise_signal(signal.SIGINT)
    assert service.taken == ["stop", "land"]
    assert f"stop was not delivered ({error}); press Ctrl-C to try again" in said.notes
