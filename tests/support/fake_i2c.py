"""An I2C bus without wires: addresses, acknowledgement, wired-and, multiplexers, faults."""

from collections.abc import Callable
from typing import Protocol

from hal.clock import Clock
from hal.ranging.i2c_bus import BusHeld, I2cError, NotAcknowledged

BOOT_S = 0.0012


class Device(Protocol):
    """What sits on the bus."""

    def answers(self, address: int) -> bool: ...

    def written(self, data: bytes) -> None: ...

    def read(self, count: int) -> bytes: ...


class FakeBus:
    """`hal.ranging.i2c_bus.I2cBus` with knobs for what goes wrong."""

    def __init__(self) -> None:
        self.devices: list[Device] = []
        self.holder: Callable[[], bool] | None = None
        """While it returns True, the data line is held low."""
        self.nacks: dict[int, int] = {}
        """Address: how many of the next transfers nobody acknowledges."""
        self.breaks_after: int | None = None
        """After that many more transfers every one fails."""
        self.dead = False
        """Nobody acknowledges anything."""
        self.crowd = 0
        """The most devices that ever answered to one transfer."""
        self.transfers = 0
        self.reopened = 0
        self.closed = False

    def write(self, address: int, data: bytes) -> None:
        for device in self._addressed(address):
            device.written(data)

    def write_read(self, address: int, data: bytes, count: int) -> bytes:
        answering = self._addressed(address)
        answers = []
        for device in answering:
            device.written(data)
            answers.append(device.read(count))
        both = bytearray(b"\xff" * count)
        for answer in answers:
            both = bytearray(a & b for a, b in zip(both, answer, strict=True))
        return bytes(both)

    def reopen(self) -> None:
        self.reopened += 1

    def close(self) -> None:
        self.closed = True

    def _addressed(self, address: int) -> list[Device]:
        self.transfers += 1
        if self.closed:
            raise I2cError("the bus was closed")
        if self.holder is not None and self.holder():
            raise BusHeld("the data line is held low")
        if self.breaks_after is not None:
            self.breaks_after -= 1
            if self.breaks_after < 0:
                raise NotAcknowledged("broken off")
        if self.dead:
            raise NotAcknowledged("nobody answers any more")
        if self.nacks.get(address, 0) > 0:
            self.nacks[address] -= 1
            raise NotAcknowledged(f"told not to answer at {address:#04x}")
        answering = [device for device in self.visible() if device.answers(address)]
        if not answering:
            raise NotAcknowledged(f"nobody at {address:#04x}")
        self.crowd = max(self.crowd, len(answering))
        return answering

    def visible(self) -> list[Device]:
        seen = list(self.devices)
        for device in self.devices:
            if isinstance(device, FakeMux):
                seen += device.connected()
        return seen


class FakeMux:
    """TCA9548A: one register without an index."""

    def __init__(self, address: int = 0x70) -> None:
        self._address = address
        self.channels: dict[int, list[Device]] = {number: [] for number in range(8)}
        self.mask = 0
        self.powered = True
        self.most_connected = 0

    def answers(self, address: int) -> bool:
        return self.powered and address == self._address

    def written(self, data: bytes) -> None:
        if data:
            self.mask = data[-1]
            self.most_connected = max(self.most_connected, self.mask.bit_count())

    def read(self, count: int) -> bytes:
        return bytes([self.mask] * count)

    def connected(self) -> list[Device]:
        return [
            d for number, all_ in self.channels.items() if self.mask >> number & 1 for d in all_
        ]

    def brown_out(self) -> None:
        self.mask = 0


class FakeLine:
    """An output line that does something."""

    def __init__(self, act: Callable[[bool], None]) -> None:
        self._act = act
        self.high = False
        self.released = 0
        act(False)

    def set(self, *, high: bool) -> None:
        self.high = high
        self._act(high)

    def release(self) -> None:
        self.released += 1


class RegisterChip:
    """A chip with an index register that counts up, a supply, and a line that holds it in reset."""

    index_bytes = 1
    power_up_address = 0x29

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.address = self.power_up_address
        self.index = 0
        self.powered = True
        self.enabled = True
        self.resets = 0
        self._ready_from_s = clock.now_s() + BOOT_S
        self.reset()

    def reset(self) -> None:
        """Everything as after power-up."""
        raise NotImplementedError

    def restart(self) -> None:
        """What a dip of the supply, XSHUT or the soft reset do."""
        self.resets += 1
        self.address = self.power_up_address
        self._ready_from_s = self.clock.now_s() + BOOT_S
        self.reset()

    def xshut(self, high: bool) -> None:
        if high and not self.enabled:
            self.restart()
        self.enabled = high

    def answers(self, address: int) -> bool:
        booted = self.clock.now_s() >= self._ready_from_s
        return self.powered and self.enabled and booted and address == self.address

    def written(self, data: bytes) -> None:
        self.index = int.from_bytes(data[: self.index_bytes], "big")
        for value in data[self.index_bytes :]:
            self.store(self.index, value)
            self.index += 1

    def read(self, count: int) -> bytes:
        values = bytes(self.load(self.index + offset) for offset in range(count))
        self.index += count
        return values

    def store(self, index: int, value: int) -> None:
        raise NotImplementedError

    def load(self, index: int) -> int:
        raise NotImplementedError
