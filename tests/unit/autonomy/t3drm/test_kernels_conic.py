"""The conic's root and its sampled points, one by one."""

import itertools
import math

import numpy as np
import pytest

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats


@pytest.mark.parametrize(
    ("anomaly_deg", "ratio", "expected"),
    [(90.0, 0.25, 3.0), (60.0, 0.75, 1.0), (120.0, 0.5, 0.5), (180.0, 0.2, 2.0 / 3.0)],
)
def test_the_eccentricity_by_the_anomaly_of_a_point(
    anomaly_deg: float, ratio: float, expected: float
) -> None:
    # 1 / ratio = (1 + e) / (1 + e cos nu).
    assert kernels.eccentricity(math.radians(anomaly_deg), ratio) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("ratio_d", "ratio_g", "sweep_deg"),
    [
        *((0.1, 0.1, sweep_deg) for sweep_deg in (160.0, 179.0, 180.0, 181.0, 250.0, 359.0)),
        *((0.1, 0.4, sweep_deg) for sweep_deg in (150.0, 152.0, 180.0, 250.0)),
        *((0.9, 0.05, sweep_deg) for sweep_deg in (110.0, 115.0, 170.0, 180.0)),
        *((0.5, 0.99, sweep_deg) for sweep_deg in (60.0, 70.0, 90.0, 170.0)),
        # Well beyond half a turn only points that are nearly as far as each other share a conic.
        (0.3, 0.302, 350.0),
        (0.302, 0.3, 350.0),
    ],
)
def test_the_root_puts_both_points_on_one_conic(
    ratio_d: float, ratio_g: float, sweep_deg: float
) -> None:
    sweep = math.radians(sweep_deg)
    anomaly = kernels.fly_by_anomaly(ratio_d, ratio_g, sweep)
    if sweep <= math.acos(ratio_d) + math.acos(ratio_g):
        assert math.isnan(anomaly)
        return
    e = kernels.eccentricity(anomaly, ratio_d)
    assert e == pytest.approx(kernels.eccentricity(sweep - anomaly, ratio_g), rel=1e-9)
    assert e > 0.0
    # Neither point lies beyond the conic's own far side.
    assert 0.0 < anomaly < math.pi
    assert 0.0 < sweep - anomaly < math.pi
    if ratio_d == ratio_g:
        assert anomaly == pytest.approx(0.5 * sweep, abs=1e-14)


def test_points_on_the_tangent_at_the_periapsis_have_no_conic() -> None:
    half = math.acos(0.5)
    assert math.isnan(kernels.fly_by_anomaly(0.5, 0.5, 2.0 * half))
    assert math.isnan(kernels.fly_by_anomaly(0.5, 0.5, 2.0 * half - 1e-9))
    assert kernels.fly_by_anomaly(0.5, 0.5, 2.0 * half + 1e-9) == pytest.approx(half)


def length_and_bend(e: float, periapsis: float, nu: float) -> tuple[float, float]:
    """(length per radian, curvature) of the conic, by differences."""
    step = 1e-4
    places = []
    for angle in (nu - step, nu, nu + step):
        r = periapsis * (1.0 + e) / (1.0 + e * math.cos(angle))
        places.append(np.array((r * math.cos(angle), r * math.sin(angle))))
    first = (places[2] - places[0]) / (2.0 * step)
    second = (places[2] - 2.0 * places[1] + places[0]) / step**2
    speed = math.hypot(*first)
    return speed, abs(first[0] * second[1] - first[1] * second[0]) / speed**3


def sagittas(rows: Floats, e: float, periapsis: float) -> list[float]:
    """How far the curve leaves each chord."""
    found = []
    for (a, ra), (b, rb) in itertools.pairwise(rows):
        p, q = (np.array((r * math.cos(nu), r * math.sin(nu))) for nu, r in ((a, ra), (b, rb)))
        chord = (q - p) / math.hypot(*(q - p))
        away = 0.0
        for nu in np.linspace(a, b, 21):
            r = periapsis * (1.0 + e) / (1.0 + e * math.cos(nu))
            d = np.array((r * math.cos(nu), r * math.sin(nu))) - p
            away = max(away, abs(d[0] * chord[1] - d[1] * chord[0]))
        found.append(away)
    return found


