import math

import numpy as np
import pytest

from hal.config import BeamsConfig
from hal.documents import validate_document
from hal.errors import DocumentError
from hal.frames import Vector3, ned_from_geodetic
from hal.readings import FixType, GnssFix, LocalPosition, RangeReading, RangeStatus
from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import parse_fault
from hal.sim.faults import GnssFaults, PositionFaults, with_beam_faults
from hal.sim.scenario import BeamSimulation, Scenario, Wall
from hal.sim.sensors import BeamSampler, SimulatedBeams
from hal.sim.world import World

WALL = Wall(from_ne_m=(2.0, -5.0), to_ne_m=(2.0, 5.0), thickness_m=0.1)
QUIET = BeamSimulation(sigma_m=0.0, sigma_fraction=0.0, quantum_m=0.0, dropout_probability=0.0)


def scenario(*faults: dict[str, object]) -> Scenario:
    document = {"name": "test", "obstacles": [WALL.model_dump()], "faults": list(faults)}
    return validate_document(document, Scenario, "test.yaml")


def healthy() -> SimulatedBeams:
    rng = np.random.default_rng(1)
    return SimulatedBeams(World(scenario()), BeamsConfig(), QUIET, rng)


def faulty(*faults: dict[str, object], since_s: float = 0.0) -> BeamSampler:
    rng = np.random.default_rng(2)
    return with_beam_faults(healthy(), scenario(*faults).faults, rng, since_s)


def at(sampler: BeamSampler, now_s: float) -> dict[str, RangeReading]:
    """What is heard at `now_s` by a vehicle that flies north at 0.1 m/s, towards a wall."""
    position: Vector3 = (1.0 + 0.1 * now_s, 0.0, -0.8)
    return {r.beam: r for r in sampler.sample(now_s, position, 0.0, 0.0, 0.0)}


def test_without_faults_nothing_stands_around_the_beams() -> None:
    sampler = healthy()
    position_only = scenario({"kind": "position_silence", "start_s": 1.0}).faults
    assert with_beam_faults(sampler, position_only, np.random.default_rng(1)) is sampler


def test_a_fault_lasts_from_its_start_for_its_duration_and_no_longer() -> None:
    sampler = faulty({"kind": "beam_dropout", "beam": "front", "start_s": 1.0, "duration_s": 0.5})
    statuses = {t: at(sampler, t)["front"].status for t in (0.5, 0.95, 1.0, 1.45, 1.5, 2.0)}
    lost = [t for t, status in statuses.items() if status is RangeStatus.NO_SIGNAL]
    assert lost == [1.0, 1.45]


def test_a_fault_without_a_duration_stays() -> None:
    sampler = faulty({"kind": "beam_dropout", "beam": "front", "start_s": 1.0})
    assert at(sampler, 900.0)["front"].status is RangeStatus.NO_SIGNAL


def test_the_times_of_faults_count_from_when_the_simulation_began() -> None:
    sampler = faulty({"kind": "beam_dropout", "beam": "front", "start_s": 1.0}, since_s=3.0)
    assert at(sampler, 3.9)["front"].status is RangeStatus.VALID
    assert at(sampler, 4.0)["front"].status is RangeStatus.NO_SIGNAL


def test_a_dropped_out_beam_says_that_it_knows_nothing_and_the_others_are_untouched() -> None:
    spoilt = at(faulty({"kind": "beam_dropout", "beam": "front", "start_s": 0.0}), 2.0)
    truth = at(healthy(), 2.0)
    assert spoilt["front"].range_m == 0.0
    assert spoilt["front"].variance_m2 > 0.05
    assert {k: v for k, v in spoilt.items() if k != "front"} == {
        k: v for k, v in truth.items() if k != "front"
    }


def test_a_stuck_beam_repeats_its_last_measurement_with_new_stamps() -> None:
    sampler = faulty({"kind": "beam_stuck", "beam": "front", "start_s": 2.0, "duration_s": 2.0})
    before = at(sampler, 1.9)["front"]
    stuck = at(sampler, 3.0)["front"]
    assert stuck.range_m == before.range_m == pytest.approx(0.76)
    assert stuck.stamp_s == 3.0
    assert at(sampler, 4.0)["front"].range_m == pytest.approx(0.55)


