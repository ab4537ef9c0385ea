import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hal.config import BeamMount, BeamsConfig
from hal.frames import Vector3, ned_from_geodetic
from hal.readings import FixType, GnssFix, RangeReading, RangeStatus
from hal.sim.scenario import (
    BeamSimulation,
    EstimatorSimulation,
    GnssSimulation,
    Scenario,
    Wall,
)
from hal.sim.sensors import EstimatorError, SimulatedBeams, SimulatedGnss, axis_frd
from hal.sim.world import World

QUIET: dict[str, float] = {
    "sigma_m": 0.0,
    "sigma_fraction": 0.0,
    "quantum_m": 0.0,
    "dropout_probability": 0.0,
}
HERE: Vector3 = (0.0, 0.0, -0.8)
FRONT_WALL = Wall(from_ne_m=(0.55, -5.0), to_ne_m=(0.55, 5.0), thickness_m=0.1)
RIGHT_WALL = Wall(from_ne_m=(-5.0, 0.75), to_ne_m=(5.0, 0.75), thickness_m=0.1)


def beams(
    *walls: Wall, config: BeamsConfig | None = None, seed: int = 1, **model: float
) -> SimulatedBeams:
    world = World(Scenario(name="test", obstacles=walls))
    chosen = BeamSimulation(**{**QUIET, **model})
    return SimulatedBeams(world, config or BeamsConfig(), chosen, np.random.default_rng(seed))


def by_beam(readings: tuple[RangeReading, ...]) -> dict[str, RangeReading]:
    return {reading.beam: reading for reading in readings}


def many(sampler: SimulatedBeams, count: int, beam: str) -> list[RangeReading]:
    return [by_beam(sampler.sample(k * 0.05, HERE, 0.0, 0.0, 0.0))[beam] for k in range(count)]


def test_each_beam_looks_where_it_is_mounted() -> None:
    seen = by_beam(beams(FRONT_WALL, RIGHT_WALL).sample(0.0, HERE, 0.0, 0.0, 0.0))
    assert seen["front"].range_m == pytest.approx(0.5)
    assert seen["right"].range_m == pytest.approx(0.7)
    assert seen["down"].range_m == pytest.approx(0.8)
    nothing_near = [seen[name].status for name in ("back", "left", "up")]
    assert nothing_near == [RangeStatus.OUT_OF_RANGE] * 3


def test_the_beams_turn_with_the_vehicle() -> None:
    seen = by_beam(beams(FRONT_WALL).sample(0.0, HERE, 0.0, 0.0, math.pi / 2.0))
    assert seen["left"].range_m == pytest.approx(0.5)
    assert seen["front"].status is RangeStatus.OUT_OF_RANGE


def test_the_beams_tilt_with_the_vehicle() -> None:
    seen = by_beam(beams().sample(0.0, HERE, 0.3, 0.0, 0.0))
    assert seen["down"].range_m == pytest.approx(0.8 / math.cos(0.3))


def test_a_mount_off_the_centre_measures_from_its_face() -> None:
    config = BeamsConfig(mounts=(BeamMount(name="nose", forward_m=0.1),))
    (reading,) = beams(FRONT_WALL, config=config).sample(0.0, HERE, 0.0, 0.0, 0.0)
    assert reading.range_m == pytest.approx(0.4)


def test_the_axes_of_mounts_are_the_bodys() -> None:
    assert axis_frd(BeamMount(name="right", yaw_deg=90.0)) == pytest.approx((0.0, 1.0, 0.0))
    slanted = axis_frd(BeamMount(name="slanted", yaw_deg=90.0, pitch_deg=-60.0))
    assert slanted == pytest.approx((0.0, 0.5, math.sqrt(0.75)))
    assert axis_frd(BeamMount(name="up", pitch_deg=90.0)) == pytest.approx((0.0, 0.0, -1.0))


def test_what_is_too_near_or_too_far_is_said_and_not_guessed() -> None:
    sampler = beams(FRONT_WALL)
    close = by_beam(sampler.sample(0.0, (0.481, 0.0, -0.8), 0.0, 0.0, 0.0))["front"]
    assert (close.status, close.range_m) == (RangeStatus.TOO_NEAR, 0.02)
    touching = by_beam(sampler.sample(0.05, (0.479, 0.0, -0.8), 0.0, 0.0, 0.0))["front"]
    assert touching.status is RangeStatus.VALID
    at_limit = by_beam(sampler.sample(0.10, (-0.499, 0.0, -0.8), 0.0, 0.0, 0.0))["front"]
    assert at_limit.status is RangeStatus.VALID
    far = by_beam(sampler.sample(0.15, (-0.501, 0.0, -0.8), 0.0, 0.0, 0.0))["front"]
    assert (far.status, far.range_m) == (RangeStatus.OUT_OF_RANGE, 1.0)


