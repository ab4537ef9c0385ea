import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from autonomy.config import AltitudeGains, PidGains, PositionGains, VelocityGains
from autonomy.guidance.pid import Pid


def gains(kp: float = 0.0, ki: float = 0.0, kd: float = 0.0) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd)


def test_the_proportional_part_follows_the_error() -> None:
    assert Pid(gains(kp=2.0), 10.0).step(3.0, 1.0, 0.05) == 4.0
    assert Pid(gains(kp=2.0), 10.0).step(1.0, 3.0, 0.05) == -4.0


def test_the_integral_part_sums_the_error_over_time() -> None:
    pid = Pid(gains(ki=0.5), 10.0)
    outputs = [pid.step(2.0, 0.0, 0.1) for _ in range(3)]
    assert outputs == pytest.approx([0.1, 0.2, 0.3])


def test_the_derivative_part_opposes_a_moving_measurement() -> None:
    pid = Pid(gains(kd=0.5), 10.0)
    assert pid.step(0.0, 1.0, 0.1) == 0.0
    assert pid.step(0.0, 1.2, 0.1) == pytest.approx(-1.0)
    assert pid.step(0.0, 1.1, 0.1) == pytest.approx(0.5)


def test_a_step_of_the_setpoint_gives_no_derivative_kick() -> None:
    pid = Pid(gains(kd=5.0), 10.0)
    pid.step(0.0, 1.0, 0.1)
    assert pid.step(100.0, 1.0, 0.1) == 0.0


@pytest.mark.parametrize("setpoint", [100.0, -100.0])
def test_the_output_stops_at_its_limit(setpoint: float) -> None:
    assert Pid(gains(kp=1.0), 0.5).step(setpoint, 0.0, 0.1) == math.copysign(0.5, setpoint)


def test_a_long_saturation_does_not_wind_the_integral_up() -> None:
    pid = Pid(gains(kp=1.0, ki=1.0), 0.5)
    for _ in range(1000):
        assert pid.step(10.0, 0.0, 0.1) == 0.5
    # The error turns: the output must leave the limit at once, not after 1000 steps.
    assert pid.step(-0.2, 0.0, 0.1) < 0.0


def test_the_integral_alone_never_exceeds_the_limit() -> None:
    pid = Pid(gains(ki=1.0), 0.5)
    for _ in range(100):
        pid.step(1.0, 0.0, 0.1)
    assert pid.step(-1.0, 0.0, 0.1) == pytest.approx(0.4)


def test_the_integral_is_bounded_while_another_part_holds_the_output_down() -> None:
    pid = Pid(gains(ki=1.0, kd=1.0), 0.5)
    for step in range(100):
        # A measurement that climbs 1 /s: the derivative part is -1 against a growing integral.
        pid.step(step * 0.1 + 1.0, step * 0.1, 0.1)
    assert pid.step(9.9, 9.9, 0.0) == 0.5
    assert pid.step(9.4, 9.9, 1.0) == pytest.approx(0.0)


def test_in_saturation_the_integral_may_still_lead_away_from_the_limit() -> None:
    pid = Pid(gains(kp=0.0, ki=1.0, kd=1.0), 1.0)
    pid.step(1.0, 0.0, 0.5)
    # The derivative saturates the output low; the positive error goes on integrating.
    assert pid.step(2.0, 1.0, 0.1) == -1.0
    assert pid.step(2.0, 1.0, 0.0) == pytest.approx(0.5 + 0.1)


def test_an_integrator_plant_with_a_constant_disturbance_reaches_its_setpoint() -> None:
    pid = Pid(gains(kp=1.0, ki=0.3), 2.0)
    height = 0.0
    for _ in range(2000):
        height += (pid.step(1.0, height, 0.05) - 0.2) * 0.05
    assert height == pytest.approx(1.0, abs=1e-6)


def test_reset_forgets_integral_and_derivative() -> None:
    pid = Pid(gains(kp=1.0, ki=1.0, kd=1.0), 10.0)
    fresh = pid.step(1.0, 0.3, 0.1)
    pid.step(1.0, 0.7, 0.1)
    pid.reset()
    assert pid.step(1.0, 0.3, 0.1) == fresh


def test_a_step_without_time_uses_what_is_known() -> None:
    pid = Pid(gains(kp=1.0, ki=1.0, kd=1.0), 10.0)
    pid.step(1.0, 0.0, 0.5)
    assert pid.step(1.0, 0.2, 0.0) == pytest.approx(0.8 + 0.5)
    # The derivative is counted from the last measurement that took time.
    assert pid.step(0.2, 0.2, 0.5) == pytest.approx(0.5 - 0.4)


@pytest.mark.parametrize(
    ("setpoint", "measurement", "dt_s"),
    [(math.nan, 0.0, 0.1), (0.0, math.inf, 0.1), (0.0, 0.0, math.nan), (0.0, 0.0, -0.1)],
)
def test_what_is_no_number_is_refused_and_changes_nothing(
    setpoint: float, measurement: float, dt_s: float
) -> None:
    pid, twin = (Pid(gains(1.0, 1.0, 1.0), 5.0) for _ in range(2))
    pid.step(1.0, 0.0, 0.1)
    twin.step(1.0, 0.0, 0.1)
    with pytest.raises(ValueError, match="PID"):
        pid.step(setpoint, measurement, dt_s)
    assert pid.step(1.0, 0.2, 0.1) == twin.step(1.0, 0.2, 0.1)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_must_be_a_positive_number(limit: float) -> None:
    with pytest.raises(ValueError, match="output limit"):
        Pid(gains(1.0), limit)


@settings(deadline=None, max_examples=100)
@given(
    st.tuples(*[st.floats(0.0, 10.0)] * 3),
    st.floats(0.01, 5.0),
    st.lists(
        st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0.0, 1.0)), max_size=40
    ),
)
def test_every_output_is_a_number_within_the_limit(
    k: tuple[float, float, float], limit: float, steps: list[tuple[float, float, float]]
) -> None:
    pid, twin = (Pid(gains(*k), limit) for _ in range(2))
    for step in steps:
        output = pid.step(*step)
        assert abs(output) <= limit
        assert output == twin.step(*step)


def test_table_3_bounds_every_gain() -> None:
    bounds: dict[type[PidGains], tuple[float, float, float]] = {
        PositionGains: (100.0, 1.0, 10.0),
        AltitudeGains: (10.0, 1.0, 10.0),
        VelocityGains: (10.0, 1.0, 10.0),
    }
    for (model, highest), (index, name) in itertools.product(
        bounds.items(), enumerate(("kp", "ki", "kd"))
    ):
        assert getattr(model.model_validate({name: highest[index]}), name) == highest[index]
        for outside in (highest[index] * 1.001, -0.001):
            with pytest.raises(ValidationError):
                model.model_validate({name: outside})
