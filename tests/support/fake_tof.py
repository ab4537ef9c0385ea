"""VL53L0X and VL53L1X as their data sheets and ST's published drivers describe them."""

from collections.abc import Callable

import msgspec

from hal.clock import Clock
from tests.support.fake_i2c import RegisterChip

_WRAP_MM = {"vl53l0x": 2500, "vl53l1x": 1900}


class Target(msgspec.Struct, frozen=True):
    """What is in front of the sensor. `signal_at_1m_mcps` falls with the square of the range."""

    range_m: float = 0.5
    signal_at_1m_mcps: float = 4.0
    ambient_mcps: float = 0.05
    code: int | None = None
    """A range status instead of the one that follows."""
    range_mm: int | None = None
    """A range code instead of the one that follows."""
    sigma_mm: float = 2.0

    def signal_mcps(self) -> float:
        return min(self.signal_at_1m_mcps / max(self.range_m, 0.05) ** 2, 400.0)


View = Callable[[float], Target]


def still(range_m: float = 0.5, **knobs: float) -> View:
    target = msgspec.structs.replace(Target(range_m), **knobs)
    return lambda _now_s: target


class FakeTof(RegisterChip):
    """What both chips share: measuring over and over on the clock."""

    def __init__(self, clock: Clock, view: View) -> None:
        self.view = view
        self.frozen = False
        """Answers, and measures no more."""
        self.measured = 0
        self._next_s: float | None = None
        super().__init__(clock)

    def period_s(self) -> float:
        raise NotImplementedError

    def latch(self, target: Target) -> None:
        raise NotImplementedError

    def run(self) -> None:
        """Finish what is finished by now."""
        if self.frozen:
            self._next_s = None
        while self._next_s is not None and self._next_s <= self.clock.now_s():
            self.measured += 1
            self.latch(self.view(self._next_s - self.period_s() / 2.0))
            self._next_s += self.period_s()

    def written(self, data: bytes) -> None:
        self.run()
        super().written(data)

    def read(self, count: int) -> bytes:
        self.run()
        return super().read(count)


class FakeVl53l0x(FakeTof):
    """Pages by register FF; private registers behind 80; results in 13 to 1F."""

    STOP_VARIABLE = 0x3C
    SPADS_TOLD = 0x80 | 5
    GOOD_SPADS = bytes((0xFF, 0xEF, 0x7B, 0xFF, 0xFF, 0x0F))

    def __init__(self, clock: Clock, view: View, model: int = 0xEEAA) -> None:
        self.model = model
        self.memory_fails = False
        self.pages: dict[int, bytearray] = {}
        super().__init__(clock, view)

    def reset(self) -> None:
        self.pages = {page: bytearray(256) for page in (0, 1, 6, 7)}
        self.page = 0
        zero = self.pages[0]
        zero[0x01], zero[0x44], zero[0x45] = 0xFF, 0x00, 0x20
        zero[0xC0], zero[0xC1], zero[0xC2] = self.model >> 8, self.model & 0xFF, 0x10
        zero[0xB0:0xB6] = self.GOOD_SPADS
        self.pages[1][0x91] = self.STOP_VARIABLE
        self.held = False
        self._next_s = None
        self._strobe_s: float | None = None
        self._single_s: float | None = None
        self.calibrated: set[int] = set()

    def store(self, index: int, value: int) -> None:
        if index == 0xFF:
            self.page = value
            return
        page = self.pages[self.page]
        page[index] = value
        if self.page == 7 and index == 0x83 and value == 0 and page[0x94] == 0x6B:
            self._strobe_s = self.clock.now_s() + 0.003
        if self.page == 0:
            self._command(index, value)

    def _command(self, index: int, value: int) -> None:
        zero = self.pages[0]
        if index == 0xBF:
            if value == 0:
                zero[0xC0] = 0
            else:
                self.restart()
        elif index == 0x8A:
            self.address = value & 0x7F
        elif index == 0x0B and value & 1:
            zero[0x13] &= ~0x07
        elif index == 0x00 and zero[0x80] == 0:
            self._start(value)

    def _start(self, value: int) -> None:
        now_s = self.clock.now_s()
        self._next_s = None
        if value & 0x02:
            if self.pages[1][0x91] == self.STOP_VARIABLE:
                self._next_s = now_s + self.period_s()
        elif value & 0x01:
            self._single_s = now_s + 0.005
            self.calibrated.add(self.pages[0][0x01])

    def run(self) -> None:
        super().run()
        now_s = self.clock.now_s()
        if self._single_s is not None and self._single_s <= now_s:
            self._single_s = None
            self.pages[0][0x13] |= 0x04
        if self._strobe_s is not None and self._strobe_s <= now_s and not self.memory_fails:
            self._strobe_s = None
            self.pages[7][0x83], self.pages[7][0x92] = 0x10, self.SPADS_TOLD

    def load(self, index: int) -> int:
        private = self.page == 1 and index == 0x91 and self.pages[0][0x80] == 0
        return 0 if private else self.pages[self.page][index & 0xFF]

    def period_s(self) -> float:
        """From its own registers, in integer nanoseconds as the firmware counts."""
        zero = self.pages[0]

        def macro_ns(clocks: int) -> int:
            return (2304 * clocks * 1655 + 500) // 1000

        def decoded(at: int) -> int:
            return (zero[at + 1] << zero[at]) + 1

        pre_ns, final_ns = macro_ns(2 * (zero[0x50] + 1)), macro_ns(2 * (zero[0x70] + 1))
        pre, final = decoded(0x51), decoded(0x71)
        steps_ns = 2 * ((zero[0x46] + 1) * pre_ns + 690_000) + pre * pre_ns + 660_000
        steps_ns += (final - pre) * final_ns + 550_000
        return (1_320_000 + 960_000 + steps_ns) * 1e-9

    def spads_on(self) -> int:
        return sum(byte.bit_count() for byte in self.pages[0][0xB0:0xB6])

    def latch(self, target: Target) -> None:
        zero = self.pages[0]
        limit_mcps = int.from_bytes(zero[0x44:0x46], "big") / 128
        signal = target.signal_mcps()
        range_mm = round(target.range_m * 1e3)
        code = 11
        if self.spads_on() != self.SPADS_TOLD & 0x7F or not {1, 2} <= self.calibrated:
            code = 3  # no reference
        elif signal < limit_mcps:
            code, range_mm = 4, 8190
        elif range_mm > _WRAP_MM["vl53l0x"]:
            code, range_mm = 9, range_mm - _WRAP_MM["vl53l0x"]
        code = code if target.code is None else target.code
        range_mm = range_mm if target.range_mm is None else target.range_mm
        block = bytearray(12)
        block[0] = code << 3 | 0x01
        block[2:4] = (16 * 256).to_bytes(2, "big")
        block[6:8] = round(signal * 128).to_bytes(2, "big")
        block[8:10] = round(target.ambient_mcps * 128).to_bytes(2, "big")
        block[10:12] = range_mm.to_bytes(2, "big")
        zero[0x14:0x20] = block
        if zero[0x0A] == 0x04:
            zero[0x13] |= 0x04


