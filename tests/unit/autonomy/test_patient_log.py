"""A reader that stands still holds nobody up."""

import contextlib
import logging
import os
import threading
from collections.abc import Iterator

import pytest

from autonomy.patient_log import LINES_KEPT, patient_log
from hal.clock import SimClock
from hal.config import DeadmanConfig
from hal.vehicle.deadman import Deadman

LOG = logging.getLogger("autonomy.test")


class Pipe:
    """Where the log goes, and who may read it."""

    def __init__(self) -> None:
        self.read_end, self.write_end = os.pipe()

    def fill(self) -> None:
        """As a terminal that was stopped long ago."""
        os.set_blocking(self.write_end, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(self.write_end, b"\n" * 512)
        os.set_blocking(self.write_end, True)

    def read(self) -> str:
        """All that was written; the writer is done."""
        os.close(self.write_end)
        with os.fdopen(self.read_end, "rb", closefd=False) as stream:
            return stream.read().decode().lstrip("\n")


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    made = Pipe()
    yield made
    os.close(made.read_end)
    with contextlib.suppress(OSError):
        os.close(made.write_end)


def test_what_is_said_arrives_with_its_level_and_its_cause(pipe: Pipe) -> None:
    with patient_log(descriptor=pipe.write_end):
        LOG.info("the vehicle is %s", "armed")
        LOG.debug("not asked for")
        try:
            dict[str, int]()["beam"]
        except KeyError:
            LOG.exception("it failed")
    lines = pipe.read().splitlines()
    assert lines[:3] == [
        "INFO the vehicle is armed",
        "ERROR it failed",
        "Traceback (most recent call last):",
    ]
    assert lines[-1] == "KeyError: 'beam'"


def test_a_silent_vehicle_is_stopped_and_held_though_nobody_reads_the_log(pipe: Pipe) -> None:
    pipe.fill()
    clock, held = SimClock(), threading.Event()
    done = list[str]()

    def hold() -> bool:
        done.append("hold")
        held.set()
        return True

    config = DeadmanConfig(timeout_s=0.25, hold_after_s=1.0)
    with patient_log(descriptor=pipe.write_end):
        LOG.warning("the line that the terminal does not take")
        with Deadman(config, lambda: done.append("stop"), hold, clock) as watch:
            watch.feed()
            for _ in range(200):
                clock.advance(0.3)
                if held.wait(0.1):
                    break
        assert done[0] == "stop"
        assert held.is_set()
        reader = threading.Thread(target=os.read, args=(pipe.read_end, 1 << 20))
        reader.start()
        reader.join()


def test_what_nobody_reads_is_counted_and_the_program_ends(pipe: Pipe) -> None:
    pipe.fill()
    with patient_log(descriptor=pipe.write_end):
        for count in range(LINES_KEPT + 12):
            LOG.info("line %d", count)
        os.read(pipe.read_end, 1 << 20)
    said = pipe.read()
    assert "INFO line 0\n" in said
    assert "lines were left out: nobody read them" in said


def test_the_log_is_as_it_was_afterwards(pipe: Pipe) -> None:
    root = logging.getLogger()
    before = (root.level, list(root.handlers))
    with patient_log(descriptor=pipe.write_end):
        assert len(root.handlers) == len(before[1]) + 1
    assert (root.level, list(root.handlers)) == before


def test_a_pipe_that_was_closed_ends_nothing(pipe: Pipe) -> None:
    gone, kept = os.pipe()
    os.close(gone)
    with patient_log(descriptor=kept):
        LOG.info("to nobody")
    os.close(kept)
