"""PX4's simulated battery."""

from hal.sim.px4 import Parameters


class SimulatedBattery:
    """Full when disarmed; armed it drains down to SIM_BAT_MIN_PCT, all of it in SIM_BAT_DRAIN s."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._level = 1.0
        self.override: float | None = None
        """0..1 told instead of the simulated level."""

    @property
    def remaining(self) -> float:
        """0..1."""
        return self._level if self.override is None else self.override

    def step(self, dt_s: float, *, armed: bool) -> None:
        """Let `dt_s` seconds pass."""
        if not armed:
            self._level = 1.0
            return
        least = 0.01 * float(self._parameters["SIM_BAT_MIN_PCT"])
        drain_s = max(float(self._parameters["SIM_BAT_DRAIN"]), 1.0)
        self._level = max(min(least, self._level), self._level - dt_s / drain_s)
