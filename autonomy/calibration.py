"""Offset and noise of a range beam, from readings of a surface at a known distance. Pure."""

import math
import statistics
from collections.abc import Iterable, Sequence

import msgspec
import yaml

from autonomy.errors import BadInput
from hal.config import BeamMount, BeamsConfig
from hal.readings import RangeReading, RangeStatus

LEAST_READINGS = 20
LARGEST_OFFSET_M = 0.15
"""More than this is not the sensor: the distance is wrong, or something is in the way."""
LARGEST_SIGMA_M = 0.05
LARGEST_DRIFT_SIGMAS = 4.0
_LEAST_BELIEVED = 0.8
_NORMAL = 1.4826
"""Median absolute deviation to standard deviation, for a normal distribution."""
_MEDIAN = (math.pi / 2.0) ** 0.5
"""Standard deviation of a median over that of a mean, for a normal distribution."""
_RESOLUTION_M = 0.001


class Calibration(msgspec.Struct, frozen=True):
    """What was measured of one beam."""

    beam: str
    distance_m: float
    offset_m: float
    """New `offset_m` of the mount: how much the bare sensor reads too far."""
    sigma_m: float
    """Standard deviation of a reading, never told smaller than 1 mm."""
    bias_m: float
    """How far off the readings were with the offset in force."""
    readings: int
    others: int
    """Readings of the beam that were no distance."""
    rate_hz: float


def calibrate(
    beams: BeamsConfig, beam: str, distance_m: float, readings: Sequence[RangeReading]
) -> Calibration:
    """Offset and noise of `beam` before a surface `distance_m` from the sensor's face.

    `readings` were taken with `beams` in force. Median and median deviation, so that single leaps
    do not count. Raises BadInput with what to do when this is no calibration.
    """
    own = [reading for reading in readings if reading.beam == beam]
    ranges = [reading.range_m for reading in own if reading.status is RangeStatus.VALID]
    _refuse_few(beam, own, len(ranges))
    middle_m = statistics.median(ranges)
    spread_m = _NORMAL * statistics.median(abs(range_m - middle_m) for range_m in ranges)
    sigma_m = max(spread_m, _RESOLUTION_M)
    bias_m = middle_m - distance_m
    if abs(bias_m) > LARGEST_OFFSET_M:
        raise BadInput(
            f"beam {beam} reads {middle_m:.3f} m, not {distance_m:.3f} m; check the distance from "
            "the sensor's face, and that nothing else is in its cone"
        )
    if sigma_m > LARGEST_SIGMA_M:
        raise BadInput(
            f"beam {beam} scatters by {sigma_m * 100:.1f} cm; use a flat, bright, fixed surface"
        )
    _refuse_drift(beam, ranges, sigma_m)
    seconds = own[-1].stamp_s - own[0].stamp_s
    return Calibration(
        beam=beam,
        distance_m=distance_m,
        offset_m=round(beams.mount(beam).offset_m + bias_m, 4),
        sigma_m=round(sigma_m, 4),
        bias_m=bias_m,
        readings=len(ranges),
        others=len(own) - len(ranges),
        rate_hz=(len(own) - 1) / seconds if seconds > 0.0 else 0.0,
    )


def _refuse_few(beam: str, own: Sequence[RangeReading], valid: int) -> None:
    if valid >= LEAST_READINGS and valid >= _LEAST_BELIEVED * len(own):
        return
    seen = ", ".join(sorted({str(reading.status) for reading in own})) or "nothing"
    raise BadInput(
        f"beam {beam}: {valid} of {len(own)} readings are distances (it told {seen}); put a flat "
        "surface at the given distance within the sensor's range, or measure longer"
    )


def _refuse_drift(beam: str, ranges: Sequence[float], sigma_m: float) -> None:
    """The halves must agree: otherwise the vehicle or the surface moved."""
    half = len(ranges) // 2
    drift_m = statistics.median(ranges[half:]) - statistics.median(ranges[:half])
    of_a_median_m = _MEDIAN * sigma_m / half**0.5
    allowed_m = LARGEST_DRIFT_SIGMAS * 2.0**0.5 * of_a_median_m + _RESOLUTION_M
    if abs(drift_m) > allowed_m:
        raise BadInput(
            f"beam {beam} moved by {drift_m * 100:+.1f} cm while it was measured; hold vehicle and "
            "surface still and repeat"
        )


def calibrated(beams: BeamsConfig, calibration: Calibration) -> BeamsConfig:
    """`beams` with the result in its mount."""
    mounts = tuple(
        mount.model_copy(update={"offset_m": calibration.offset_m, "sigma_m": calibration.sigma_m})
        if mount.name == calibration.beam
        else mount
        for mount in beams.mounts
    )
    return beams.model_copy(update={"mounts": mounts})


HEADING = "# Measured by autonomy calibrate: paste beams.mounts over that of your configuration.\n"


def as_yaml(beams: BeamsConfig, calibration: Calibration) -> str:
    """The mounts with the result, as a configuration document: a list is given as a whole."""
    return _document(calibrated(beams, calibration).mounts)


def _document(mounts: Iterable[BeamMount]) -> str:
    told = [mount.model_dump(mode="json", exclude_defaults=True) for mount in mounts]
    document = {"beams": {"mounts": told}}
    return HEADING + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def remembered(beams: BeamsConfig, text: str, name: str) -> BeamsConfig:
    """`beams` with what earlier calibrations found, from the text of a file that they wrote.

    Raises BadInput for a text that is not, word for word, what `as_yaml` writes: it is somebody's,
    and his comments would be lost.
    """
    try:
        written = [BeamMount.model_validate(one) for one in yaml.safe_load(text)["beams"]["mounts"]]
    except (yaml.YAMLError, ValueError, LookupError, TypeError):
        written = []
    if not written or _document(written) != text:
        raise BadInput(
            f"{name} is not as autonomy calibrate wrote it, and is left alone; give --out a name "
            "of its own, and paste the mounts from there"
        )
    found = {mount.name: (mount.offset_m, mount.sigma_m) for mount in written}
    mounts = []
    for mount in beams.mounts:
        offset_m, sigma_m = found.get(mount.name, (mount.offset_m, mount.sigma_m))
        mounts.append(mount.model_copy(update={"offset_m": offset_m, "sigma_m": sigma_m}))
    return beams.model_copy(update={"mounts": tuple(mounts)})


def described(calibration: Calibration) -> str:
    """One line for a terminal."""
    return (
        f"beam {calibration.beam} at {calibration.distance_m:g} m: reads "
        f"{calibration.bias_m * 1000:+.1f} mm, noise {calibration.sigma_m * 1000:.1f} mm, "
        f"{calibration.readings} readings at {calibration.rate_hz:.1f} Hz"
        + (f", {calibration.others} without a distance" if calibration.others else "")
    )
