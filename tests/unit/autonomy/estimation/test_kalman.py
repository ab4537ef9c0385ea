import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.estimation.kalman import Kalman
from hal.frames import ZERO3, Vector3

Q, GATE = 0.5, 5.0
SIGMA_P, SIGMA_V = 0.03, 0.05


def started(position: Vector3 = ZERO3, velocity: Vector3 = ZERO3) -> Kalman:
    kalman = Kalman(Q, GATE)
    kalman.start(position, velocity, SIGMA_P, SIGMA_V)
    return kalman


def assert_healthy(kalman: Kalman) -> None:
    p = kalman.covariance
    assert np.isfinite(p).all()
    assert p[0, 1] == p[1, 0]
    assert p[0, 0] > 0.0
    assert p[1, 1] > 0.0
    assert p[0, 0] * p[1, 1] - p[0, 1] * p[1, 0] > 0.0
    assert all(map(math.isfinite, kalman.position_ned_m + kalman.velocity_ned_m_s))


def test_it_begins_where_it_is_told() -> None:
    kalman = started((1.0, 2.0, -3.0), (0.1, 0.2, 0.3))
    assert kalman.position_ned_m == (1.0, 2.0, -3.0)
    assert kalman.velocity_ned_m_s == (0.1, 0.2, 0.3)
    assert kalman.position_sigma_m() == pytest.approx(SIGMA_P)


def test_prediction_moves_each_axis_by_its_velocity_and_grows_the_uncertainty() -> None:
    kalman = started((1.0, 2.0, -3.0), (0.1, 0.2, 0.3))
    kalman.predict(0.5)
    assert kalman.position_ned_m == pytest.approx((1.05, 2.1, -2.85))
    assert kalman.velocity_ned_m_s == (0.1, 0.2, 0.3)
    # F P F' + Q by hand.
    p00 = SIGMA_P**2 + 0.25 * SIGMA_V**2 + Q**2 * 0.5**4 / 4.0
    p01 = 0.5 * SIGMA_V**2 + Q**2 * 0.5**3 / 2.0
    p11 = SIGMA_V**2 + Q**2 * 0.25
    assert kalman.covariance == pytest.approx(np.array([[p00, p01], [p01, p11]]))


@pytest.mark.parametrize("dt_s", [0.0, 0.02, 0.3])
def test_the_sigma_ahead_is_that_of_a_prediction(dt_s: float) -> None:
    kalman = started()
    kalman.predict(0.1)
    ahead = kalman.position_sigma_m(dt_s)
    kalman.predict(dt_s)
    assert kalman.position_sigma_m() == pytest.approx(ahead)