@pytest.mark.parametrize(
    ("e", "periapsis", "begin", "end", "sagitta"),
    [
        (3.0, 0.2, -1.6, 1.7, 5e-4),
        (14.0, 0.2, -1.55, 1.2, 5e-4),
        (1.0, 0.5, -2.0, 2.5, 1e-3),
        (0.4, 0.25, -2.5, 2.0, 1e-4),
        (2.0, 1.0, 0.3, 1.5, 1e-3),
        (2.0, 1.0, -1.5, -0.3, 1e-3),
        (9.0, 0.2, -0.4, 1.4, 2e-3),
    ],
)
def test_chords_are_as_long_as_their_sagitta_allows_and_hardly_shorter(
    e: float, periapsis: float, begin: float, end: float, sagitta: float
) -> None:
    rows = kernels.sample_conic(e, periapsis, begin, end, sagitta)
    assert rows[0, 0] == begin
    assert rows[-1, 0] == end
    assert (np.diff(rows[:, 0]) > 0.0).all()
    radii = periapsis * (1.0 + e) / (1.0 + e * np.cos(rows[:, 0]))
    assert rows[:, 1] == pytest.approx(radii)
    assert max(sagittas(rows, e, periapsis)) <= 1.02 * sagitta
    # As many chords as a curve needs that is nowhere nearer to them than allowed.
    turns = np.linspace(begin, end, 400)
    needed = 0.0
    for nu in turns:
        speed, bend = length_and_bend(e, periapsis, float(nu))
        needed += speed * math.sqrt(bend / (8.0 * sagitta)) * (end - begin) / 400
    assert needed - 1.0 <= len(rows) - 1 <= 1.35 * needed + 2.0


@pytest.mark.parametrize(("radius", "sagitta"), [(1.0, 1e-3), (2.0, 1e-3), (0.5, 1e-4)])
def test_a_circle_is_sampled_evenly(radius: float, sagitta: float) -> None:
    # A chord over the angle a has the sagitta r (1 - cos a/2), about r a^2 / 8.
    step = math.sqrt(8.0 * sagitta / radius)
    rows = kernels.sample_conic(0.0, radius, -1.0, 1.0, sagitta)
    assert np.diff(rows[:-1, 0]) == pytest.approx(step)
    assert len(rows) == math.ceil(2.0 / step) + 1
    assert rows[:, 1] == pytest.approx(radius)


def test_however_coarse_a_step_is_at_most_half_a_radian() -> None:
    rows = kernels.sample_conic(0.0, 1.0, 0.0, 1.75, 10.0)
    assert rows[:, 0].tolist() == pytest.approx([0.0, 0.5, 1.0, 1.5, 1.75])
    rows = kernels.sample_conic(0.0, 1.0, 0.0, 0.3, 10.0)
    assert rows[:, 0].tolist() == [0.0, 0.3]


def test_however_fine_a_step_is_at_least_a_milliradian_and_the_end_is_kept() -> None:
    rows = kernels.sample_conic(1.5, 0.2, -1.0, 1.0, 1e-12)
    assert rows.shape == (512, 2)
    assert np.diff(rows[:-1, 0]) == pytest.approx(1e-3)
    assert rows[-1].tolist() == pytest.approx([1.0, 0.5 / (1.0 + 1.5 * math.cos(1.0))])


def test_no_way_is_one_point() -> None:
    assert kernels.sample_conic(2.0, 0.3, 0.0, 0.0, 1e-3).tolist() == [[0.0, pytest.approx(0.3)]]