def test_a_rounded_reading_of_exactly_a_limit_is_valid() -> None:
    sampler = beams(FRONT_WALL, quantum_m=0.01)
    for stamp_s, north, expected in ((0.0, 0.482, 0.02), (0.05, -0.502, 1.0)):
        seen = by_beam(sampler.sample(stamp_s, (north, 0.0, -0.8), 0.0, 0.0, 0.0))["front"]
        assert seen.status is RangeStatus.VALID
        assert seen.range_m == pytest.approx(expected)


def test_readings_carry_the_limits_of_the_configured_beams() -> None:
    config = BeamsConfig(min_m=0.04, max_m=0.6)
    readings = beams(FRONT_WALL, RIGHT_WALL, config=config).sample(0.0, HERE, 0.0, 0.0, 0.0)
    assert {(r.min_m, r.max_m) for r in readings} == {(0.04, 0.6)}
    assert by_beam(readings)["right"].status is RangeStatus.OUT_OF_RANGE


def test_ranges_are_rounded_to_the_quantum() -> None:
    sampler = beams(FRONT_WALL, sigma_m=0.02, quantum_m=0.01)
    ranges = [r.range_m for r in many(sampler, 50, "front")]
    assert len(set(ranges)) > 3
    assert all(abs(r * 100.0 - round(r * 100.0)) < 1e-6 for r in ranges)


def test_the_noise_is_as_wide_as_its_variance_says() -> None:
    sampler = beams(FRONT_WALL, sigma_m=0.005, sigma_fraction=0.01, quantum_m=0.01)
    readings = many(sampler, 4000, "front")
    errors = np.array([r.range_m - 0.5 for r in readings])
    claimed = np.mean([r.variance_m2 for r in readings])
    assert errors.mean() == pytest.approx(0.0, abs=6e-4)
    assert errors.var() == pytest.approx(0.01**2 + 0.01**2 / 12.0, rel=0.1)
    # The claim follows the reading, not the truth, hence the small tolerance.
    assert claimed == pytest.approx(0.01**2 + 0.01**2 / 12.0, rel=0.01)


def test_dropouts_come_as_often_as_configured_and_are_not_zero_distances() -> None:
    readings = many(beams(FRONT_WALL, dropout_probability=0.1), 4000, "front")
    lost = [r for r in readings if r.status is RangeStatus.NO_SIGNAL]
    assert len(lost) == pytest.approx(400, abs=80)
    assert {r.range_m for r in lost} == {0.0}
    assert min(r.variance_m2 for r in lost) > 0.05


def test_no_noise_brings_the_sky_into_range() -> None:
    readings = many(beams(sigma_m=0.1), 300, "up")
    assert {r.status for r in readings} == {RangeStatus.OUT_OF_RANGE}


def test_a_cone_of_the_scenario_widens_every_beam() -> None:
    post = Wall(from_ne_m=(0.5, 0.08), to_ne_m=(0.5, 0.12), thickness_m=0.02)
    thin = by_beam(beams(post).sample(0.0, HERE, 0.0, 0.0, 0.0))
    wide = by_beam(beams(post, half_angle_deg=12.5).sample(0.0, HERE, 0.0, 0.0, 0.0))
    assert thin["front"].status is RangeStatus.OUT_OF_RANGE
    assert wide["front"].range_m == pytest.approx(0.5, abs=0.03)