def test_a_beam_that_is_stuck_from_the_start_keeps_its_first_measurement() -> None:
    sampler = faulty({"kind": "beam_stuck", "start_s": 0.0})
    assert at(sampler, 0.0)["front"].range_m == at(sampler, 5.0)["front"].range_m


def test_a_silent_beam_is_absent_and_all_silent_beams_are_nothing() -> None:
    one = at(faulty({"kind": "beam_silence", "beam": "left", "start_s": 0.0}), 1.0)
    assert set(one) == {"front", "right", "back", "up", "down"}
    assert at(faulty({"kind": "beam_silence", "start_s": 0.0}), 1.0) == {}


def test_a_noisy_beam_scatters_and_does_not_admit_it() -> None:
    sampler = faulty({"kind": "beam_noise", "beam": "down", "start_s": 0.0, "sigma_m": 0.05})
    readings = [at(sampler, k * 0.05)["down"] for k in range(2000)]
    valid = [r.range_m for r in readings if r.status is RangeStatus.VALID]
    assert np.std(valid) == pytest.approx(0.05, rel=0.1)
    assert {r.variance_m2 for r in readings} == {0.0}


def test_noise_beyond_the_limits_becomes_the_status_that_it_is() -> None:
    sampler = faulty({"kind": "beam_noise", "beam": "down", "start_s": 0.0, "sigma_m": 2.0})
    statuses = {at(sampler, k * 0.05)["down"].status for k in range(200)}
    expected = {RangeStatus.VALID, RangeStatus.TOO_NEAR, RangeStatus.OUT_OF_RANGE}
    assert statuses == expected


def test_noise_does_not_make_a_distance_of_what_is_none() -> None:
    sampler = faulty({"kind": "beam_noise", "start_s": 0.0, "sigma_m": 2.0})
    assert {at(sampler, k * 0.05)["up"].status for k in range(50)} == {RangeStatus.OUT_OF_RANGE}
    lost = faulty({"kind": "beam_dropout", "start_s": 0.0}, {"kind": "beam_noise", "start_s": 0.0})
    assert {at(lost, k * 0.05)["down"].range_m for k in range(50)} == {0.0}


def test_faults_that_overlap_all_act_in_their_order() -> None:
    sampler = faulty(
        {"kind": "beam_stuck", "beam": "front", "start_s": 1.0},
        {"kind": "beam_silence", "beam": "front", "start_s": 2.0, "duration_s": 1.0},
    )
    at(sampler, 0.0)
    assert at(sampler, 1.5)["front"].range_m == pytest.approx(0.95)
    assert "front" not in at(sampler, 2.5)
    assert at(sampler, 3.5)["front"].range_m == pytest.approx(0.95)


def test_a_fault_of_a_beam_that_is_not_there_is_refused() -> None:
    with pytest.raises(DocumentError, match=r"for beam 'frnt', which .* use one of front, right"):
        faulty({"kind": "beam_stuck", "beam": "frnt", "start_s": 0.0})


def estimate(stamp_s: float) -> LocalPosition:
    return LocalPosition(stamp_s, (stamp_s, 2.0, -1.0), (1.0, 0.0, 0.0))


def position_faults(*faults: dict[str, object]) -> PositionFaults:
    return PositionFaults(scenario(*faults).faults, np.random.default_rng(4), since_s=10.0)


def test_a_healthy_estimate_passes_untouched() -> None:
    passing = position_faults({"kind": "beam_silence", "start_s": 0.0})
    heard = estimate(10.5)
    assert passing.pass_on(heard) is heard


def test_a_silent_estimator_is_not_heard_for_as_long_as_it_lasts() -> None:
    passing = position_faults({"kind": "position_silence", "start_s": 1.0, "duration_s": 1.0})
    heard = {t: passing.pass_on(estimate(t)) for t in (10.9, 11.0, 11.9, 12.0)}
    assert [t for t, position in heard.items() if position is None] == [11.0, 11.9]


def test_a_stuck_estimator_repeats_itself_with_new_stamps() -> None:
    passing = position_faults({"kind": "position_stuck", "start_s": 1.0})
    passing.pass_on(estimate(10.9))
    stuck = passing.pass_on(estimate(12.0))
    assert stuck == LocalPosition(12.0, (10.9, 2.0, -1.0), (1.0, 0.0, 0.0))


