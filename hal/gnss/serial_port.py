"""A serial port as bytes in and one way to fail; the one door to pyserial."""

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
            raise PortGone(_sentence(path, error)) from None
        self._path = path

    def read(self) -> bytes:
        """See `Port`."""
        try:
            first: bytes = self._serial.read(1)
            if not first:
                return b""
            return first + bytes(self._serial.read(min(self._serial.in_waiting, _CHUNK)))
        except (OSError, TypeError, termios.error) as error:
            raise PortGone(_sentence(self._path, error)) from None

    def set_baud(self, baud: int) -> None:
        """See `Port`."""
        try:
            self._serial.baudrate = baud
            self._serial.reset_input_buffer()
        except (OSError, ValueError, termios.error) as error:
            raise PortGone(_sentence(self._path, error)) from None

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


def _sentence(path: str, error: Exception) -> str:
    """What to do about it."""
    number = error.args[0] if error.args and isinstance(error.args[0], int) else None
    remedies = {
        2: "there is no such device; plug it in, or correct gnss.port",
        11: "is in use by another program (gpsd, ModemManager?); stop that one",
        13: "may not be opened; add the user to the group dialout",
        16: "is in use by another program (gpsd, ModemManager?); stop that one",
        25: "is not a serial port; correct gnss.port",
    }
    if number in remedies:
        return f"{path} {remedies[number]}" if number != 2 else f"{path}: {remedies[number]}"
    return f"{path}: the device does not answer ({error})"
