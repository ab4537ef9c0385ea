"""One PID loop, as the outer loops of the paper's Table 3 need it. Pure state, no clock.

The bounds of Table 3 are those of the gain models in `autonomy/config.py`.
"""

import math

from autonomy.config import PidGains


class Pid:
    """u = kp e + ki integral(e) - kd d(measurement)/dt, limited to +-output_limit.

    Derivative on the measurement: a step of the setpoint gives no kick. Anti-windup by conditional
    integration: while the output is at its limit, only what leads away from the limit is
    integrated; and the integral part alone never exceeds the limit.
    """

    def __init__(self, gains: PidGains, output_limit: float) -> None:
        """Raises ValueError unless `output_limit` (unit of the output) is finite and positive."""
        if not 0.0 < output_limit < math.inf:
            raise ValueError(f"the output limit must be a positive number, not {output_limit}")
        self._kp, self._ki, self._kd = gains.kp, gains.ki, gains.kd
        self._limit = output_limit
        self._integral_part = 0.0
        self._last_measurement: float | None = None

    def reset(self) -> None:
        """Forget the past: no integral, no derivative at the next step."""
        self._integral_part = 0.0
        self._last_measurement = None

    def step(self, setpoint: float, measurement: float, dt_s: float) -> float:
        """The output for one step of `dt_s` seconds since the step before.

        With `dt_s` = 0 nothing is integrated or differentiated. Raises ValueError for a negative
        `dt_s` or anything that is not a number; the state is then unchanged.
        """
        if not (math.isfinite(setpoint) and math.isfinite(measurement) and 0.0 <= dt_s < math.inf):
            raise ValueError(
                f"a PID step needs numbers and dt >= 0: {setpoint}, {measurement}, {dt_s}"
            )
        error = setpoint - measurement
        direct = self._kp * error - self._kd * self._rate(measurement, dt_s)
        added = self._ki * error * dt_s
        integral_part = self._clamp(self._integral_part + added)
        if abs(direct + integral_part) <= self._limit or (direct + integral_part) * added < 0.0:
            self._integral_part = integral_part
        return self._clamp(direct + self._integral_part)

    def _rate(self, measurement: float, dt_s: float) -> float:
        """d(measurement)/dt; 0 at the first step."""
        last = self._last_measurement
        if last is None:
            self._last_measurement = measurement
            return 0.0
        if dt_s == 0.0:
            return 0.0
        self._last_measurement = measurement
        return (measurement - last) / dt_s

    def _clamp(self, value: float) -> float:
        return min(self._limit, max(-self._limit, value))