def test_the_same_seed_gives_the_same_readings_and_another_one_others() -> None:
    noisy: dict[str, Any] = {"sigma_m": 0.01, "dropout_probability": 0.05}
    runs = [many(beams(FRONT_WALL, seed=s, **noisy), 600, "front") for s in (7, 7, 8)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def count(sample: Callable[[float], object], step_s: float, seconds: float) -> int:
    return sum(bool(sample(k * step_s)) for k in range(round(seconds / step_s)))


@pytest.mark.parametrize("step_s", [0.002, 0.004, 0.02, 0.05])
def test_the_beams_keep_their_rate_however_often_they_are_asked(step_s: float) -> None:
    sampler = beams(FRONT_WALL)
    times = count(lambda t: sampler.sample(t, HERE, 0.0, 0.0, 0.0), step_s, 10.0)
    assert times == pytest.approx(200, abs=2)


def test_a_caller_that_jitters_at_the_same_rate_is_answered_every_time() -> None:
    sampler = beams(FRONT_WALL)
    jitter = np.random.default_rng(3).uniform(-0.005, 0.005, 200).tolist()
    answered = [
        bool(sampler.sample(k * 0.05 + j, HERE, 0.0, 0.0, 0.0)) for k, j in enumerate(jitter)
    ]
    assert all(answered)


def test_after_a_pause_there_is_one_measurement_and_no_burst() -> None:
    sampler = beams(FRONT_WALL)
    assert sampler.sample(0.0, HERE, 0.0, 0.0, 0.0)
    assert sampler.sample(30.0, HERE, 0.0, 0.0, 0.0)
    assert not sampler.sample(30.001, HERE, 0.0, 0.0, 0.0)
    assert sampler.sample(30.05, HERE, 0.0, 0.0, 0.0)


def test_delayed_readings_say_when_they_were_measured() -> None:
    sampler = beams(FRONT_WALL, delay_s=0.03)
    assert sampler.sample(0.0, HERE, 0.0, 0.0, 0.0) == ()
    assert sampler.sample(0.02, (0.2, 0.0, -0.8), 0.0, 0.0, 0.0) == ()
    seen = by_beam(sampler.sample(0.03, (0.3, 0.0, -0.8), 0.0, 0.0, 0.0))["front"]
    assert seen.stamp_s == 0.0
    assert seen.range_m == pytest.approx(0.5)


def fixes(model: GnssSimulation, seconds: float, seed: int = 1) -> list[tuple[float, GnssFix]]:
    receiver = SimulatedGnss(model, np.random.default_rng(seed))
    heard = []
    for k in range(round(seconds / 0.005)):
        now_s = k * 0.005
        fix = receiver.sample(now_s, (now_s, 0.0, -1.0))
        if fix is not None:
            heard.append((now_s, fix))
    return heard


def test_gnss_fixes_come_at_their_rate_and_delay() -> None:
    heard = fixes(GnssSimulation(rate_hz=8.0, delay_s=0.1), 10.0)
    assert len(heard) == pytest.approx(80, abs=2)
    assert {fix.fix_type for _, fix in heard} == {FixType.FIX_3D}
    for now_s, fix in heard:
        assert now_s - fix.stamp_s == pytest.approx(0.1, abs=0.006)


def test_gnss_errors_are_as_wide_as_the_accuracies_say() -> None:
    model = GnssSimulation(horizontal_sigma_m=0.4, vertical_sigma_m=0.9)
    errors = []
    for _, fix in fixes(model, 200.0):
        n, e, d = ned_from_geodetic(fix.latitude_deg, fix.longitude_deg, fix.amsl_m, model.origin)
        errors.append((n - fix.stamp_s, e, d + 1.0))
    spread = np.std(errors, axis=0)
    assert np.mean(errors, axis=0) == pytest.approx((0.0, 0.0, 0.0), abs=0.1)
    assert spread == pytest.approx((0.4, 0.4, 0.9), rel=0.1)
    fix = fixes(model, 1.0)[0][1]
    assert (fix.horizontal_accuracy_m, fix.vertical_accuracy_m) == (0.4, 0.9)


def wander(model: EstimatorSimulation, steps: int, dt_s: float) -> np.ndarray[Any, Any]:
    error = EstimatorError(model, np.random.default_rng(5))
    offsets = [error.step(dt_s) for _ in range(steps)]
    return np.array([(*o.position_ned_m, *o.velocity_ned_m_s, o.yaw_rad) for o in offsets])


def test_the_estimates_error_has_the_configured_spread() -> None:
    model = EstimatorSimulation(
        position_sigma_m=0.02,
        height_sigma_m=0.03,
        velocity_sigma_m_s=0.01,
        yaw_sigma_deg=2.0,
        correlation_s=1.0,
    )
    spread = wander(model, 40_000, 0.5).std(axis=0)
    expected = (0.02, 0.02, 0.03, 0.01, 0.01, 0.01, math.radians(2.0))
    assert spread == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("dt_s", [0.05, 0.25])
def test_the_estimates_error_forgets_with_its_correlation_time(dt_s: float) -> None:
    values = wander(EstimatorSimulation(correlation_s=1.0), 40_000, dt_s)
    lag = round(1.0 / dt_s)
    for column in values.T:
        correlation = np.corrcoef(column[:-lag], column[lag:])[0, 1]
        assert correlation == pytest.approx(math.exp(-1.0), abs=0.12)


def test_no_time_changes_no_error_and_the_axes_are_independent() -> None:
    error = EstimatorError(EstimatorSimulation(), np.random.default_rng(5))
    assert error.step(0.0) == error.step(0.0)
    correlations = np.corrcoef(wander(EstimatorSimulation(correlation_s=0.2), 20_000, 0.5).T)
    assert np.abs(correlations - np.eye(7)).max() < 0.05


def test_the_estimates_error_begins_as_wide_as_it_stays() -> None:
    first = [
        EstimatorError(EstimatorSimulation(), np.random.default_rng(seed)).step(0.05)
        for seed in range(400)
    ]
    assert np.std([o.position_ned_m[0] for o in first]) == pytest.approx(0.02, rel=0.15)
