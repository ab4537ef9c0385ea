"""What goes wrong with the vehicle itself, done to a simulated autopilot when it is time.

The same for the vehicle in process and for the mock PX4: both let `VehicleFaults.step` run before
each step of their autopilot, and `EstimateFaults` spoil what its estimator is off by.
"""

import math
from collections.abc import Iterable

from hal.frames import ZERO3, Vector3, add
from hal.sim.autopilot import Autopilot
from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import (
    ArmingRefused,
    Battery,
    EkfReset,
    FaultWindow,
    GnssLoss,
    OffboardRefused,
    PilotTakeover,
    PositionDrift,
    Px4Failsafe,
    Reboot,
    SecondCompanion,
)
from hal.sim.px4 import Mode
from hal.sim.quadrotor import FREE3
from hal.sim.sensors import EstimateOffset

_MODES = {
    "position": Mode.POSITION,
    "altitude": Mode.ALTITUDE,
    "stabilized": Mode.STABILIZED,
    "hold": Mode.HOLD,
    "return": Mode.RETURN,
    "land": Mode.LAND,
}
OFFBOARD_REFUSAL = "Switching to Offboard is currently not available"
ARMING_REFUSAL = "Arming denied: Resolve system health failures first"


class VehicleFaults:
    """The faults of one vehicle; `step` does what is due at the autopilot's time."""

    def __init__(
        self, autopilot: Autopilot, faults: Iterable[FaultWindow], clock: FaultClock
    ) -> None:
        self._autopilot = autopilot
        self._clock = clock
        everything = tuple(faults)
        self._lasting = tuple(
            f
            for f in everything
            if isinstance(f, Battery | OffboardRefused | ArmingRefused | GnssLoss)
        )
        self._once = [f for f in everything if isinstance(f, Px4Failsafe | PilotTakeover | Reboot)]
        self._companions = tuple(f for f in everything if isinstance(f, SecondCompanion))
        self._refusals_left: dict[int, float] = {
            id(f): math.inf if f.times is None else float(f.times)
            for f in self._lasting
            if isinstance(f, OffboardRefused | ArmingRefused)
        }
        self._setpoint_due_s = -math.inf
        self._drained = False
        self._worst = 1.0
        self.blind = False
        """True while the receiver has no fix."""
        self.second_companion = False
        """True while another computer on board is heard."""

    def step(self, now_s: float) -> None:
        """Do what is due at `now_s`, a time on the fault clock."""
        pilot = self._autopilot
        self._clock.note(now_s, armed=pilot.armed, airborne=pilot.airborne)
        if self._lasting:
            self._keep_up(now_s)
        for fault in [f for f in self._once if self._clock.began_s(f, now_s) >= 0.0]:
            self._once.remove(fault)
            self._happen(fault)
        if self._companions:
            self._interfere(now_s)

    def _keep_up(self, now_s: float) -> None:
        """What lasts: as it is now, and no longer."""
        pilot = self._autopilot
        active = self._clock.active(self._lasting, now_s)
        self._count_refusals(active)
        levels = [f.remaining for f in active if isinstance(f, Battery)]
        if levels or self._drained:
            pilot.battery_override = min(levels, default=None)
            self._drained = bool(levels)
            self._guard_battery()
        blind = any(isinstance(f, GnssLoss) for f in active)
        if blind or self.blind:
            pilot.gnss_fix, self.blind = not blind, blind
        refused = [
            f
            for f in active
            if isinstance(f, OffboardRefused | ArmingRefused) and self._refusals_left[id(f)] > 0
        ]
        offboard = any(isinstance(f, OffboardRefused) for f in refused)
        pilot.refuse("offboard", (OFFBOARD_REFUSAL,) if offboard else ())
        arming = [f for f in refused if isinstance(f, ArmingRefused)]
        pilot.refuse("arm", (arming[0].reason, ARMING_REFUSAL) if arming else ())
        announced = [f.reason for f in arming if f.announced]
        pilot.set_fault(announced[0] if announced else "")

    def _guard_battery(self) -> None:
        """PX4's own failsafe: Land (COM_LOW_BAT_ACT 2) or Return (3), each level once a flight."""
        pilot = self._autopilot
        if not pilot.airborne:
            self._worst = 1.0
            return
        p, level = pilot.parameters, pilot.battery_remaining
        action = int(p["COM_LOW_BAT_ACT"])
        critical, emergency = float(p["BAT_CRIT_THR"]), float(p["BAT_EMERGEN_THR"])
        if action in (2, 3) and level <= emergency < self._worst:
            pilot.fail_safe(Mode.LAND)
        elif action in (2, 3) and level <= critical < self._worst:
            pilot.fail_safe(Mode.LAND if action == 2 else Mode.RETURN)
        self._worst = min(self._worst, level)

    def _count_refusals(self, active: tuple[FaultWindow, ...]) -> None:
        for what, kind in (("offboard", OffboardRefused), ("arm", ArmingRefused)):
            refused = self._autopilot.take_refused(what)
            for fault in active:
                if isinstance(fault, kind):
                    self._refusals_left[id(fault)] -= refused

    def _happen(self, fault: Px4Failsafe | PilotTakeover | Reboot) -> None:
        if isinstance(fault, Reboot):
            self._autopilot.reboot(fault.boot_s)
        elif isinstance(fault, PilotTakeover):
            self._autopilot.take_over(_MODES[fault.mode])
        else:
            self._autopilot.fail_safe(_MODES[fault.mode])

    def _interfere(self, now_s: float) -> None:
        active = self._clock.active(self._companions, now_s)
        self.second_companion = bool(active)
        for fault in active:
            if fault.rate_hz > 0.0 and now_s >= self._setpoint_due_s - 1e-9:
                self._setpoint_due_s = now_s + 1.0 / fault.rate_hz
                velocity = (fault.north_m_s, fault.east_m_s, fault.down_m_s)
                self._autopilot.set_setpoint(FREE3, velocity)


