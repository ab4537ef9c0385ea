"""TCA9548A and relatives: eight channels behind one address, any of them switched through.

The chip has one register, written without an index: bit n connects channel n; 0 after power-up and
reset (data sheet SCPS207, section 8.6).
"""

from hal.ranging.i2c_bus import BusHeld, I2cBus, I2cError, NotAcknowledged
from hal.ranging.quarantine import Segment

_TRIES = 3
"""A multiplexer that refuses so often in a row has no power; once may be noise."""


class Switches:
    """All multiplexers of one bus. Only one channel of all of them is connected at a time, since
    the same sensor address answers behind each.

    One that does not acknowledge has no power and connects nothing: the others go on without it.
    """

    def __init__(self, bus: I2cBus, addresses: frozenset[int]) -> None:
        self._bus = bus
        self._registers: dict[int, int | None] = dict.fromkeys(addresses)
        self._absent: set[int] = set()
        self._connected: Segment | None = None
        self._low = False
        self.culprit: Segment | None = None
        """The channel that was connected when the bus was last found held low; None where none
        was, and after a reset."""

    def forget(self) -> None:
        """The chips may have been reset: write their registers before the next use."""
        self._registers = dict.fromkeys(self._registers)

    def were_reset(self) -> None:
        """By their line: nothing is connected."""
        self.forget()
        self._connected = self.culprit = None
        self._low = False

    def connect(self, address: int, channel: int) -> None:
        """Only this channel of this multiplexer; raises I2cError."""
        try:
            if self._registers[address] != 1 << channel:
                self._disconnect_all_but(address)
                self._set(address, 1 << channel)
                self._absent.discard(address)
        except I2cError as error:
            self.failed(error)
            raise
        self._connected = (address, channel)

    def failed(self, error: I2cError) -> None:
        """After a transfer that was refused: a multiplexer that lost its power lost its channel,
        too, and a bus that is low from here on is held by what is connected.
        """
        if isinstance(error, BusHeld):
            if not self._low:
                self.culprit = self._connected
            self._low = True
        self.forget()

    def succeeded(self) -> None:
        """After a transfer behind a channel: the bus is not held."""
        self._low = False

    def _disconnect_all_but(self, address: int) -> None:
        """One that is absent is asked each time: it may be back, with whatever in its register."""
        for other, register in self._registers.items():
            if other == address or (register == 0 and other not in self._absent):
                continue
            for _ in range(1 if other in self._absent else _TRIES):
                try:
                    self._set(other, 0)
                except NotAcknowledged:
                    continue
                self._absent.discard(other)
                break
            else:
                self._absent.add(other)

    def _set(self, address: int, mask: int) -> None:
        self._bus.write(address, bytes((mask,)))
        self._registers[address] = mask
        self._low = False


class Channel:
    """`I2cBus` behind one channel."""

    def __init__(self, bus: I2cBus, switches: Switches, address: int, channel: int) -> None:
        self._bus = bus
        self._switches = switches
        self._address, self._channel = address, channel

    def write(self, address: int, data: bytes) -> None:
        """One write transfer; raises I2cError."""
        self._switches.connect(self._address, self._channel)
        try:
            self._bus.write(address, data)
        except I2cError as error:
            self._switches.failed(error)
            raise
        self._switches.succeeded()

    def write_read(self, address: int, data: bytes, count: int) -> bytes:
        """Write, repeated start, read `count` bytes; raises I2cError."""
        self._switches.connect(self._address, self._channel)
        try:
            answer = self._bus.write_read(address, data, count)
        except I2cError as error:
            self._switches.failed(error)
            raise
        self._switches.succeeded()
        return answer

    def reopen(self) -> None:
        """Let the adapter begin anew; raises ConnectionFailed."""
        self._switches.forget()
        self._bus.reopen()

    def close(self) -> None:
        """Let go of the adapter. May be called twice."""
        self._bus.close()