@pytest.mark.parametrize("dt_s", [0.0, -0.1, math.nan])
def test_time_never_runs_back(dt_s: float) -> None:
    kalman = started((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    kalman.predict(dt_s)
    assert kalman.position_ned_m == (1.0, 0.0, 0.0)


def test_a_position_is_weighed_by_the_variances() -> None:
    kalman = started()
    tested = kalman.update_position((0.02, -0.04, 0.06), SIGMA_P)
    assert tested.fused
    assert kalman.position_ned_m == pytest.approx((0.01, -0.02, 0.03))
    assert kalman.position_sigma_m() == pytest.approx(SIGMA_P / math.sqrt(2.0))
    assert tested.test_ratio == pytest.approx(0.06**2 / (GATE**2 * 2.0 * SIGMA_P**2))


def test_a_velocity_is_weighed_by_the_variances() -> None:
    kalman = started()
    tested = kalman.update_velocity((0.02, -0.04, 0.06), SIGMA_V)
    assert tested.fused
    assert kalman.velocity_ned_m_s == pytest.approx((0.01, -0.02, 0.03))
    assert kalman.position_ned_m == ZERO3
    assert tested.test_ratio == pytest.approx(0.06**2 / (GATE**2 * 2.0 * SIGMA_V**2))


def test_both_at_once_are_the_same_as_one_after_the_other() -> None:
    batch, single = started(), started()
    for kalman in (batch, single):
        kalman.predict(0.1)
    batch.update((0.05, 0.0, -0.02), (0.1, 0.05, 0.0), SIGMA_P, SIGMA_V)
    single.update_position((0.05, 0.0, -0.02), SIGMA_P)
    single.update_velocity((0.1, 0.05, 0.0), SIGMA_V)
    assert batch.position_ned_m == pytest.approx(single.position_ned_m)
    assert batch.velocity_ned_m_s == pytest.approx(single.velocity_ned_m_s)
    assert batch.covariance == pytest.approx(single.covariance)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("sigmas", "fused"), [(4.99, True), (5.01, False), (-5.01, False)])
def test_the_gate_is_five_sigma_of_the_innovation_on_every_axis(
    sigmas: float, axis: int, *, fused: bool
) -> None:
    step = sigmas * math.sqrt(2.0) * SIGMA_P
    measured = (step * (axis == 0), step * (axis == 1), step * (axis == 2))
    kalman = started()
    tested = kalman.update_position(measured, SIGMA_P)
    assert tested.fused == fused
    assert tested.test_ratio == pytest.approx((sigmas / GATE) ** 2)
    assert (kalman.position_ned_m == ZERO3) == (not fused)


def test_position_and_velocity_have_their_own_gates() -> None:
    far, fast = (5.0, 0.0, 0.0), (5.0, 0.0, 0.0)
    kalman = started()
    position, velocity = kalman.update(far, (0.02, 0.0, 0.0), SIGMA_P, SIGMA_V)
    assert (position.fused, velocity.fused) == (False, True)
    assert kalman.position_ned_m == ZERO3
    assert kalman.velocity_ned_m_s == pytest.approx((0.01, 0.0, 0.0))
    kalman = started()
    position, velocity = kalman.update((0.02, 0.0, 0.0), fast, SIGMA_P, SIGMA_V)
    assert (position.fused, velocity.fused) == (True, False)
    assert kalman.position_ned_m == pytest.approx((0.01, 0.0, 0.0))
    assert kalman.velocity_ned_m_s == ZERO3
    kalman = started()
    position, velocity = kalman.update(far, fast, SIGMA_P, SIGMA_V)
    assert (position.fused, velocity.fused) == (False, False)
    assert kalman.covariance == pytest.approx(np.diag([SIGMA_P**2, SIGMA_V**2]))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_rejected(bad: float) -> None:
    kalman = started()
    for axis in range(3):
        values = [0.0, 0.0, 0.0]
        values[axis] = bad
        measured = (values[0], values[1], values[2])
        tests = [
            kalman.update_position(measured, SIGMA_P),
            kalman.update_velocity(measured, SIGMA_V),
            *kalman.update(measured, measured, SIGMA_P, SIGMA_V),
        ]
        assert [t.fused for t in tests] == [False] * 4
        assert [t.test_ratio for t in tests] == [math.inf] * 4
    assert not kalman.update_height(bad, 0.03).fused
    assert kalman.terrain_down_m is None
    assert_healthy(kalman)


def test_a_moved_frame_moves_position_and_surface_alone() -> None:
    kalman = started((0.0, 0.0, -1.0), (0.1, 0.0, 0.0))
    kalman.update_height(1.0, 0.03)
    before = kalman.covariance
    kalman.shift((1.0, -2.0, 0.5))
    assert kalman.position_ned_m == pytest.approx((1.0, -2.0, -0.5))
    assert kalman.terrain_down_m == pytest.approx(0.5)
    assert kalman.velocity_ned_m_s == (0.1, 0.0, 0.0)
    assert (kalman.covariance == before).all()


def test_heights_settle_the_surface_and_leave_the_vehicle() -> None:
    kalman = started((0.0, 0.0, -1.0))
    kalman.update_height(1.05, 0.03)
    for _ in range(50):
        kalman.predict(0.05)
        kalman.update_height(1.0, 0.03)
    assert kalman.terrain_down_m == pytest.approx(0.0, abs=0.01)
    assert kalman.position_ned_m == (0.0, 0.0, -1.0)


def test_a_step_of_the_height_is_rejected_until_it_is_accepted() -> None:
    kalman = started((0.0, 0.0, -1.0))
    kalman.update_height(1.0, 0.03)
    tested = kalman.update_height(0.3, 0.03)
    assert not tested.fused
    assert tested.test_ratio > 1.0
    assert kalman.terrain_down_m == pytest.approx(0.0)
    kalman.start_terrain(0.3, 0.03)
    assert kalman.terrain_down_m == pytest.approx(-0.7)
    assert kalman.update_height(0.3, 0.03).fused


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_height_that_is_no_number_leaves_a_known_surface_alone(bad: float) -> None:
    kalman = started((0.0, 0.0, -1.0))
    kalman.update_height(1.0, 0.03)
    tested = kalman.update_height(bad, 0.03)
    assert (tested.fused, tested.test_ratio) == (False, math.inf)
    kalman.start_terrain(bad, 0.03)
    assert kalman.terrain_down_m == 0.0


def test_heights_are_weighed_by_surface_height_and_altitude_variances() -> None:
    kalman = started((0.0, 0.0, -1.0))
    surface = SIGMA_P**2 + 0.04**2
    kalman.update_height(1.0, 0.04)
    expected = 0.0
    for _ in range(3):
        noise = SIGMA_P**2 + 0.04**2
        gain = surface / (surface + noise)
        tested = kalman.update_height(1.05, 0.04)
        assert tested.test_ratio == pytest.approx(
            (0.05 - expected) ** 2 / (GATE**2 * (surface + noise))
        )
        expected += gain * (0.05 - expected)
        surface *= 1.0 - gain
        assert kalman.terrain_down_m == pytest.approx(expected)


def test_the_surface_may_rise_slowly() -> None:
    kalman = started((0.0, 0.0, -1.0))
    for step in range(400):
        kalman.predict(0.05)
        kalman.update((0.0, 0.0, -1.0), ZERO3, SIGMA_P, SIGMA_V)
        assert kalman.update_height(1.0 - 0.0005 * step, 0.03).fused
    assert kalman.terrain_down_m == pytest.approx(-0.2, abs=0.08)


def test_ten_thousand_random_steps_keep_the_covariance_positive_definite() -> None:
    rng = np.random.default_rng(7)
    kalman = started()
    for _ in range(10_000):
        kalman.predict(float(10.0 ** rng.uniform(-6.0, 0.5)))
        n, e, d, vn, ve, vd = (float(v) for v in rng.normal(0.0, 1.0, 6))
        sigma = float(10.0 ** rng.uniform(-5.0, 2.0))
        kind = int(rng.integers(4))
        if kind == 0:
            kalman.update((n, e, d), (vn, ve, vd), sigma, sigma)
        elif kind == 1:
            kalman.update_position((n, e, d), sigma)
        elif kind == 2:
            kalman.update_velocity((vn, ve, vd), sigma)
        else:
            kalman.update_height(abs(d), sigma)
        assert_healthy(kalman)


updates = st.tuples(
    st.sampled_from(["predict", "both", "position", "velocity", "height", "shift"]),
    st.floats(allow_nan=True, allow_infinity=True, width=32),
    st.floats(-10.0, 10.0),
    st.floats(0.0, 10.0),
)


@settings(deadline=None, max_examples=150)
@given(st.lists(updates, max_size=60))
def test_no_sequence_of_measurements_makes_it_unhealthy(
    sequence: list[tuple[str, float, float, float]],
) -> None:
    kalman = started()
    for kind, wild, tame, positive in sequence:
        measured = (tame, wild, tame)
        if kind == "predict":
            kalman.predict(positive)
        elif kind == "both":
            kalman.update(measured, (tame, tame, wild), positive, positive)
        elif kind == "position":
            kalman.update_position(measured, positive)
        elif kind == "velocity":
            kalman.update_velocity(measured, positive)
        elif kind == "height":
            kalman.update_height(wild, positive)
        else:
            kalman.shift((tame, tame, tame))
        assert_healthy(kalman)


def test_it_is_consistent_with_the_noise_that_it_assumes() -> None:
    """Normalised estimation error squared: mean 2 (position and velocity), within chi-square."""
    rng = np.random.default_rng(11)
    dt_s, steps = 0.05, 4000
    truth_p, truth_v = np.zeros(3), np.zeros(3)
    kalman = started()
    nees = []
    for _ in range(steps):
        acceleration = rng.normal(0.0, Q, 3)
        truth_p = truth_p + truth_v * dt_s + 0.5 * acceleration * dt_s**2
        truth_v = truth_v + acceleration * dt_s
        kalman.predict(dt_s)
        z_p = truth_p + rng.normal(0.0, SIGMA_P, 3)
        z_v = truth_v + rng.normal(0.0, SIGMA_V, 3)
        position, velocity = kalman.update(
            (float(z_p[0]), float(z_p[1]), float(z_p[2])),
            (float(z_v[0]), float(z_v[1]), float(z_v[2])),
            SIGMA_P,
            SIGMA_V,
        )
        assert position.fused
        assert velocity.fused
        error = np.array([truth_p - kalman.position_ned_m, truth_v - kalman.velocity_ned_m_s])
        nees.append(float(np.sum(error * np.linalg.solve(kalman.covariance, error))) / 3.0)
    assert np.mean(nees) == pytest.approx(2.0, abs=0.15)
