"""The thread that puts setpoints on the wire: newest only, and nothing old after a stop."""

import threading
from collections.abc import Iterator

import pytest

from hal.setpoints import Setpoint
from hal.vehicle.setpoint_sender import SetpointSender

WAIT_S = 10.0


class SlowWire:
    """Notes what arrives; the first setpoint is under way until `go_on` is set."""

    def __init__(self) -> None:
        self.arrived: list[str | float] = []
        self.under_way = threading.Event()
        self.go_on = threading.Event()
        self.quiet = threading.Event()
        self.last = 0.0

    def put(self, setpoint: Setpoint) -> None:
        self.under_way.set()
        assert self.go_on.wait(WAIT_S)
        self.arrived.append(setpoint.stamp_s)
        if setpoint.stamp_s == self.last:
            self.quiet.set()

    def stop(self) -> None:
        self.arrived.append("stop")


@pytest.fixture
def wire() -> SlowWire:
    return SlowWire()


@pytest.fixture
def sender(wire: SlowWire) -> Iterator[SetpointSender]:
    sender = SetpointSender(wire.put)
    yield sender
    wire.go_on.set()
    sender.close()


def at(stamp_s: float) -> Setpoint:
    return Setpoint(stamp_s, (0.0, 0.0, -1.0))


def test_only_the_newest_leaves_once_the_wire_is_free(
    wire: SlowWire, sender: SetpointSender
) -> None:
    wire.last = 9.0
    sender.send(at(1.0))
    assert wire.under_way.wait(WAIT_S)
    for stamp_s in range(2, 10):
        sender.send(at(float(stamp_s)))
    wire.go_on.set()
    assert wire.quiet.wait(WAIT_S)
    assert wire.arrived == [1.0, 9.0]


def test_nothing_older_follows_a_stop_not_even_what_was_under_way(
    wire: SlowWire, sender: SetpointSender
) -> None:
    sender.send(at(1.0))
    assert wire.under_way.wait(WAIT_S)
    sender.send(at(2.0))
    stopping = threading.Thread(target=sender.instead, args=(wire.stop,))
    stopping.start()
    stopping.join(0.05)
    assert wire.arrived == [], "the stop waits for what is under way"
    wire.go_on.set()
    stopping.join(WAIT_S)
    assert wire.arrived[0] == 1.0
    assert wire.arrived[-1] == "stop"
    assert not stopping.is_alive()


def test_what_comes_after_a_stop_leaves(wire: SlowWire, sender: SetpointSender) -> None:
    wire.go_on.set()
    wire.last = 3.0
    sender.instead(wire.stop)
    sender.send(at(3.0))
    assert wire.quiet.wait(WAIT_S)
    assert wire.arrived == ["stop", 3.0]


def test_a_closed_sender_sends_nothing_more() -> None:
    wire = SlowWire()
    wire.go_on.set()
    sender = SetpointSender(wire.put)
    sender.close()
    sender.send(at(1.0))
    assert wire.arrived == []