class EstimateFaults:
    """Drifts and resets of the autopilot's estimate, on top of what it is off by anyway."""

    def __init__(self, faults: Iterable[FaultWindow], clock: FaultClock) -> None:
        self._faults = tuple(f for f in faults if isinstance(f, PositionDrift | EkfReset))
        self._clock = clock
        self._jumped: tuple[Vector3, float] = (ZERO3, 0.0)
        self.resets = 0
        """How often the estimate jumped."""

    def spoil(
        self, now_s: float, offset: EstimateOffset
    ) -> tuple[EstimateOffset, EstimateOffset | None]:
        """(`offset` with the faults of `now_s`, by how much it has just jumped or None)."""
        if not self._faults:
            return offset, None
        position, velocity, yaw_rad = offset.position_ned_m, offset.velocity_ned_m_s, offset.yaw_rad
        for fault in self._faults:
            if isinstance(fault, PositionDrift):
                drifted, drifting = self._drift(fault, now_s)
                position, velocity = add(position, drifted), add(velocity, drifting)
        jumped, yaw_jump_rad = self._standing(now_s)
        changed = (jumped, yaw_jump_rad) != self._jumped
        before, yaw_before_rad = self._jumped
        self._jumped = jumped, yaw_jump_rad
        spoilt = EstimateOffset(add(position, jumped), velocity, yaw_rad + yaw_jump_rad)
        if not changed:
            return spoilt, None
        self.resets += 1
        by = add(jumped, (-before[0], -before[1], -before[2]))
        return spoilt, EstimateOffset(by, ZERO3, yaw_jump_rad - yaw_before_rad)

    def _standing(self, now_s: float) -> tuple[Vector3, float]:
        """The sum of the resets that stand: (position, yaw)."""
        position, yaw_rad = ZERO3, 0.0
        for fault in self._clock.active(self._faults, now_s):
            if isinstance(fault, EkfReset):
                position = add(position, (fault.north_m, fault.east_m, fault.down_m))
                yaw_rad += math.radians(fault.yaw_deg)
        return position, yaw_rad

    def _drift(self, fault: PositionDrift, now_s: float) -> tuple[Vector3, Vector3]:
        """(how far it has drifted, how fast it drifts now)."""
        lasted_s = self._clock.began_s(fault, now_s)
        if lasted_s <= 0.0:
            return ZERO3, ZERO3
        speed = (fault.north_m_s, fault.east_m_s, fault.down_m_s)
        over = fault.duration_s is not None and lasted_s >= fault.duration_s
        seconds = fault.duration_s if over and fault.duration_s is not None else lasted_s
        drifted = (speed[0] * seconds, speed[1] * seconds, speed[2] * seconds)
        return drifted, ZERO3 if over else speed
