"""VL53L1X, time of flight to 4 m, 27 degrees wide or narrower by a region of interest.

Sources: data sheet DocID031281 (identification, boot, distance modes), user manuals UM2356 and
UM2555 (range status, region of interest), and the register values that ST publishes with its
Ultra Lite Driver STSW-IMG009; the chip has no public register map.
"""

from collections.abc import Iterator

from hal.config import TOF_ADDRESS, Vl53l1xConfig
from hal.ranging.i2c_bus import I2cBus, Registers
from hal.ranging.ranger import (
    RESIDUAL_M,
    ChipReset,
    ChipSilent,
    Measured,
    WrongChip,
    no_return,
    until,
)
from hal.readings import RangeStatus

MODEL = (0xEA, 0xCC)
NO_TARGET_MM = 8190

_SOFT_RESET, _ADDRESS, _VHV_LOOPS, _VHV_START = 0x0000, 0x0001, 0x0008, 0x000B
_SETTINGS, _READY = 0x002D, 0x0031
_PHASE_TIMEOUT, _TIMEOUT_A, _PERIOD_A, _TIMEOUT_B, _PERIOD_B = 0x4B, 0x5E, 0x60, 0x61, 0x63
_PHASE_HIGH, _BETWEEN, _WINDOW, _FIRST_PHASE = 0x69, 0x6C, 0x78, 0x7A
_ROI_CENTRE, _ROI_SIZE, _CLEAR, _START = 0x7F, 0x80, 0x86, 0x87
_RESULTS, _OSCILLATOR, _BOOTED, _MODEL_ID = 0x89, 0xDE, 0xE5, 0x010F
_RANGING = 0x40
_BOOT_S = 0.002  # 1.2 ms at most
_OVERHEAD_MS = 4
"""The period must exceed the budget, or every second measurement is left out."""
_OSCILLATOR_SCALE = 1.075

# ST's default settings, registers 2D to 87; 2E and 2F say 2.8 V, as all breakout boards have.
_DEFAULTS = bytes.fromhex(
    "0001 01"  # 2d
    "0102 0002 0800 0810 0101 0000 0000 ff00"  # 30
    "0f00 0000 0000 200b 0000 020a 2100 0005"  # 40
    "0000 0000 c800 0038 ff01 0008 0000 01cc"  # 50
    "0f01 f10d 0168 0080 08b8 0000 0000 0f89"  # 60
    "0000 0000 0000 0001 0f0d 0e0e 0000 02c7"  # 70
    "ff9b 0000 0001 0000"  # 80
)
_MODES = {
    # phase timeout, laser periods A and B, phase limit, window, first phase
    "short": (0x14, 0x07, 0x05, 0x38, 0x0705, 0x0606),
    "long": (0x0A, 0x0F, 0x0D, 0xB8, 0x0F0D, 0x0E0E),
}
TIMEOUTS = {
    # budget in ms: timeouts A and B
    "short": {
        15: (0x001D, 0x0027),
        20: (0x0051, 0x006E),
        33: (0x00D6, 0x006E),
        50: (0x01AE, 0x01E8),
        100: (0x02E1, 0x0388),
        200: (0x03E1, 0x0496),
        500: (0x0591, 0x05C1),
    },
    "long": {
        20: (0x001E, 0x0022),
        33: (0x0060, 0x006E),
        50: (0x00AD, 0x00C6),
        100: (0x01CC, 0x01EA),
        200: (0x02D9, 0x02F8),
        500: (0x048F, 0x04A4),
    },
}
_REACH_M = {"short": 1.3, "long": 4.0}

STATUS = {
    3: RangeStatus.NO_SIGNAL,  # laser or hardware
    4: None,  # signal below the limit
    5: RangeStatus.SUSPECT,  # phase out of bounds
    6: RangeStatus.SUSPECT,  # sigma above the limit
    7: RangeStatus.SUSPECT,  # wrapped: the target is farther than it seems
    8: RangeStatus.TOO_NEAR,  # clipped at the minimum
    9: RangeStatus.VALID,
    12: RangeStatus.NO_SIGNAL,  # crosstalk of the cover
    13: RangeStatus.TOO_NEAR,  # below the minimum
    18: RangeStatus.NO_SIGNAL,  # first interrupt after the start
    19: RangeStatus.SUSPECT,  # first range: nobody checked whether it wrapped
    22: RangeStatus.SUSPECT,  # two targets merged: the nearer one is nearer than this
    23: RangeStatus.NO_SIGNAL,  # something is there, too dark to tell where
}
"""Meaning of bits 4..0 of the status; None: see `no_return`; what is not listed is NO_SIGNAL."""
_HARDWARE = 3


