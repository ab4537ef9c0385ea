"""TCA9548A and relatives: eight channels behind one address, any of them switched through.

The chip has one register, written without an index: bit n connects channel n; 0 after power-up and
reset (data sheet SCPS207, section 8.6).
"""

from hal.ranging.i2c_bus import I2cBus, I2cError


class Switches:
    """All multiplexers of one bus. Only one channel of all of them is connected at a time, since
    the same sensor address answers behind each.
    """

    def __init__(self, bus: I2cBus, addresses: frozenset[int]) -> None:
        self._bus = bus
        self._connected: dict[int, int | None] = dict.fromkeys(addresses)

    def forget(self) -> None:
        """The chips may have been reset: write their registers before the next use."""
        self._connected = dict.fromkeys(self._connected)

    def connect(self, address: int, channel: int) -> None:
        """Only this channel of this multiplexer; raises I2cError."""
        try:
            for other, mask in self._connected.items():
                if other != address and mask != 0:
                    self._set(other, 0)
            if self._connected[address] != 1 << channel:
                self._set(address, 1 << channel)
        except I2cError:
            self.forget()
            raise

    def _set(self, address: int, mask: int) -> None:
        self._bus.write(address, bytes((mask,)))
        self._connected[address] = mask


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
        except I2cError:
            self._switches.forget()  # a multiplexer that lost its power lost its channel too
            raise

    def write_read(self, address: int, data: bytes, count: int) -> bytes:
        """Write, repeated start, read `count` bytes; raises I2cError."""
        self._switches.connect(self._address, self._channel)
        try:
            return self._bus.write_read(address, data, count)
        except I2cError:
            self._switches.forget()
            raise

    def reopen(self) -> None:
        """Let the adapter begin anew; raises ConnectionFailed."""
        self._switches.forget()
        self._bus.reopen()

    def close(self) -> None:
        """Let go of the adapter. May be called twice."""
        self._bus.close()
