import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from autonomy.service.systemd import Notifier


class Listener:
    def __init__(self, wire: socket.socket, address: str) -> None:
        self._wire = wire
        self.address = address

    def heard(self) -> list[str]:
        messages = []
        while True:
            try:
                messages.append(self._wire.recv(4096).decode())
            except BlockingIOError:
                return messages


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[Listener]:
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as wire:
        wire.bind(address)
        yield Listener(wire, address)


def test_readiness_and_stopping_are_told(systemd: Listener) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address})
    notifier.ready()
    notifier.extend_s(90.0)
    notifier.stopping()
    assert systemd.heard() == [
        "READY=1",
        "EXTEND_TIMEOUT_USEC=90000000",
        "STOPPING=1\nWATCHDOG_USEC=0",
    ]


def test_a_status_is_one_line_and_told_when_it_changes(systemd: Listener) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address})
    for sentence in ("waiting", "waiting", "two\nREADY=1"):
        notifier.status(sentence)
    assert systemd.heard() == ["STATUS=waiting", "STATUS=two READY=1"]


def test_signs_of_life_pass_at_a_quarter_of_the_watchdog_s_period(systemd: Listener) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address, "WATCHDOG_USEC": "2000000"})
    notifier.ready()
    for tick in range(41):  # two seconds at 20 Hz
        notifier.alive(100.0 + tick * 0.05)
    assert 4 <= systemd.heard().count("WATCHDOG=1") <= 5


def test_no_sign_of_life_begins_the_watchdog_before_readiness_or_after_the_end(
    systemd: Listener,
) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address, "WATCHDOG_USEC": "2000000"})
    notifier.alive(100.0)
    notifier.ready()
    notifier.stopping()
    notifier.alive(200.0)
    assert "WATCHDOG=1" not in systemd.heard()


@pytest.mark.parametrize(
    "environ",
    [
        {},
        {"WATCHDOG_USEC": "0"},
        {"WATCHDOG_USEC": "x"},
        {"WATCHDOG_USEC": "9", "WATCHDOG_PID": "1"},
    ],
)
def test_without_a_watchdog_for_this_process_no_life_is_told(
    systemd: Listener, environ: dict[str, str]
) -> None:
    assert os.getpid() != 1
    notifier = Notifier({"NOTIFY_SOCKET": systemd.address, **environ})
    notifier.ready()
    notifier.alive(1.0)
    assert systemd.heard() == ["READY=1"]


@pytest.mark.parametrize("address", ["", "/nowhere/at/all", "@nobody-listens-here", "relative"])
def test_nobody_listening_is_no_error(address: str) -> None:
    Notifier({"NOTIFY_SOCKET": address}).ready()


def test_an_abstract_socket_is_reached() -> None:
    name = f"autonomy-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as wire:
        wire.bind("\0" + name)
        Notifier({"NOTIFY_SOCKET": "@" + name}).ready()
        assert wire.recv(100) == b"READY=1"
