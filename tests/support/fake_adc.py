"""ADS1115 after its data sheet, and a Sharp sensor on one of its inputs."""

from collections.abc import Callable

from hal.clock import Clock
from tests.support.fake_i2c import RegisterChip

Volts = Callable[[float], float]


class FakeAds1115(RegisterChip):
    """Single-shot conversions; registers are pairs of bytes."""

    power_up_address = 0x48
    _FULL_SCALE = (6.144, 4.096, 2.048, 1.024, 0.512, 0.256, 0.256, 0.256)
    _RATE_HZ = (8, 16, 32, 64, 128, 250, 475, 860)

    def __init__(self, clock: Clock, address: int = 0x48) -> None:
        self.inputs: dict[int, Volts] = {}
        self.conversions = 0
        super().__init__(clock)
        self.power_up_address = self.address = address
        self.stalled = False

    def reset(self) -> None:
        self.words = [0, 0x8583, 0x8000, 0x7FFF]
        self._done_s: float | None = None

    def written(self, data: bytes) -> None:
        self.index = data[0]
        if len(data) == 3:
            self.words[self.index] = int.from_bytes(data[1:], "big")
            if self.index == 1 and self.words[1] & 0x8000 and self.words[1] & 0x0100:
                rate_hz = self._RATE_HZ[self.words[1] >> 5 & 7]
                self._done_s = self.clock.now_s() + 1.0 / rate_hz + 25e-6
                self.words[1] &= ~0x8000

    def read(self, count: int) -> bytes:
        assert count == 2
        done = self._done_s is not None and self._done_s <= self.clock.now_s()
        if done and not self.stalled:
            self._done_s = None
            self.words[1] |= 0x8000
            self.words[0] = self._convert()
        return self.words[self.index].to_bytes(2, "big")

    def _convert(self) -> int:
        self.conversions += 1
        mux = self.words[1] >> 12 & 7
        assert mux >= 4, "measured against another input"
        source = self.inputs.get(mux - 4)
        volts = source(self.clock.now_s()) if source is not None else 0.0
        steps = round(volts / self._FULL_SCALE[self.words[1] >> 9 & 7] * 0x8000)
        return max(-0x8000, min(0x7FFF, steps)) & 0xFFFF


class FakeSharp:
    """GP2Y0A21-like: `top_m` is the range of the highest voltage, below which it falls again."""

    REFRESH_S = 0.0383

    def __init__(self, range_m: Callable[[float], float], top_m: float = 0.07) -> None:
        self.range_m = range_m
        self.top_m = top_m

    def volts(self, range_m: float) -> float:
        """0.25 / (range + 0.009) V beyond the top; straight down to a quarter of it at the lens."""
        if range_m >= self.top_m:
            return 0.25 / (range_m + 0.009)
        top_v = 0.25 / (self.top_m + 0.009)
        return top_v * (0.25 + 0.75 * range_m / self.top_m)

    def __call__(self, now_s: float) -> float:
        """The output: that of the last finished measurement."""
        finished = now_s // self.REFRESH_S * self.REFRESH_S
        return self.volts(self.range_m(finished - self.REFRESH_S / 2.0))
