"""ADS1115: four inputs, 16 bits, one conversion at a time (data sheet SBAS444)."""

from collections.abc import Callable

from hal.ranging.i2c_bus import I2cBus, Registers
from hal.ranging.ranger import ChipReset, ChipSilent

_CONVERSION, _CONFIG = 0x00, 0x01
_START = 0x8000  # written: begin; read: idle
_SINGLE_ENDED = 0x4000  # input against ground, its number in bits 13..12
_GAIN_4_096_V = 0x0200
_SINGLE_SHOT = 0x0100
_RATE_860_HZ = 0x00E0
_COMPARATOR_OFF = 0x0003

VOLTS_PER_STEP = 4.096 / 0x8000
FULL_SCALE = 0x7FFF
CONVERSION_S = 1.0 / 860.0
_SLOW_CLOCK = 1.1  # the rate is good to 10 %
_TRIES = 5


class Ads1115:
    """One converter, shared by the sensors on its inputs."""

    def __init__(self, bus: I2cBus, address: int, pause: Callable[[float], None]) -> None:
        self._registers = Registers(bus, address, 1)
        self._pause = pause

    def steps(self, number: int) -> int:
        """One conversion of input `number`, in steps of `VOLTS_PER_STEP`; takes 1.3 ms.

        Raises I2cError; ChipReset when the chip forgot in the meantime what it was to convert.
        """
        asked = (
            _SINGLE_ENDED
            | number << 12
            | _GAIN_4_096_V
            | _SINGLE_SHOT
            | _RATE_860_HZ
            | _COMPARATOR_OFF
        )
        r = self._registers
        r.write_number(_CONFIG, _START | asked, 2)
        self._pause(CONVERSION_S * _SLOW_CLOCK)
        for _ in range(_TRIES):
            state = r.read_number(_CONFIG, 2)
            if state & ~_START != asked:
                raise ChipReset("the ADS1115 lost its settings: its supply was interrupted")
            if state & _START:
                steps = r.read_number(_CONVERSION, 2)
                return steps - 0x10000 if steps & 0x8000 else steps
            self._pause(CONVERSION_S * 0.2)
        raise ChipSilent("the ADS1115 does not finish its conversions")

    def identify(self) -> None:
        """Raises I2cError when nobody answers; the chip has no number to know it by."""
        self._registers.read_number(_CONFIG, 2)
