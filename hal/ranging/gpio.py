"""Output lines for XSHUT and reset: the one door to gpiod, and the old files under /sys."""

import time
from pathlib import Path
from typing import Protocol

from hal.errors import ConnectionFailed

_EXPORT_TRIES, _EXPORT_WAIT_S = 50, 0.01


class OutputLine(Protocol):
    """One GPIO line that this program drives."""

    def set(self, *, high: bool) -> None:
        """Drive the line; raises OSError when the chip went away."""
        ...

    def release(self) -> None:
        """Let go of the line. May be called twice."""
        ...


def output_line(name: str) -> OutputLine:
    """The line that `name` means (hal.config.GpioName), driven low.

    Raises ConnectionFailed with what to do.
    """
    chip, number = name.split("/")
    return SysfsLine(int(number)) if chip == "sysfs" else ChipLine(f"/dev/{chip}", int(number))


class ChipLine:
    """A line of /dev/gpiochipN."""

    def __init__(self, chip: str, number: int) -> None:
        """Raises ConnectionFailed."""
        try:
            import gpiod
            from gpiod.line import Direction, Value
        except ModuleNotFoundError:
            raise ConnectionFailed(
                "gpiod is not installed; xshut lines need: pip install 'autonomy[hardware]'"
            ) from None
        self._number = number
        self._values = {True: Value.ACTIVE, False: Value.INACTIVE}
        settings = gpiod.LineSettings(direction=Direction.OUTPUT, output_value=Value.INACTIVE)
        try:
            self._request = gpiod.request_lines(
                chip, consumer="autonomy", config={number: settings}
            )
        except (OSError, ValueError) as error:
            raise ConnectionFailed(
                f"line {number} of {chip} cannot be driven ({error}); check the number with "
                "gpioinfo, and that this user is in the group gpio"
            ) from None
        self._released = False

    def set(self, *, high: bool) -> None:
        """Drive the line."""
        self._request.set_value(self._number, self._values[high])

    def release(self) -> None:
        """Let go of the line. May be called twice."""
        if not self._released:
            self._released = True
            self._request.release()


class SysfsLine:
    """A line under /sys/class/gpio, for kernels whose chip device this user may not open."""

    def __init__(self, number: int, root: Path = Path("/sys/class/gpio")) -> None:
        """Raises ConnectionFailed."""
        self._line = root / f"gpio{number}"
        try:
            if not self._line.exists():
                (root / "export").write_text(str(number))
            self._direct()
        except OSError as error:
            raise ConnectionFailed(
                f"GPIO {number} cannot be driven through {root} ({error.strerror}); check the "
                "number, and that this user is in the group gpio"
            ) from None

    def _direct(self) -> None:
        """Output, low. udev gives the fresh files to the group a moment after the export."""
        for left in reversed(range(_EXPORT_TRIES)):
            try:
                (self._line / "direction").write_text("low")
            except (PermissionError, FileNotFoundError):
                if left == 0:
                    raise
                time.sleep(_EXPORT_WAIT_S)
            else:
                return

    def set(self, *, high: bool) -> None:
        """Drive the line."""
        (self._line / "value").write_text("1" if high else "0")

    def release(self) -> None:
        """The line stays as it is driven: /sys has no owner to let go."""
