"""One tick in the making: what came in, and what the parts of the pilot have decided so far."""

from dataclasses import dataclass, field

from autonomy.mission.failsafe import Found, Response
from autonomy.model import (
    Event,
    FusedState,
    Inputs,
    MissionState,
    MovingObstacle,
    NoPlan,
    Plan,
)
from hal.setpoints import Request, RequestKind, Setpoint


@dataclass(slots=True)
class Tick:
    """Lives for one `Pilot.step`; becomes its `Decision`."""

    inputs: Inputs
    fused: FusedState
    dt_s: float
    state: MissionState = MissionState.PREFLIGHT
    """Changes within the tick, when the mission goes from one to another."""
    entered_s: float = 0.0
    """When the present state began."""
    setpoint: Setpoint | None = None
    plan: Plan | NoPlan | None = None
    speed_limit_m_s: float = 0.0
    faults: tuple[Found, ...] = ()
    """What counts as wrong at this tick, strongest response first."""
    returning: bool = False
    """The mission is over, and the vehicle on its way back (it may hold meanwhile)."""
    held: bool = False
    """The operator said HOLD, and not yet RESUME."""
    stopping: bool = False
    """The operator said STOP: it holds, and lands soon."""
    movers: tuple[MovingObstacle, ...] = ()
    requests: list[Request] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    @property
    def now_s(self) -> float:
        """The tick's time."""
        return self.inputs.now_s

    @property
    def elapsed_s(self) -> float:
        """Time in the present state."""
        return self.now_s - self.entered_s

    @property
    def slow(self) -> bool:
        """True where a fault asks for the least speed."""
        return any(fault.response is Response.SLOW for fault in self.faults)

    def say(self, name: str, why: str) -> None:
        """Tell people one sentence."""
        self.events.append(Event(self.now_s, name, why))

    def ask(self, kind: RequestKind, altitude_m: float = 0.0) -> None:
        """Ask the autopilot for something."""
        self.requests.append(Request(kind, altitude_m))

    def refusal(self, kind: RequestKind) -> str | None:
        """The reason of a refused request of this kind that came back this tick, or None."""
        for reply in self.inputs.replies:
            if reply.kind is kind and not reply.accepted:
                return reply.reason
        return None

    def accepted(self, kind: RequestKind) -> bool:
        """True when a request of this kind was accepted this tick."""
        return any(reply.kind is kind and reply.accepted for reply in self.inputs.replies)
