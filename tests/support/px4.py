"""Measured facts of PX4 (tests/golden/px4), and an autopilot flown on its own time."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hal.sim.autopilot import Autopilot
from hal.sim.px4 import Mode, SystemStatus
from hal.sim.scenario import Scenario

_GOLDEN = Path(__file__).parents[1] / "golden" / "px4"


def facts() -> dict[str, Any]:
    """tests/golden/px4/facts.json."""
    loaded: dict[str, Any] = json.loads((_GOLDEN / "facts.json").read_text())
    return loaded


def steps() -> list[dict[str, Any]]:
    """The records of tests/golden/px4/steps.json."""
    loaded: list[dict[str, Any]] = json.loads((_GOLDEN / "steps.json").read_text())["records"]
    return loaded


def scenario(
    drag_per_mass_s: float = 1.0, start_yaw_deg: float = 0.0, **parameters: float
) -> Scenario:
    """An empty world with PX4's default parameters except those given."""
    return Scenario.model_validate(
        {
            "name": "empty",
            "start_yaw_deg": start_yaw_deg,
            "vehicle": {"drag_per_mass_s": drag_per_mass_s, "parameters": parameters},
        }
    )


class Flight:
    """An autopilot, what it said and when, flown in ticks of 10 ms."""

    tick_s = 0.01

    def __init__(
        self,
        drag_per_mass_s: float = 1.0,
        *,
        seed: int = 1,
        boot_s: float = 0.0,
        start_yaw_deg: float = 0.0,
        **parameters: float,
    ) -> None:
        self.pilot = Autopilot(
            scenario(drag_per_mass_s, start_yaw_deg, **parameters),
            np.random.default_rng(seed),
            boot_s=boot_s,
        )
        self.said: list[tuple[float, str]] = []

    @property
    def position(self) -> tuple[float, float, float]:
        return self.pilot.quadrotor.position_ned_m

    @property
    def height_m(self) -> float:
        return self.pilot.quadrotor.height_m

    def mode(self) -> Mode:
        """The mode that is flown now."""
        return self.pilot.mode

    def status(self) -> SystemStatus:
        """The heartbeat's system status now."""
        return self.pilot.system_status

    def in_failsafe(self) -> bool:
        """True while a failsafe flies."""
        return self.pilot.in_failsafe

    def texts(self) -> list[str]:
        """Everything said so far."""
        self._listen()
        return [text for _, text in self.said]

    def said_at(self, text: str) -> float:
        """When `text` was said last."""
        self._listen()
        return [at for at, said in self.said if said == text][-1]

    def _listen(self) -> None:
        while self.pilot.texts:
            text = self.pilot.texts.popleft()
            self.said.append((text.at_s, text.text))

    def fly(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        """Let time pass; `each` is called every 50 ms."""
        for tick in range(round(seconds / self.tick_s)):
            if each is not None and tick % 5 == 0:
                each()
            self.pilot.step(self.tick_s)
            self._listen()

    def until(self, condition: Callable[[], bool], limit_s: float = 60.0) -> float:
        """Let time pass until `condition`; how long it took. AssertionError after `limit_s`."""
        start_s = self.pilot.now_s
        while not condition():
            assert self.pilot.now_s - start_s < limit_s, "it never happened"
            self.pilot.step(self.tick_s)
            self._listen()
        return self.pilot.now_s - start_s

    def take_off(self) -> None:
        """Arm, take off, wait for Hold at height."""
        assert self.pilot.arm() == 0
        assert self.pilot.takeoff() == 0
        self.fly(12.0)
        assert self.pilot.mode is Mode.HOLD

    def velocity(self, north: float, east: float = 0.0, down: float = 0.0) -> Callable[[], None]:
        """A sender of that velocity setpoint."""
        return lambda: self.pilot.set_setpoint(
            velocity_ned_m_s=(north, east, down), yaw_rate_rad_s=0.0
        )

    def offboard(self, north: float, seconds: float) -> None:
        """Fly north in OFFBOARD for some seconds."""
        send = self.velocity(north)
        send()
        assert self.pilot.set_mode(Mode.OFFBOARD.main) == 0
        self.fly(seconds, send)
