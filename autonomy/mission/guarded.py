"""The pilot with the guard below it: the one pure step that flies, simulates and replays alike.

Nothing else turns a decision into a setpoint for the wire.
"""

from typing import Protocol

import msgspec

from autonomy.config import Config
from autonomy.mission.pilot import Pilot
from autonomy.mission.sensing import Sensing
from autonomy.model import Command, Decision, FusedState, GuardReport, Inputs, Resumed
from hal.frames import Vector3, add
from hal.interfaces import SeenSpace
from hal.setpoints import Setpoint
from hal.vehicle.guard import BeamSight, Guard, Sight

__all__ = ["Command", "Decider", "Guarded", "GuardedPilot"]


class Decider(Protocol):
    """What may fly below the guard: it senses for itself, and decides a setpoint every tick."""

    @property
    def sensing(self) -> Sensing:
        """Newest readings, map and frame."""

    @property
    def space(self) -> SeenSpace:
        """What was seen to be free."""

    @property
    def goal(self) -> Vector3:
        """The goal being flown to, in the mission frame."""

    def step(self, inputs: Inputs) -> Decision:
        """Decide everything for this tick."""

    def sent(self, setpoint: Setpoint | None) -> None:
        """What the guard let pass of the last decision's setpoint, in the mission frame."""


class Guarded:
    """`step(inputs) -> Command`, deterministic; the guard sees every setpoint."""

    def __init__(self, decider: Decider, config: Config) -> None:
        self._decider = decider
        self._guard = Guard(config.guard)
        self._mounts = {mount.name: mount for mount in config.beams.mounts}
        self._stale_after_s = config.beams.stale_after_s
        self._last_report = GuardReport()

    @property
    def goal(self) -> Vector3:
        """The goal being flown to, in the mission frame."""
        return self._decider.goal

    def step(self, inputs: Inputs) -> Command:
        """One tick: decide, then guard. `inputs.guard` is filled with the last verdict."""
        decision = self._decider.step(msgspec.structs.replace(inputs, guard=self._last_report))
        if decision.setpoint is None or decision.fused is None:
            self._last_report = GuardReport()
            self._decider.sent(None)
            return Command(decision, None, None, self._last_report)
        verdict = self._guard.check(decision.setpoint, self._sight(decision.fused, inputs.now_s))
        self._last_report = GuardReport(
            verdict.limits, verdict.speed_limit_m_s, verdict.free_distance_m
        )
        setpoint = verdict.setpoint
        self._decider.sent(setpoint)
        home = self._decider.sensing.home_ned_m
        wire = msgspec.structs.replace(setpoint, position_ned_m=add(setpoint.position_ned_m, home))
        return Command(decision, setpoint, wire, self._last_report)

    def _sight(self, fused: FusedState, now_s: float) -> Sight:
        """What the guard may know: the state, the newest beams, the seen-free space."""
        return Sight(
            now_s=now_s,
            fused_stamp_s=fused.stamp_s,
            position_ned_m=fused.position_ned_m,
            velocity_ned_m_s=fused.velocity_ned_m_s,
            yaw_rad=fused.yaw_rad,
            position_sigma_m=fused.position_sigma_m,
            position_ok=fused.ok,
            beams=tuple(
                BeamSight(self._mounts[name], reading)
                for name, reading in self._decider.sensing.newest.items()
                if name in self._mounts and now_s - reading.stamp_s <= self._stale_after_s
            ),
            space=self._decider.space,
        )


class GuardedPilot(Guarded):
    """The pilot of every flight of the service."""

    def __init__(
        self, config: Config, route: tuple[Vector3, ...], resumed: Resumed | None = None
    ) -> None:
        self.pilot = Pilot(config, route, resumed)
        super().__init__(self.pilot, config)