class Vl53l1x:
    """`Addressable` over I2C."""

    kind = "VL53L1X"
    min_m = 0.04

    def __init__(self, bus: I2cBus, config: Vl53l1xConfig) -> None:
        self._bus = bus
        self._config = config
        self._registers = Registers(bus, config.address, 2)
        self._count: int | None = None
        self.max_m = _REACH_M[config.mode]
        self.period_s = (config.budget_ms + _OVERHEAD_MS) * 1e-3

    def identify(self) -> None:
        """Raises WrongChip, or I2cError when nobody answers."""
        self._identify(self._registers)

    def give_address(self) -> None:
        """Tell the chip at the power-up address its own; raises I2cError, WrongChip."""
        fresh = Registers(self._bus, TOF_ADDRESS, 2)
        self._identify(fresh)
        fresh.write(_ADDRESS, self._config.address)

    def _identify(self, registers: Registers) -> None:
        model = tuple(registers.read_block(_MODEL_ID, 2))
        if model != MODEL:
            raise WrongChip(
                f"the chip at {registers.address:#04x} says {bytes(model).hex()}, a VL53L1X says "
                "eacc; check `chip` of this beam and its wiring"
            )

    def begin(self) -> Iterator[float]:
        """Reset, set up, calibrate, range continuously. Raises I2cError, WrongChip."""
        r = self._registers
        self._count = None
        if r.read(_BOOTED) & 0x01 == 0:
            r.write(_SOFT_RESET, 0x01)  # a start that was broken off may have left it in reset
            yield _BOOT_S
        yield from until(lambda: r.read(_BOOTED) & 0x01 == 1, "the boot of the VL53L1X")
        self.identify()
        if self._config.xshut is None:
            r.write(_SOFT_RESET, 0x00)
            yield _BOOT_S
            r.write(_SOFT_RESET, 0x01)
            yield _BOOT_S
            yield from until(lambda: r.read(_BOOTED) & 0x01 == 1, "the boot of the VL53L1X")
        r.write(_SETTINGS, *_DEFAULTS)
        r.write(_START, _RANGING)
        yield from until(self._ready, "the first measurement of the VL53L1X", limit_s=1.0)
        r.write(_CLEAR, 0x01)
        r.write(_START, 0x00)
        r.write(_VHV_LOOPS, 0x09)
        r.write(_VHV_START, 0x00)
        self._set_timing()
        r.write(_ROI_CENTRE, self._config.roi_centre)
        r.write(_ROI_SIZE, self._config.roi_height - 1 << 4 | self._config.roi_width - 1)
        r.write(_CLEAR, 0x01)
        r.write(_START, _RANGING)

    def _set_timing(self) -> None:
        r, mode = self._registers, self._config.mode
        phase_timeout, period_a, period_b, phase_high, window, first_phase = _MODES[mode]
        r.write(_PHASE_TIMEOUT, phase_timeout)
        r.write(_PERIOD_A, period_a)
        r.write(_PERIOD_B, period_b)
        r.write(_PHASE_HIGH, phase_high)
        r.write_number(_WINDOW, window, 2)
        r.write_number(_FIRST_PHASE, first_phase, 2)
        timeout_a, timeout_b = TIMEOUTS[mode][self._config.budget_ms]
        r.write_number(_TIMEOUT_A, timeout_a, 2)
        r.write_number(_TIMEOUT_B, timeout_b, 2)
        clock = r.read_number(_OSCILLATOR, 2) & 0x3FF
        period_ms = self._config.budget_ms + _OVERHEAD_MS
        r.write_number(_BETWEEN, round(clock * period_ms * _OSCILLATOR_SCALE), 4)

    def _ready(self) -> bool:
        return self._registers.read(_READY) & 0x01 == 1  # the settings make it active high

    def poll(self) -> Measured | None:
        """The measurement that was finished since the last call, if any; raises I2cError."""
        if not self._ready():
            return None
        block = self._registers.read_block(_RESULTS, 17)
        self._registers.write(_CLEAR, 0x01)
        count = block[2]
        if count == self._count:
            raise ChipSilent("the VL53L1X shows the same measurement again")
        self._count = count
        return self._measured(block)

    def _measured(self, block: bytes) -> Measured:
        """From registers 89 to 99: status, SPADs (8.8), ambient (9.7 Mcps), sigma (14.2 mm)."""
        code = block[0] & 0x1F
        spads, ambient_mcps, noise_mm, range_mm = (
            int.from_bytes(block[at : at + 2], "big") / scale
            for at, scale in ((3, 256), (7, 128), (9, 4), (13, 1))
        )
        status = STATUS.get(code, RangeStatus.NO_SIGNAL)
        no_distance = range_mm >= NO_TARGET_MM
        if status is None or (no_distance and status is RangeStatus.VALID):
            status = no_return(
                1e3 * ambient_mcps / spads if spads else 0.0,
                self._config.ambient_max_kcps_per_spad,
            )
        elif no_distance and status is RangeStatus.SUSPECT:
            status = RangeStatus.NO_SIGNAL
        return Measured(
            status=status,
            range_m=range_mm * 1e-3,
            variance_m2=min(noise_mm * 1e-3, self.max_m) ** 2 + RESIDUAL_M**2,
            age_s=self._config.budget_ms * 0.5e-3,
            hardware_fault=code == _HARDWARE,
        )

    def check(self) -> None:
        """Raises ChipReset when the settings are lost, I2cError when it does not answer."""
        self.identify()
        if self._registers.read(_START) & _RANGING == 0:
            raise ChipReset("the VL53L1X lost its settings: reset, or its supply was interrupted")

    def end(self) -> None:
        """Stop measuring; raises I2cError."""
        self._registers.write(_START, 0x00)
