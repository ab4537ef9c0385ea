"""The door to smbus2: real messages through a recording adapter, and every error as a sentence."""

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from smbus2 import i2c_msg

from hal.errors import ConnectionFailed
from hal.ranging.i2c_bus import (
    BusHeld,
    I2cError,
    LinuxI2cBus,
    NotAcknowledged,
    Registers,
    transfer_error,
)


class Recorder:
    """`smbus2.SMBus` that answers with 1, 2, 3 ... or fails as it is told."""

    def __init__(self, fd: int | None = None) -> None:
        self.fd = fd
        self.transfers: list[list[tuple[int, int, bytes]]] = []
        self.fails: OSError | None = None
        self.closed = 0

    def i2c_rdwr(self, *i2c_msgs: Any) -> None:
        if self.fails is not None:
            raise self.fails
        self.transfers.append([(m.addr, m.flags, bytes(m)) for m in i2c_msgs])
        for message in i2c_msgs:
            if message.flags & 1:
                answer = bytes(range(1, message.len + 1))
                for at, value in enumerate(answer):
                    message.buf[at] = bytes((value,))

    def close(self) -> None:
        self.closed += 1


def test_transfers_are_single_combined_messages() -> None:
    recorder = Recorder()
    bus = LinuxI2cBus("/dev/i2c-7", lambda _path: recorder)
    bus.write(0x29, b"\x80\x01")
    assert bus.write_read(0x29, b"\x13", 3) == b"\x01\x02\x03"
    assert recorder.transfers == [
        [(0x29, 0, b"\x80\x01")],
        [(0x29, 0, b"\x13"), (0x29, 1, b"\x00\x00\x00")],
    ]
    assert len(i2c_msg.read(0x29, 3)) == 3


def test_registers_are_big_endian_behind_one_or_two_index_bytes() -> None:
    recorder = Recorder()
    bus = LinuxI2cBus("/dev/i2c-7", lambda _path: recorder)
    Registers(bus, 0x29, 2).write_number(0x6C, 0x01020304, 4)
    assert Registers(bus, 0x48, 1).read_number(0x01, 2) == 0x0102
    assert recorder.transfers[0] == [(0x29, 0, b"\x00\x6c\x01\x02\x03\x04")]
    assert recorder.transfers[1][0] == (0x48, 0, b"\x01")


@pytest.mark.parametrize(
    ("number", "kind", "words"),
    [
        (errno.EREMOTEIO, NotAcknowledged, "nobody answers at 0x29"),
        (errno.ENXIO, NotAcknowledged, "nobody answers at 0x29"),
        (errno.ETIMEDOUT, BusHeld, "is held"),
        (errno.EAGAIN, BusHeld, "is held"),
        (errno.EIO, I2cError, "failed"),
    ],
)
def test_an_error_of_the_kernel_says_what_is_wrong(
    number: int, kind: type[I2cError], words: str
) -> None:
    recorder = Recorder()
    recorder.fails = OSError(number, os.strerror(number))
    bus = LinuxI2cBus("/dev/i2c-7", lambda _path: recorder)
    with pytest.raises(kind, match=words) as raised:
        bus.write(0x29, b"\x00")
    assert type(raised.value) is kind
    assert type(transfer_error("b", 1, recorder.fails)) is kind


def test_a_bus_that_is_not_there_is_told_with_a_remedy() -> None:
    with pytest.raises(ConnectionFailed, match="enable I2C and load i2c-dev"):
        LinuxI2cBus("/dev/i2c-does-not-exist")


def test_a_bus_that_may_not_be_opened_names_the_group() -> None:
    def refuse(path: str) -> Recorder:
        raise PermissionError(errno.EACCES, "no", path)

    with pytest.raises(ConnectionFailed, match="group i2c"):
        LinuxI2cBus("/dev/i2c-1", refuse)


def test_another_device_is_not_taken_for_a_bus() -> None:
    with pytest.raises(ConnectionFailed, match="is not an I2C bus"):
        LinuxI2cBus("/dev/null")


def test_a_device_that_takes_no_time_limit_is_not_a_bus() -> None:
    with Path("/dev/null").open("rb") as other:
        recorder = Recorder(other.fileno())
        with pytest.raises(ConnectionFailed, match="is not an I2C bus"):
            LinuxI2cBus("/dev/i2c-7", lambda _path: recorder)
    assert recorder.closed == 1


def test_a_missing_package_is_told() -> None:
    def missing(_path: str) -> Recorder:
        raise ModuleNotFoundError("smbus2")

    with pytest.raises(ConnectionFailed, match=r"pip install 'autonomy\[hardware\]'"):
        LinuxI2cBus("/dev/i2c-1", missing)


def test_reopening_closes_first_and_a_closed_bus_is_told() -> None:
    recorders = [Recorder(), Recorder()]
    left = list(recorders)
    bus = LinuxI2cBus("/dev/i2c-7", lambda _path: left.pop(0))
    bus.reopen()
    assert (recorders[0].closed, recorders[1].closed) == (1, 0)
    bus.close()
    bus.close()
    assert recorders[1].closed == 1
    with pytest.raises(I2cError, match="closed"):
        bus.write(0x29, b"")
