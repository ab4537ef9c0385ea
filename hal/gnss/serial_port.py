"""A serial port as bytes in and one way to fail; the one door to pyserial."""

import errno
import termios
from types import TracebackType
from typing import Protocol, Self

from hal.errors import HalError

READ_TIMEOUT_S = 0.1
"""A read returns within this; longer than any pause inside a burst of a receiver."""
_CHUNK = 4096


def load() -> None:
    """Load the library; raises ImportError."""
    import serial  # noqa: F401 - only a vehicle with a serial receiver needs it


class PortGone(HalError):
    """The port cannot be opened, or its device vanished; it may come back."""


class Port(Protocol):
    """An open serial port; closed by leaving its context."""

    def read(self) -> bytes:
        """What has come, as soon as something has; empty after READ_TIMEOUT_S of silence.

        Raises PortGone.
        """
        ...

    def set_baud(self, baud: int) -> None:
        """Speak at another rate from now on; what came at the old one is dropped.

        Raises PortGone.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class SerialPort:
    """`Port` on a device of the operating system, 8 data bits, no parity, no flow control.

    Locked against other users of this driver's kind. Raises PortGone.
    """

    def __init__(self, path: str, baud: int) -> None:
        import serial

        try:
            self._serial = serial.Serial(path, baud, timeout=READ_TIMEOUT_S, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise PortGone(what_to_do(path, error)) from None
        self._path = path

    def read(self) -> bytes:
        """See `Port`."""
        try:
            first: bytes = self._serial.read(1)
            if not first:
                return b""
            return first + bytes(self._serial.read(min(self._serial.in_waiting, _CHUNK)))
        except (OSError, TypeError, termios.error) as error:
            raise PortGone(what_to_do(self._path, error)) from None

    def set_baud(self, baud: int) -> None:
        """See `Port`."""
        try:
            self._serial.baudrate = baud
            self._serial.reset_input_buffer()
        except (OSError, ValueError, termios.error) as error:
            raise PortGone(what_to_do(self._path, error)) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._serial.close()
        except (OSError, termios.error):
            return  # the device took its port along


def what_to_do(path: str, error: BaseException) -> str:
    """The sentence of a PortGone: what is wrong with `path`, and the remedy."""
    causes = (error, error.__context__)
    numbers = [e.args[0] for e in causes if e is not None and e.args and isinstance(e.args[0], int)]
    remedy = _REMEDIES.get(numbers[0]) if numbers else None
    return f"{path} {remedy or f'does not answer ({error})'}"


_REMEDIES = {
    errno.ENOENT: "is not there; plug the receiver in, or correct gnss.port",
    errno.EAGAIN: "is in use by another program (gpsd, ModemManager?); stop that one",
    errno.EBUSY: "is in use by another program (gpsd, ModemManager?); stop that one",
    errno.EACCES: "may not be opened; add the user to the group dialout",
    errno.ENOTTY: "is not a serial port; correct gnss.port",
}
