"""VL53L0X, time of flight to 1.2 m (2 m on white), 25 degrees wide.

Sources: data sheet DocID029104 (identification, boot time, addressing, ranging profiles), user
manual UM2039 (range status), and the register and tuning values that ST publishes with its API
STSW-IMG005; the chip has no public register map.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager

from hal.config import TOF_ADDRESS, Vl53l0xConfig
from hal.ranging.i2c_bus import I2cBus, Registers
from hal.ranging.ranger import (
    RESIDUAL_M,
    SPEED_OF_LIGHT_M_S,
    ChipReset,
    Measured,
    WrongChip,
    no_return,
    until,
)
from hal.readings import RangeStatus

MODEL = (0xEE, 0xAA)
NO_TARGET_MM = 8190
"""8190 and 8191 are codes for "no distance", never distances."""

_START, _SEQUENCE, _INTERRUPT_ON, _CLEAR = 0x00, 0x01, 0x0A, 0x0B
_INTERRUPT_STATUS = 0x13  # followed by the results, 0x14 to 0x1F
_SIGNAL_LIMIT, _MSRC_CONTROL, _FINAL_TIMEOUT = 0x44, 0x60, 0x71
_POLARITY, _ADDRESS, _PADS, _SOFT_RESET, _MODEL_ID = 0x84, 0x8A, 0x89, 0xBF, 0xC0
_STOP_VARIABLE, _SPADS, _SPAD_MAP, _PAGE = 0x91, 0x92, 0xB0, 0xFF
_STEPS = 0xE8  # dynamic SPAD selection, pre-range, final range
_BOOT_S = 0.002  # 1.2 ms at most
_REFERENCE_SPADS, _FIRST_APERTURE_SPAD = 48, 12

# ST's default tuning: (register, value) in order; register FF selects the page.
_TUNING = bytes.fromhex(
    "ff01 0000 ff00 0900 1000 1100 2401 25ff 7500 ff01 4e2c 4800 3020 ff00 3009 5400 3104 3203"
    "4083 4625 6000 2700 5006 5100 5296 5608 5730 6100 6200 6400 6500 66a0 ff01 2232 4714 49ff"
    "4a00 ff00 7a0a 7b00 7821 ff01 2334 4200 44ff 4526 4605 4040 0e06 201a 4340 ff00 3403 3544"
    "ff01 3104 4b09 4c05 4d04 ff00 4400 4520 4708 4828 6700 7004 7101 72fe 7600 7700 ff01 0d01"
    "ff00 8001 01f8 ff01 8e01 0001 ff00 8000"
)
# What the tuning above sets, and the timing that follows (macro period: 2304 clocks of 1.655 ns
# for each clock of the laser's period; overheads from ST's API).
_MACRO_S = 2304 * 1.655e-9
_PRE_PERIOD, _PRE_MACROS, _MSRC_MACROS = 14, 0x96 + 1, 0x25 + 1
_FINAL_PERIOD = 10
_FIXED_S = 1320e-6 + 960e-6 + 2 * 690e-6 + 660e-6 + 550e-6
# ST's noise model: effective pulse and ambient widths, laser on for 3 of its period's clocks.
_PULSE_S, _AMBIENT_S = 8e-9, 6e-9
_LASER_CLOCKS = 3

_HARDWARE = (1, 2, 3)  # laser continuity, laser watchdog, no reference voltage
_COMPLETE = 11
STATUS = {
    4: None,  # no target: signal below the limit
    5: RangeStatus.NO_SIGNAL,  # signal to noise
    6: RangeStatus.SUSPECT,  # phase out of bounds: may be wrapped
    7: RangeStatus.SUSPECT,  # sigma
    8: RangeStatus.TOO_NEAR,  # saturated
    9: RangeStatus.SUSPECT,  # phases contradict each other: wrapped
    10: RangeStatus.TOO_NEAR,  # below the minimum
    _COMPLETE: RangeStatus.VALID,
}
"""Meaning of bits 6..3 of the status; None: see `no_return`; what is not listed is NO_SIGNAL."""


def final_macros(budget_s: float) -> int:
    """Macro periods of the final range (pre-range included) that fill the timing budget."""
    used_s = _FIXED_S + (2 * _MSRC_MACROS + _PRE_MACROS) * _PRE_PERIOD * _MACRO_S
    return round((budget_s - used_s) / (_FINAL_PERIOD * _MACRO_S)) + _PRE_MACROS


def encoded_timeout(macros: int) -> int:
    """(mantissa * 2 ** exponent) + 1, the exponent in the high byte."""
    mantissa, exponent = macros - 1, 0
    while mantissa > 0xFF:
        mantissa >>= 1
        exponent += 1
    return exponent << 8 | mantissa


def sigma_m(signal_mcps: float, ambient_mcps: float, macros: int) -> float:
    """One sigma of a range from the photons that it was made of; infinite without any.

    A square pulse of effective width w located by n photons: c / 2 * w / sqrt(12 n), widened by
    the ambient light (ST's published estimator without crosstalk compensation).
    """
    photons = signal_mcps * 1e6 * _LASER_CLOCKS * 2048 * 1.655e-9 * macros
    if photons < 1.0:
        return math.inf
    width_s = math.hypot(_PULSE_S, _AMBIENT_S * ambient_mcps / signal_mcps)
    return SPEED_OF_LIGHT_M_S / 2.0 * width_s / math.sqrt(12.0 * photons)


class Vl53l0x:
    """`Addressable` over I2C."""

    kind = "VL53L0X"
    min_m, max_m = 0.03, 2.0

    def __init__(self, bus: I2cBus, config: Vl53l0xConfig) -> None:
        self._bus = bus
        self._config = config
        self._registers = Registers(bus, config.address, 1)
        self._macros = final_macros(config.budget_s) + _PRE_MACROS
        self._stop_variable = 0
        self.period_s = config.budget_s

    def identify(self) -> None:
        """Raises WrongChip, or I2cError when nobody answers."""
        self._identify(self._registers)

    def give_address(self) -> None:
        """Tell the chip at the power-up address its own; raises I2cError, WrongChip."""
        fresh = Registers(self._bus, TOF_ADDRESS, 1)
        self._identify(fresh)
        fresh.write(_ADDRESS, self._config.address)

    def _identify(self, registers: Registers) -> None:
        model = tuple(registers.read_block(_MODEL_ID, 2))
        if model != MODEL:
            raise WrongChip(
                f"the chip at {registers.address:#04x} says {bytes(model).hex()}, a VL53L0X says "
                "eeaa; check `chip` of this beam and its wiring"
            )

    def begin(self) -> Iterator[float]:
        """Reset, tune, calibrate, range continuously. Raises I2cError, WrongChip."""
        r = self._registers
        if self._config.xshut is None:
            yield from self._woken()
            self.identify()
            yield from self._reset()
        self.identify()
        r.write(_PADS, r.read(_PADS) | 0x01)  # 2.8 V on the lines, as all breakout boards have
        r.write(0x88, 0x00)
        with self._private():
            self._stop_variable = r.read(_STOP_VARIABLE)
        r.write(_MSRC_CONTROL, r.read(_MSRC_CONTROL) | 0x12)
        r.write(_SEQUENCE, 0xFF)
        yield from self._choose_spads()
        for register, value in zip(_TUNING[::2], _TUNING[1::2], strict=True):
            r.write(register, value)
        r.write(_INTERRUPT_ON, 0x04)  # new sample ready
        r.write(_POLARITY, r.read(_POLARITY) & ~0x10)
        r.write(_CLEAR, 0x01)
        r.write_number(_SIGNAL_LIMIT, round(self._config.signal_min_mcps * 128), 2)
        r.write_number(_FINAL_TIMEOUT, encoded_timeout(final_macros(self._config.budget_s)), 2)
        yield from self._calibrate(0x01, 0x40)  # reference voltage
        yield from self._calibrate(0x02, 0x00)  # phase
        r.write(_SEQUENCE, _STEPS)
        with self._private():
            r.write(_STOP_VARIABLE, self._stop_variable)
        r.write(_START, 0x02)  # back to back

    def _woken(self) -> Iterator[float]:
        """Out of a start that was broken off: on another page, or held in reset.

        To a chip with two-byte indices, the likeliest mistake, these writes say nothing.
        """
        r = self._registers
        if tuple(r.read_block(_MODEL_ID, 2)) != MODEL:
            r.write(_PAGE, 0x00)
            r.write(_SOFT_RESET, 0x01)
            yield _BOOT_S

    def _reset(self) -> Iterator[float]:
        r = self._registers
        r.write(_SOFT_RESET, 0x00)
        yield _BOOT_S
        r.write(_SOFT_RESET, 0x01)
        yield _BOOT_S
        yield from until(lambda: r.read(_MODEL_ID) == MODEL[0], "the boot of the VL53L0X")

    @contextmanager
    def _private(self) -> Iterator[None]:
        r = self._registers
        r.write(0x80, 0x01)
        r.write(_PAGE, 0x01)
        r.write(0x00, 0x00)
        yield
        r.write(0x00, 0x01)
        r.write(_PAGE, 0x00)
        r.write(0x80, 0x00)

    def _choose_spads(self) -> Iterator[float]:
        """As many reference diodes as the factory found best, from those it found good."""
        r = self._registers
        r.write(0x80, 0x01)
        r.write(_PAGE, 0x01)
        r.write(0x00, 0x00)
        r.write(_PAGE, 0x06)
        r.write(0x83, r.read(0x83) | 0x04)
        r.write(_PAGE, 0x07)
        for register, value in ((0x81, 0x01), (0x80, 0x01), (0x94, 0x6B), (0x83, 0x00)):
            r.write(register, value)
        yield from until(lambda: r.read(0x83) != 0x00, "reading the VL53L0X's memory")
        r.write(0x83, 0x01)
        told = r.read(_SPADS)
        r.write(0x81, 0x00)
        r.write(_PAGE, 0x06)
        r.write(0x83, r.read(0x83) & ~0x04)
        r.write(_PAGE, 0x01)
        r.write(0x00, 0x01)
        r.write(_PAGE, 0x00)
        r.write(0x80, 0x00)
        good = r.read_block(_SPAD_MAP, _REFERENCE_SPADS // 8)
        r.write(_PAGE, 0x01)
        r.write(0x4F, 0x00)
        r.write(0x4E, 0x2C)
        r.write(_PAGE, 0x00)
        r.write(0xB6, 0xB4)
        r.write(_SPAD_MAP, *chosen_spads(good, told & 0x7F, aperture=bool(told & 0x80)))

    def _calibrate(self, step: int, extra: int) -> Iterator[float]:
        r = self._registers
        r.write(_SEQUENCE, step)
        r.write(_START, 0x01 | extra)
        yield from until(lambda: r.read(_INTERRUPT_STATUS) & 0x07 != 0, "the calibration")
        r.write(_CLEAR, 0x01)
        r.write(_START, 0x00)

    def poll(self) -> Measured | None:
        """The measurement that was finished since the last call, if any; raises I2cError."""
        block = self._registers.read_block(_INTERRUPT_STATUS, 13)
        if block[0] & 0x07 == 0:
            return None
        self._registers.write(_CLEAR, 0x01)
        return self._measured(block[1:])

    def _measured(self, block: bytes) -> Measured:
        """From the result registers: status, SPADs (8.8), signal, ambient (9.7 Mcps), range."""
        code = block[0] >> 3 & 0x0F
        spads, signal_mcps, ambient_mcps = (
            int.from_bytes(block[at : at + 2], "big") / scale
            for at, scale in ((2, 256), (6, 128), (8, 128))
        )
        range_mm = int.from_bytes(block[10:12], "big")
        status = STATUS.get(code, RangeStatus.NO_SIGNAL)
        noise_m = sigma_m(signal_mcps, ambient_mcps, self._macros)
        if status is RangeStatus.VALID and noise_m > self._config.sigma_max_m:
            status = RangeStatus.SUSPECT
        no_distance = range_mm >= NO_TARGET_MM
        if status is None or (no_distance and status in (RangeStatus.VALID, RangeStatus.SUSPECT)):
            status = no_return(
                1e3 * ambient_mcps / spads if spads else 0.0,
                self._config.ambient_max_kcps_per_spad,
            )
        return Measured(
            status=status,
            range_m=range_mm * 1e-3,
            variance_m2=min(noise_m, self.max_m) ** 2 + RESIDUAL_M**2,
            age_s=self._config.budget_s / 2.0,
            hardware_fault=code in _HARDWARE,
        )

    def check(self) -> None:
        """Raises ChipReset when the settings are lost, I2cError when it does not answer."""
        self.identify()
        if self._registers.read(_SEQUENCE) != _STEPS:
            raise ChipReset("the VL53L0X lost its settings: reset, or its supply was interrupted")

    def end(self) -> None:
        """Stop measuring; raises I2cError."""
        r = self._registers
        r.write(_START, 0x01)
        r.write(_PAGE, 0x01)
        r.write(0x00, 0x00)
        r.write(_STOP_VARIABLE, 0x00)
        r.write(0x00, 0x01)
        r.write(_PAGE, 0x00)


def chosen_spads(good: bytes, count: int, *, aperture: bool) -> bytes:
    """The first `count` diodes that are `good`; those with an aperture begin at number 12."""
    chosen = bytearray(len(good))
    left = count
    for number in range(_FIRST_APERTURE_SPAD if aperture else 0, len(good) * 8):
        bit = 1 << number % 8
        if left and good[number // 8] & bit:
            chosen[number // 8] |= bit
            left -= 1
    return bytes(chosen)
