"""PX4's horizontal velocity loop on one axis, as fitted to measured steps and stops.

Measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11: velocity gains P 1.8, I 0.4, D 0.2, thrust
lag 0.26 s, dead time 0.03 s (4 % rms of the step); drag 1.0 /s (the simulator's default) or 0.2 /s
(nearer to a real small quadrotor). The position controller adds 0.95 /s times the position error.
"""

from collections import deque

STEP_S = 0.005
TICK_S = 0.05
LINK_S = 0.02


class Px4Axis:
    """One horizontal axis at rest at 0; `send` a setpoint, `fly` for a tick."""

    def __init__(self, drag_per_s: float) -> None:
        self._drag = drag_per_s
        self.position_m = 0.0
        self.velocity_m_s = 0.0
        self._thrust = 0.0
        self._integral = 0.0
        delay = round((LINK_S + 0.03) / STEP_S)
        self._wire = deque([(0.0, 0.0)] * (delay + 1), maxlen=delay + 1)
        self._sent = (0.0, 0.0)

    def send(self, position_m: float, velocity_m_s: float) -> None:
        """The newest setpoint."""
        self._sent = (position_m, velocity_m_s)

    def fly(self, duration_s: float = TICK_S) -> None:
        """Integrate with the newest setpoint, delayed by the link and the dead time."""
        for _ in range(round(duration_s / STEP_S)):
            self._wire.append(self._sent)
            position_sp, velocity_sp = self._wire[0]
            error = velocity_sp + 0.95 * (position_sp - self.position_m) - self.velocity_m_s
            acceleration = self._thrust - self._drag * self.velocity_m_s
            command = 1.8 * error + self._integral - 0.2 * acceleration
            self._integral += 0.4 * error * STEP_S
            self._thrust += (command - self._thrust) / 0.26 * STEP_S
            self.velocity_m_s += acceleration * STEP_S
            self.position_m += self.velocity_m_s * STEP_S

    def cruise(self, speed_m_s: float, duration_s: float) -> None:
        """Fly on at a speed for long: the integrator has learned the drag."""
        for _ in range(round(duration_s / TICK_S)):
            self.send(self.position_m, speed_m_s)
            self.fly()
