import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.estimation.kalman import ACCELERATION_HOLDS_S, Kalman, Matrix, moved
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
    assert (p == p.T).all()
    # Scaled to a unit diagonal, because variances may lie ten decades apart.
    scale = np.sqrt(np.diag(p))
    assert (scale > 0.0).all()
    assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > -1e-9
    assert kalman.why_unhealthy() == ""
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
    q = Q**2 * ACCELERATION_HOLDS_S
    p00 = SIGMA_P**2 + 0.5**2 * SIGMA_V**2 + q * 0.5**3 / 3.0
    p01 = 0.5 * SIGMA_V**2 + q * 0.5**2 / 2.0
    p11 = SIGMA_V**2 + q * 0.5
    assert kalman.covariance[:2, :2] == pytest.approx(np.array([[p00, p01], [p01, p11]]))


@settings(deadline=None, max_examples=30)
@given(st.floats(0.0, 2.0), st.floats(0.0, 2.0))
def test_a_prediction_in_two_parts_is_the_whole(first_s: float, second_s: float) -> None:
    """Else a measurement in between, were it only rejected, would change the state."""
    whole, parts = (
        started((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
        started((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
    )
    for kalman in (whole, parts):
        kalman.update_gnss((5.0, 5.0), 2.0)
    whole.predict(first_s + second_s)
    parts.predict(first_s)
    parts.predict(second_s)
    assert parts.position_ned_m == pytest.approx(whole.position_ned_m)
    assert parts.covariance == pytest.approx(whole.covariance, abs=1e-12)


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


def test_position_and_velocity_are_weighed_by_the_variances() -> None:
    kalman = started()
    position, velocity = kalman.update((0.02, -0.04, 0.06), (0.01, 0.0, -0.02), SIGMA_P, SIGMA_V)
    assert position.fused
    assert velocity.fused
    assert kalman.position_ned_m == pytest.approx((0.01, -0.02, 0.03))
    assert kalman.velocity_ned_m_s == pytest.approx((0.005, 0.0, -0.01))
    assert kalman.position_sigma_m() == pytest.approx(SIGMA_P / math.sqrt(2.0))
    assert position.test_ratio == pytest.approx(0.06**2 / (GATE**2 * 2.0 * SIGMA_P**2))
    assert position.nis == pytest.approx((0.02**2 + 0.04**2 + 0.06**2) / (2.0 * SIGMA_P**2))
    assert velocity.nis == pytest.approx((0.01**2 + 0.02**2) / (2.0 * SIGMA_V**2))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("sigmas", "fused"), [(4.99, True), (5.01, False), (-5.01, False)])
def test_the_gate_is_five_sigma_of_the_innovation_on_every_axis(
    sigmas: float, axis: int, *, fused: bool
) -> None:
    step = sigmas * math.sqrt(2.0) * SIGMA_P
    measured = (step * (axis == 0), step * (axis == 1), step * (axis == 2))
    kalman = started()
    tested, _ = kalman.update(measured, ZERO3, SIGMA_P, SIGMA_V)
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
    assert kalman.covariance[:2, :2] == pytest.approx(np.diag([SIGMA_P**2, SIGMA_V**2]))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_rejected(bad: float) -> None:
    kalman = started()
    kalman.update_gnss((1.0, 2.0), 1.0)
    for axis in range(3):
        values = [0.0, 0.0, 0.0]
        values[axis] = bad
        measured = (values[0], values[1], values[2])
        tests = [*kalman.update(measured, measured, SIGMA_P, SIGMA_V)]
        if axis < 2:
            tests += [kalman.update_gnss(measured[:2], 1.0), kalman.start_bias(measured[:2], 1.0)]
        assert not any(t.fused for t in tests)
        assert all(t.test_ratio == math.inf for t in tests)
    assert kalman.bias_ne_m == (1.0, 2.0)
    assert_healthy(kalman)


# ---------------------------------------------------------------- the bias of GNSS


def test_the_first_gnss_position_is_the_bias() -> None:
    assert started().bias_ne_m is None
    kalman = started((1.0, 2.0, -3.0))
    tested = kalman.update_gnss((11.0, -8.0), 2.0)
    assert tested == (0.0, True, 0.0)
    assert kalman.bias_ne_m == (10.0, -10.0)
    assert kalman.bias_sigma_m == pytest.approx(math.hypot(2.0, SIGMA_P))
    assert kalman.position_ned_m == (1.0, 2.0, -3.0)
    assert kalman.position_sigma_m() == pytest.approx(SIGMA_P)
    assert_healthy(kalman)


def test_a_bias_that_begins_is_the_limit_of_knowing_nothing_of_it() -> None:
    """The joint Gaussian with a bias of variance 1e8 before the measurement, by textbook."""
    kalman = started((1.0, 2.0, 0.0))
    kalman.predict(0.3)
    prior = kalman.covariance
    prior[2, :] = prior[:, 2] = 0.0
    prior[2, 2] = 1e8
    h = np.array([[1.0, 0.0, 1.0]])
    gain = prior @ h.T / (h @ prior @ h.T + 4.0)
    kalman.update_gnss((3.0, 3.0), 2.0)
    assert kalman.covariance == pytest.approx((np.eye(3) - gain @ h) @ prior, abs=1e-6)


def test_gnss_that_stays_where_it_was_makes_the_bias_certain_and_moves_nothing() -> None:
    kalman = started((1.0, 2.0, -3.0))
    for _ in range(50):
        assert kalman.update_gnss((11.0, -8.0), 2.0).fused
        kalman.predict(0.1)
        kalman.update((1.0, 2.0, -3.0), ZERO3, SIGMA_P, SIGMA_V)
    assert kalman.bias_ne_m == pytest.approx((10.0, -10.0))
    assert kalman.position_ned_m == pytest.approx((1.0, 2.0, -3.0))
    assert kalman.bias_sigma_m < 0.5


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("sigmas", "fused"), [(4.99, True), (5.01, False), (-5.01, False)])
def test_gnss_has_the_gate_too(sigmas: float, axis: int, *, fused: bool) -> None:
    kalman = started()
    kalman.update_gnss((0.0, 0.0), 1.0)
    # The error of the first fix is in the bias; that of the position is in both and cancels.
    step = sigmas * math.sqrt(2.0)
    tested = kalman.update_gnss((step * (axis == 0), step * (axis == 1)), 1.0)
    assert tested.fused == fused
    assert tested.test_ratio == pytest.approx((sigmas / GATE) ** 2)
    assert tested.nis == pytest.approx(sigmas**2)
    assert kalman.position_ned_m == pytest.approx(ZERO3, abs=1e-9)


def test_what_gnss_measures_of_one_axis_is_none_of_the_others() -> None:
    kalman = started((1.0, 2.0, -3.0), (0.1, 0.0, 0.2))
    kalman.update_gnss((0.0, 0.0), 1.0)
    kalman.predict(0.5)
    before = kalman.position_ned_m
    assert kalman.update_gnss((1.5, 0.0), 1.0).fused
    assert kalman.position_ned_m[0] > before[0]
    assert kalman.position_ned_m[1:] == pytest.approx(before[1:], abs=1e-12)


def test_after_a_restart_of_the_position_the_bias_is_still_known() -> None:
    kalman = started((1.0, 2.0, -3.0))
    kalman.update_gnss((11.0, -8.0), 2.0)
    kalman.start((1.5, 2.0, -3.0), ZERO3, SIGMA_P, SIGMA_V)
    assert kalman.bias_ne_m == (10.0, -10.0)
    assert kalman.covariance[0, 2] == 0.0
    kalman.forget_bias()
    kalman.start((1.5, 2.0, -3.0), ZERO3, SIGMA_P, SIGMA_V)
    assert kalman.bias_ne_m is None


def test_a_moved_frame_moves_the_position_and_leaves_gnss_where_it_is() -> None:
    kalman = started((0.0, 0.0, -1.0), (0.1, 0.0, 0.0))
    kalman.update_gnss((10.0, 10.0), 2.0)
    before = kalman.covariance
    kalman.restore(moved(kalman.snapshot(), (1.0, -2.0, 0.5)))
    assert kalman.position_ned_m == pytest.approx((1.0, -2.0, -0.5))
    assert kalman.bias_ne_m == pytest.approx((9.0, 12.0))
    assert kalman.velocity_ned_m_s == (0.1, 0.0, 0.0)
    assert (kalman.covariance == before).all()


# ---------------------------------------------------------------- health


def test_a_snapshot_is_not_touched_by_what_comes_after_it() -> None:
    kalman = started((1.0, 2.0, -3.0), (0.1, 0.2, 0.3))
    kalman.update_gnss((0.0, 0.0), 1.0)
    then = kalman.snapshot()
    x, p = then.x.copy(), then.p.copy()
    kalman.predict(1.0)
    kalman.update((1.2, 2.0, -3.0), ZERO3, SIGMA_P, SIGMA_V)
    kalman.update_gnss((0.1, 0.0), 1.0)
    kalman.start_bias((5.0, 0.0), 1.0)
    assert (then.x == x).all()
    assert (then.p == p).all()
    kalman.restore(then)
    assert kalman.position_ned_m == (1.0, 2.0, -3.0)
    assert (kalman.covariance == p).all()


@pytest.mark.parametrize(
    ("covariance", "why"),
    [
        (np.diag([1.0, math.nan, 1.0]), "its numbers ran over"),
        (np.diag([1.0, math.inf, 1.0]), "its numbers ran over"),
        (np.diag([0.0, 1.0, 1.0]), "its covariance is no longer positive"),
        (np.diag([1.0, -1.0, 1.0]), "its covariance is no longer positive"),
        (np.array([[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]]), "its covariance is no longer"),
        (np.diag([1.0, 1.0, -1.0]), "its covariance is no longer positive"),
        (np.diag([1e8, 1.0, 1.0]), "its position is uncertain to 10000 m"),
    ],
)
def test_a_filter_that_cannot_be_believed_says_why(covariance: Matrix, why: str) -> None:
    kalman = started()
    assert kalman.why_unhealthy() == ""
    kalman.restore(kalman.snapshot()._replace(p=covariance))
    assert why in kalman.why_unhealthy()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("row", [0, 1, 2])
def test_a_state_that_is_no_number_is_noticed(bad: float, row: int) -> None:
    kalman = started()
    x = kalman.snapshot().x.copy()
    x[row, 1] = bad
    kalman.restore(kalman.snapshot()._replace(x=x))
    assert kalman.why_unhealthy() == "its numbers ran over"


def test_ten_thousand_random_steps_keep_the_covariance_positive_definite() -> None:
    rng = np.random.default_rng(7)
    kalman = started()
    for _ in range(10_000):
        kalman.predict(float(10.0 ** rng.uniform(-6.0, 0.5)))
        n, e, d, vn, ve, vd = (float(v) for v in rng.normal(0.0, 1.0, 6))
        sigma = float(10.0 ** rng.uniform(-5.0, 2.0))
        if rng.integers(3):
            kalman.update((n, e, d), (vn, ve, vd), sigma, sigma)
        else:
            kalman.update_gnss((n, e), sigma)
    assert_healthy(kalman)


updates = st.tuples(
    st.sampled_from(["predict", "local", "gnss", "bias", "start"]),
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
        elif kind == "local":
            kalman.update(measured, (tame, tame, wild), positive, positive)
        elif kind == "gnss":
            kalman.update_gnss((tame, wild), positive)
        elif kind == "bias":
            kalman.start_bias((wild, tame), positive)
        else:
            kalman.start((tame, tame, tame), ZERO3, 0.01 + positive, 0.01 + positive)
        assert_healthy(kalman)