def test_a_noisy_estimator_scatters_on_every_axis() -> None:
    passing = position_faults({"kind": "position_noise", "start_s": 0.0, "sigma_m": 0.2})
    heard = [passing.pass_on(estimate(10.0 + k)) for k in range(2000)]
    errors = [
        tuple(a - b for a, b in zip(p.position_ned_m, (p.stamp_s, 2.0, -1.0), strict=True))
        for p in heard
        if p is not None
    ]
    assert np.std(errors, axis=0) == pytest.approx((0.2, 0.2, 0.2), rel=0.1)
    assert all(math.isfinite(component) for error in errors for component in error)


def test_a_bias_moves_what_is_measured_and_no_more_than_the_beam_can_say() -> None:
    true_m = at(healthy(), 4.0)["front"].range_m
    for bias_m in (0.05, -0.05):
        spoilt = at(faulty({"kind": "beam_bias", "beam": "front", "bias_m": bias_m}), 4.0)["front"]
        assert spoilt.range_m == pytest.approx(true_m + bias_m)
    beyond = at(faulty({"kind": "beam_bias", "bias_m": 5.0}), 4.0)["front"]
    assert beyond.status is RangeStatus.OUT_OF_RANGE
    assert beyond.range_m == beyond.max_m
    nearer = at(faulty({"kind": "beam_bias", "bias_m": -5.0}), 4.0)["front"]
    assert nearer.status is RangeStatus.TOO_NEAR
    assert nearer.range_m == nearer.min_m


def test_cross_talk_reports_what_the_other_beam_measured_as_often_as_asked() -> None:
    crosstalk = {"kind": "beam_crosstalk", "beam": "back", "other": "front", "probability": 0.4}
    sampler, crossed, heard = faulty(crosstalk), 0, 0
    for i in range(500):
        readings = at(sampler, 1.0 + 0.01 * i)
        if "back" not in readings:
            continue
        heard += 1
        assert readings["back"].beam == "back"
        crossed += readings["back"].range_m == readings["front"].range_m
        assert readings["left"].status is RangeStatus.OUT_OF_RANGE
    assert crossed == pytest.approx(0.4 * heard, abs=0.15 * heard)


def test_cross_talk_from_a_beam_that_is_not_there_is_refused() -> None:
    with pytest.raises(DocumentError, match="beam_crosstalk is for beam 'nose'"):
        faulty({"kind": "beam_crosstalk", "other": "nose"})


# ---------------------------------------------------------------- GNSS

FIX = GnssFix(0.0, FixType.FIX_3D, 47.3977, 8.5456, 488.0, 0.5, 0.8, 12)
ORIGIN = (47.3977, 8.5456, 488.0)


def heard_ne_m(line: str, now_s: float, seed: int = 1) -> tuple[float, float]:
    """Where a fix of the origin seems to be."""
    faults = GnssFaults([parse_fault(line)], np.random.default_rng(seed), FaultClock())
    fix = faults.pass_on(now_s, FIX)
    assert fix is not None
    north, east, _ = ned_from_geodetic(fix.latitude_deg, fix.longitude_deg, fix.amsl_m, ORIGIN)
    return north, east


def test_fixes_jump_and_drift_by_metres() -> None:
    assert heard_ne_m("gnss_jump@2:north_m=5,east_m=-3", 1.0) == pytest.approx((0.0, 0.0))
    assert heard_ne_m("gnss_jump@2:north_m=5,east_m=-3", 2.0) == pytest.approx((5.0, -3.0))
    assert heard_ne_m("gnss_drift@2:north_m_s=0,east_m_s=0.2", 12.0) == pytest.approx((0.0, 2.0))


def test_noisy_fixes_are_as_noisy_as_asked() -> None:
    places = [heard_ne_m("gnss_noise:sigma_m=3", 1.0, seed) for seed in range(300)]
    assert np.std(places, axis=0) == pytest.approx((3.0, 3.0), rel=0.15)


def test_without_a_fix_the_receiver_says_so_and_says_nothing_where_it_said_nothing() -> None:
    faults = GnssFaults([parse_fault("gnss_loss")], np.random.default_rng(1), FaultClock())
    fix = faults.pass_on(1.0, FIX)
    assert fix is not None
    assert not fix.fix_type.has_position
    assert fix.satellites == 0
    assert faults.pass_on(1.0, None) is None
