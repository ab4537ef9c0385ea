"""What the server of a bus needs of a chip that measures distance."""

from collections.abc import Callable, Iterator
from typing import Protocol

import msgspec

from hal.config import BeamMount
from hal.errors import HalError
from hal.ranging.i2c_bus import I2cError
from hal.readings import RangeReading, RangeStatus

SPEED_OF_LIGHT_M_S = 299_792_458.0
RESIDUAL_M = 0.003
"""What photon noise does not tell of: ripple over range and whole millimetres, one sigma."""


class WrongChip(HalError):
    """Another chip answers where the configured one should."""


class ChipReset(I2cError):
    """The chip lost its settings: it was reset, or its supply was interrupted."""


class ChipSilent(I2cError):
    """The chip answers on the bus and does not measure."""


class Limits(msgspec.Struct, frozen=True):
    """Range that a beam is believed in, metres; its offset is taken off."""

    min_m: float
    max_m: float


class Measured(msgspec.Struct, frozen=True):
    """One measurement as its chip tells it. `range_m` counts for VALID and SUSPECT only.

    `age_s` is how long before it was read the middle of the measurement was.
    """

    status: RangeStatus
    range_m: float
    variance_m2: float
    age_s: float
    hardware_fault: bool = False
    """The chip itself says that it is broken; it is started anew when that goes on."""

    def reading(self, read_s: float, mount: BeamMount, limits: Limits) -> RangeReading:
        """As a reading of the beam: without its offset, and within its limits, which are of the
        range without it.
        """
        status, range_m = self.status, 0.0
        if status in (RangeStatus.VALID, RangeStatus.SUSPECT):
            range_m = max(0.0, self.range_m - mount.offset_m)
            if status is RangeStatus.VALID and range_m <= limits.min_m:
                status = RangeStatus.TOO_NEAR
            elif status is RangeStatus.VALID and range_m >= limits.max_m:
                status = RangeStatus.OUT_OF_RANGE
        if status is RangeStatus.TOO_NEAR:
            range_m = limits.min_m
        elif status is RangeStatus.OUT_OF_RANGE:
            range_m = limits.max_m
        return RangeReading(
            stamp_s=read_s - self.age_s - (mount.latency_s or 0.0),
            beam=mount.name,
            status=status,
            range_m=range_m,
            variance_m2=max(self.variance_m2, mount.sigma_m * mount.sigma_m),
            min_m=limits.min_m,
            max_m=limits.max_m,
        )


class Ranger(Protocol):
    """One distance sensor. All calls come from the one thread that serves its bus."""

    kind: str
    """Name for sentences."""
    period_s: float
    """Between measurements."""
    min_m: float
    max_m: float

    def begin(self) -> Iterator[float]:
        """From any state to measuring. Each yielded number is a pause in seconds, in which other
        chips are served. Raises I2cError, WrongChip.
        """
        ...

    def poll(self) -> Measured | None:
        """The measurement that was finished since the last call, if any; raises I2cError."""
        ...

    def check(self) -> None:
        """Raises ChipReset when the settings are lost, I2cError when it does not answer."""
        ...

    def end(self) -> None:
        """Stop measuring; raises I2cError."""
        ...


class Addressable(Ranger, Protocol):
    """A ranger that XSHUT holds in reset, and whose address is given to it after that."""

    def identify(self) -> None:
        """Raises WrongChip, or I2cError when nobody answers."""
        ...

    def give_address(self) -> None:
        """Tell the chip at the power-up address its own; raises I2cError, WrongChip."""
        ...


def until(
    done: Callable[[], bool], what: str, *, limit_s: float = 0.5, step_s: float = 0.002
) -> Iterator[float]:
    """Pauses until `done`; raises ChipSilent after `limit_s` of them."""
    waited_s = 0.0
    while not done():
        if waited_s >= limit_s:
            raise ChipSilent(f"{what} was not done within {limit_s:g} s")
        waited_s += step_s
        yield step_s


def no_return(ambient_kcps_per_spad: float, ambient_max: float) -> RangeStatus:
    """What a missing return means: nothing there, as long as ambient light does not drown it."""
    if ambient_kcps_per_spad > ambient_max:
        return RangeStatus.NO_SIGNAL
    return RangeStatus.OUT_OF_RANGE
