"""The worst vehicle that the guard's numbers allow: late, and weak in braking, quick in all else.

PX4's control as the guard takes it to be: setpoints come late, the position loop adds its gain
times the position's error, and the velocity follows after a dead time: at once when it grows, with
a weak deceleration when it falls.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from hal.frames import Vector3
from hal.setpoints import Setpoint

STEP_S = 0.025
OFFBOARD_LOSS_S = 1.12
"""COM_OF_LOSS_T and what PX4 was measured to take beyond it."""
TO_REST_S = 2.5


@dataclass(frozen=True)
class Make:
    """What distinguishes vehicles. `link_s + dead_s` and a tick are the guard's `reaction_s`."""

    link_s: float
    dead_s: float
    braking_m_s2: float
    gain_per_s: float
    height_gain_per_s: float = 1.0


TYPICAL = Make(link_s=0.05, dead_s=0.2, braking_m_s2=0.5, gain_per_s=0.95)


class WorstVehicle:
    """Its true position and velocity; it believes to be `error` (north, east) beside it."""

    def __init__(self, make: Make, position: Vector3) -> None:
        self.make = make
        self.position = position
        self.velocity: Vector3 = (0.0, 0.0, 0.0)
        self.error: tuple[float, float] = (0.0, 0.0)
        hold = (position, (0.0, 0.0, 0.0))
        self._sent = hold
        self._wire = deque([hold] * (round(make.link_s / STEP_S) + 1))
        self._commands = deque([(0.0, 0.0, 0.0)] * (round(make.dead_s / STEP_S) + 1))

    @property
    def estimate(self) -> Vector3:
        """Where it believes to be."""
        n, e, d = self.position
        return (n + self.error[0], e + self.error[1], d)

    def send(self, setpoint: Setpoint) -> None:
        """The newest setpoint."""
        self._sent = (setpoint.position_ned_m, setpoint.velocity_ned_m_s)

    def step(self) -> None:
        """One STEP_S."""
        make = self.make
        self._wire.append(self._sent)
        self._wire.popleft()
        place, velocity = self._wire[0]
        n, e, d = self.estimate
        self._commands.append(
            (
                velocity[0] + make.gain_per_s * (place[0] - n),
                velocity[1] + make.gain_per_s * (place[1] - e),
                velocity[2] + make.height_gain_per_s * (place[2] - d),
            )
        )
        self._commands.popleft()
        command = self._commands[0]
        vn, ve = self._follow(command[0], command[1])
        self.velocity = (vn, ve, command[2])
        n, e, d = self.position
        self.position = (n + vn * STEP_S, e + ve * STEP_S, d + command[2] * STEP_S)

    def _follow(self, north: float, east: float) -> tuple[float, float]:
        """The velocity after one step: what there is too much of falls slowly, the rest is there.

        Along the present motion the command may be smaller: that is braking. It is never faster
        than it was, or than it is told to be.
        """
        vn, ve = self.velocity[0], self.velocity[1]
        speed = math.hypot(vn, ve)
        if speed < 1e-9:
            return north, east
        un, ue = vn / speed, ve / speed
        along = max(north * un + east * ue, speed - self.make.braking_m_s2 * STEP_S)
        across = east * un - north * ue
        most = max(speed, math.hypot(north, east)) / max(math.hypot(along, across), 1e-9)
        along, across = along * min(1.0, most), across * min(1.0, most)
        return along * un - across * ue, along * ue + across * un

    def twin(self) -> "WorstVehicle":
        """Another in the same state, which flies on by itself."""
        twin = WorstVehicle(self.make, self.position)
        twin.velocity, twin.error, twin._sent = self.velocity, self.error, self._sent
        twin._wire, twin._commands = self._wire.copy(), self._commands.copy()
        return twin

    def fly_blind(self) -> Iterator[None]:
        """Nothing is sent any more: PX4 flies on by the last setpoint, and holds then."""
        for _ in range(round(OFFBOARD_LOSS_S / STEP_S)):
            self.step()
            yield
        self._sent = (self.estimate, (0.0, 0.0, 0.0))
        for _ in range(round(TO_REST_S / STEP_S)):
            self.step()
            yield
