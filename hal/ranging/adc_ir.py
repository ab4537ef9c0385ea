"""Sharp GP2Y0A21 and GP2Y0A02: triangulation, a voltage that falls with the distance.

Sources: the sensors' data sheets (OP13008EN, E4-A00101EN): ranges 10 to 80 cm and 20 to 150 cm,
a new measurement every 38.3 +- 9.6 ms, typical curves. The curve is not the one of your sensor:
10 % between specimens is usual, so calibrate each.

**Fold-back.** Nearer than its minimum the voltage falls again, and an object at 4 cm looks like one
at 20. One voltage cannot tell the two apart, its history can: the way in leads over the top of the
curve, or is a leap. `FoldWatch` holds the rule.
"""

import bisect
from collections.abc import Iterator

from hal.config import SHARP_REFRESH_S, PowerCurve, SharpIrConfig, TableCurve
from hal.ranging.ads1115 import FULL_SCALE, VOLTS_PER_STEP, Ads1115
from hal.ranging.ranger import RESIDUAL_M, Measured
from hal.readings import RangeStatus

REFRESH_S = SHARP_REFRESH_S
AGE_S = REFRESH_S
"""Middle of the measurement that is shown: half a period long, shown for one period after."""

Curve = PowerCurve | TableCurve
_TYPICAL: dict[str, tuple[tuple[float, float], ...]] = {
    "gp2y0a21": (
        (0.10, 2.30),
        (0.15, 1.65),
        (0.20, 1.30),
        (0.30, 0.92),
        (0.40, 0.74),
        (0.50, 0.61),
        (0.60, 0.52),
        (0.70, 0.45),
        (0.80, 0.40),
    ),
    "gp2y0a02": (
        (0.20, 2.45),
        (0.30, 2.00),
        (0.40, 1.55),
        (0.50, 1.27),
        (0.60, 1.07),
        (0.70, 0.92),
        (0.80, 0.82),
        (0.90, 0.73),
        (1.00, 0.66),
        (1.10, 0.60),
        (1.20, 0.54),
        (1.30, 0.49),
        (1.40, 0.44),
        (1.50, 0.40),
    ),
}
LIMITS_M = {"gp2y0a21": (0.10, 0.80), "gp2y0a02": (0.20, 1.50)}
FOLD_MAX_M = {"gp2y0a21": 0.40, "gp2y0a02": 0.60}
"""How far an object inside the minimum distance can seem: the voltage with the object touching the
lens is about that of this distance."""
_RELEASE_AFTER = 3
_SIGMAS = 4.0


def curve_of(config: SharpIrConfig) -> Curve:
    """The configured curve, or the typical one of the data sheet."""
    if config.curve is not None:
        return config.curve
    return TableCurve(kind="table", points=_TYPICAL[config.chip])


def range_and_slope(curve: Curve, volts: float) -> tuple[float, float]:
    """(range in metres, its derivative in metres per volt, negative) at `volts` > 0.

    Outside a table its first or last piece goes on.
    """
    if isinstance(curve, PowerCurve):
        far_m = curve.scale_m * volts**-curve.exponent
        return far_m - curve.offset_m, -curve.exponent * far_m / volts
    points = curve.points
    falling = [-point[1] for point in points]
    at = min(max(bisect.bisect_left(falling, -volts), 1), len(points) - 1)
    (near_m, near_v), (far_m, far_v) = points[at - 1], points[at]
    per_volt = (1.0 / near_m - 1.0 / far_m) / (near_v - far_v)
    inverse = max(1.0 / far_m + (volts - far_v) * per_volt, 1e-3)
    return 1.0 / inverse, -per_volt / (inverse * inverse)


class FoldWatch:
    """Tells the far branch of the curve from the near one, by motion.

    Doubt begins when the voltage was above that of the minimum distance (the top of the curve was
    crossed or touched), and when a reading that came nearer leaps away faster than anything moves.
    In doubt everything that the near branch can show, up to `fold_max_m`, is TOO_NEAR. Doubt ends
    with `_RELEASE_AFTER` readings in a row beyond that; until the last of them they are SUSPECT.
    """

    def __init__(self, fold_max_m: float, closing_max_m_s: float) -> None:
        self._fold_max_m = fold_max_m
        self._closing_max_m_s = closing_max_m_s
        self._last_m: float | None = None
        self._closing = False
        self._doubt = False
        self._beyond = 0

    def status(self, range_m: float, sigma_m: float, *, above_top: bool) -> RangeStatus:
        """Of the reading `range_m`, one `REFRESH_S` after the last one."""
        leapt = self._leapt(range_m, sigma_m)
        if above_top or leapt:
            self._doubt, self._beyond = True, 0
        if above_top:
            return RangeStatus.TOO_NEAR
        if not self._doubt:
            return RangeStatus.VALID
        if range_m <= self._fold_max_m:
            self._beyond = 0
            return RangeStatus.TOO_NEAR
        self._beyond += 1
        self._doubt = self._beyond < _RELEASE_AFTER
        return RangeStatus.SUSPECT if self._doubt else RangeStatus.VALID

    def _leapt(self, range_m: float, sigma_m: float) -> bool:
        """True when it came nearer and is suddenly farther than motion can explain."""
        last_m, self._last_m = self._last_m, range_m
        was_closing = self._closing
        if last_m is None:
            return False
        step_m = range_m - last_m
        if abs(step_m) > sigma_m:
            self._closing = step_m < 0.0
        reach_m = self._closing_max_m_s * REFRESH_S
        # From farther away the near branch is out of reach within one period.
        within_reach = last_m <= self._fold_max_m
        return was_closing and within_reach and step_m > reach_m + _SIGMAS * sigma_m


class SharpIr:
    """`hal.ranging.ranger.Ranger` on one input of an ADS1115."""

    period_s = REFRESH_S

    def __init__(self, converter: Ads1115, config: SharpIrConfig) -> None:
        self._converter = converter
        self._config = config
        self._curve = curve_of(config)
        self._fold_max_m = config.fold_max_m or FOLD_MAX_M[config.chip]
        self._watch = FoldWatch(self._fold_max_m, config.closing_max_m_s)
        self.kind = config.chip.upper()
        self.min_m, self.max_m = LIMITS_M[config.chip]

    def begin(self) -> Iterator[float]:
        """The sensor runs by itself; the converter must answer. Raises I2cError."""
        self._converter.identify()
        self._watch = FoldWatch(self._fold_max_m, self._config.closing_max_m_s)
        yield 0.0

    def poll(self) -> Measured:
        """One conversion; raises I2cError."""
        return self._measured(self._converter.steps(self._config.input))

    def _measured(self, steps: int) -> Measured:
        volts = steps * VOLTS_PER_STEP
        if volts < self._config.dead_v:
            return Measured(RangeStatus.NO_SIGNAL, 0.0, self.max_m**2, AGE_S)
        range_m, slope = range_and_slope(self._curve, max(volts, VOLTS_PER_STEP))
        sigma_m = min(abs(slope) * self._config.noise_v, self.max_m)
        above_top = steps >= FULL_SCALE or range_m < self.min_m
        status = self._watch.status(range_m, sigma_m, above_top=above_top)
        if status is RangeStatus.VALID and range_m > self.max_m:
            status = RangeStatus.OUT_OF_RANGE
        return Measured(status, range_m, sigma_m * sigma_m + RESIDUAL_M**2, AGE_S)

    def check(self) -> None:
        """Raises I2cError when the converter does not answer."""
        self._converter.identify()

    def end(self) -> None:
        """The sensor cannot be stopped."""
