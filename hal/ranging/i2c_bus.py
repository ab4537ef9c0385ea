"""Linux I2C: the one door to smbus2, and the small protocol that the chips are written against.

Every call blocks for the length of the transfer: about 0.3 ms for 13 bytes at 400 kHz, at most
`TRANSFER_LIMIT_S` when the bus is stuck. Calls are for the thread that serves the bus.
"""

import errno
import fcntl
from collections.abc import Callable
from typing import Any, Protocol

from hal.errors import ConnectionFailed, HalError

TRANSFER_LIMIT_S = 0.03
"""After this the kernel gives a transfer up; its own default of 1 s would stall all beams."""
_I2C_RETRIES, _I2C_TIMEOUT = 0x0701, 0x0702  # include/uapi/linux/i2c-dev.h
_TIMEOUT_UNIT_S = 0.01

_NOT_ACKNOWLEDGED = (errno.ENXIO, errno.EREMOTEIO)
_HELD = (errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY)
"""Timed out, lost arbitration, never idle: what a data line that is held low looks like."""


class I2cError(HalError):
    """A transfer failed; what the chip has of it is not known."""


class NotAcknowledged(I2cError):
    """Nobody answers at the address: no chip, no power, in reset, or at another address."""


class BusHeld(I2cError):
    """The bus is not free: a chip or a short circuit holds a line low."""


class I2cBus(Protocol):
    """One I2C bus, or the part of it behind a multiplexer's channel."""

    def write(self, address: int, data: bytes) -> None:
        """One write transfer; raises I2cError."""
        ...

    def write_read(self, address: int, data: bytes, count: int) -> bytes:
        """Write, repeated start, read `count` bytes; raises I2cError."""
        ...

    def reopen(self) -> None:
        """Let the adapter begin anew; raises ConnectionFailed."""
        ...

    def close(self) -> None:
        """Let go of the adapter. May be called twice."""
        ...


class Adapter(Protocol):
    """What is used of `smbus2.SMBus`."""

    fd: int | None

    def i2c_rdwr(self, *i2c_msgs: Any) -> None:
        """One combined transfer."""
        ...

    def close(self) -> None:
        """Let go of the device."""
        ...


def _smbus(path: str) -> Adapter:
    from smbus2 import SMBus

    return SMBus(path)


class LinuxI2cBus:
    """`I2cBus` on a device node such as /dev/i2c-1."""

    def __init__(self, path: str, connect: Callable[[str], Adapter] = _smbus) -> None:
        """Raises ConnectionFailed with what to do: driver not loaded, permission, package."""
        self._path = path
        self._connect = connect
        self._adapter: Adapter | None = None
        self.reopen()

    def write(self, address: int, data: bytes) -> None:
        """One write transfer; raises I2cError."""
        from smbus2 import i2c_msg

        self._transfer(address, i2c_msg.write(address, data))

    def write_read(self, address: int, data: bytes, count: int) -> bytes:
        """Write, repeated start, read `count` bytes; raises I2cError."""
        from smbus2 import i2c_msg

        answer: Any = i2c_msg.read(address, count)  # its stub says that it holds text
        self._transfer(address, i2c_msg.write(address, data), answer)
        return bytes(answer)

    def _transfer(self, address: int, *messages: object) -> None:
        if self._adapter is None:
            raise BusHeld(f"{self._path} is closed; open it first")
        try:
            self._adapter.i2c_rdwr(*messages)
        except OSError as error:
            raise transfer_error(self._path, address, error) from None

    def reopen(self) -> None:
        """Open the device anew and bound its transfers; raises ConnectionFailed."""
        self.close()
        try:
            self._adapter = self._connect(self._path)
        except ModuleNotFoundError:
            raise ConnectionFailed(
                "smbus2 is not installed; I2C sensors need: pip install 'autonomy[hardware]'"
            ) from None
        except OSError as error:
            raise ConnectionFailed(opening_sentence(self._path, error)) from None
        self._bound()

    def _bound(self) -> None:
        descriptor = self._adapter.fd if self._adapter is not None else None
        if descriptor is None:
            return
        try:
            fcntl.ioctl(descriptor, _I2C_TIMEOUT, round(TRANSFER_LIMIT_S / _TIMEOUT_UNIT_S))
            fcntl.ioctl(descriptor, _I2C_RETRIES, 0)
        except OSError as error:
            self.close()
            raise ConnectionFailed(opening_sentence(self._path, error)) from None

    def close(self) -> None:
        """Let go of the device. May be called twice."""
        adapter, self._adapter = self._adapter, None
        if adapter is not None:
            adapter.close()


def transfer_error(path: str, address: int, error: OSError) -> I2cError:
    """`error` of a transfer, by what it says of the bus."""
    if error.errno in _NOT_ACKNOWLEDGED:
        return NotAcknowledged(f"nobody answers at {address:#04x} on {path}")
    if error.errno in _HELD:
        return BusHeld(f"{path} is held while talking to {address:#04x} ({error.strerror})")
    return I2cError(f"transfer with {address:#04x} on {path} failed ({error.strerror})")


def opening_sentence(path: str, error: OSError) -> str:
    """Why `path` cannot be opened, and what to do."""
    if error.errno == errno.ENOENT:
        return f"{path} does not exist; enable I2C and load i2c-dev, see hal/ranging/README.md"
    if error.errno == errno.ENOTTY:
        return f"{path} is not an I2C bus; check the bus in beams.drivers"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"{path} may not be opened; add this user to the group i2c"
    return f"{path} cannot be opened ({error.strerror})"


class Registers:
    """A chip's registers: an index of one or two bytes, then data, most significant byte first."""

    def __init__(self, bus: I2cBus, address: int, index_bytes: int) -> None:
        self._bus = bus
        self.address = address
        self._index_bytes = index_bytes

    def write(self, index: int, *values: int) -> None:
        """Bytes from `index` on; raises I2cError."""
        self._bus.write(self.address, self._index(index) + bytes(values))

    def write_number(self, index: int, value: int, size: int) -> None:
        """`value` as `size` bytes; raises I2cError."""
        self._bus.write(self.address, self._index(index) + value.to_bytes(size, "big"))

    def read(self, index: int) -> int:
        """One byte; raises I2cError."""
        return self.read_block(index, 1)[0]

    def read_number(self, index: int, size: int) -> int:
        """`size` bytes as an unsigned number; raises I2cError."""
        return int.from_bytes(self.read_block(index, size), "big")

    def read_block(self, index: int, count: int) -> bytes:
        """`count` bytes from `index` on; raises I2cError."""
        return self._bus.write_read(self.address, self._index(index), count)

    def _index(self, index: int) -> bytes:
        return index.to_bytes(self._index_bytes, "big")