class FakeVl53l1x(FakeTof):
    """Two-byte index; the measurement's period is a multiple of the oscillator's."""

    index_bytes = 2
    OSCILLATOR = 0x2BC

    def __init__(self, clock: Clock, view: View, model: int = 0xEACC) -> None:
        self.model = model
        self.cells = bytearray(0x200)
        super().__init__(clock, view)

    def reset(self) -> None:
        self.cells = bytearray(0x200)
        cells = self.cells
        cells[0x10F], cells[0x110], cells[0x111] = self.model >> 8, self.model & 0xFF, 0x10
        cells[0xDE:0xE0] = self.OSCILLATOR.to_bytes(2, "big")
        cells[0xE5] = 0x03
        cells[0x30], cells[0x31] = 0x11, 0x02
        self._next_s = None
        self._first = True
        self.vhv_done = False
        self._show(ready=False)

    def store(self, index: int, value: int) -> None:
        if index == 0x0000:
            if value & 1:
                self.restart()
            else:
                self.cells[0xE5] = 0
            return
        if index == 0x0001:
            self.address = value & 0x7F
        self.cells[index] = value
        if (index == 0x86 and value & 1) or index == 0x30:
            self._show(ready=False)
        elif index == 0x87:
            self._first = True
            self._next_s = self.clock.now_s() + self.period_s() if value & 0x40 else None

    def load(self, index: int) -> int:
        return self.cells[index]

    def _show(self, *, ready: bool) -> None:
        active_high = self.cells[0x30] & 0x10 == 0
        self.cells[0x31] = self.cells[0x31] & ~1 | int(ready == active_high)

    def budget_ms(self) -> int:
        short = {0x1D: 15, 0x51: 20, 0xD6: 33, 0x1AE: 50, 0x2E1: 100, 0x3E1: 200, 0x591: 500}
        long = {0x1E: 20, 0x60: 33, 0xAD: 50, 0x1CC: 100, 0x2D9: 200, 0x48F: 500}
        timeout = int.from_bytes(self.cells[0x5E:0x60], "big")
        return (short if self.cells[0x4B] == 0x14 else long)[timeout]

    def period_s(self) -> float:
        """The pause that was asked for, or the next multiple that the budget leaves room for."""
        between_ms = int.from_bytes(self.cells[0x6C:0x70], "big") / self.OSCILLATOR / 1.065
        budget_ms = self.budget_ms()
        return 1e-3 * (between_ms if between_ms > budget_ms else budget_ms * 2 - 1)

    def latch(self, target: Target) -> None:
        cells = self.cells
        width, height = (cells[0x80] & 0x0F) + 1, (cells[0x80] >> 4) + 1
        spads = width * height
        signal = target.signal_mcps() * spads / 256
        range_mm = round(target.range_m * 1e3)
        code = 19 if self._first else 9
        if signal < int.from_bytes(cells[0x66:0x68], "big") / 128:
            code = 4
        elif range_mm > _WRAP_MM["vl53l1x"] and cells[0x4B] == 0x14:
            code, range_mm = 7, range_mm - _WRAP_MM["vl53l1x"]
        self._first = False
        code = code if target.code is None else target.code
        range_mm = range_mm if target.range_mm is None else target.range_mm
        count = cells[0x8B]
        block = bytearray(17)
        block[0] = code | 0x40  # the upper bits mean other things
        block[2] = 0x80 if count == 0xFF else count + 1
        block[3:5] = (spads * 64).to_bytes(2, "big")
        block[7:9] = round(target.ambient_mcps * 128).to_bytes(2, "big")
        block[9:11] = round(target.sigma_mm * 4).to_bytes(2, "big")
        block[13:15] = range_mm.to_bytes(2, "big")
        block[15:17] = round(signal * 128).to_bytes(2, "big")
        cells[0x89:0x9A] = block
        self._show(ready=True)
