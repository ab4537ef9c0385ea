"""The service's drivers on simulated time: every look at the sensors lets one tick pass, so that a
mission takes a second, and nothing but the vehicle is simulated.
"""

from collections.abc import Callable, Mapping

import numpy as np

from autonomy.config import Config
from autonomy.serving.parts import Drivers
from hal.clock import SimClock
from hal.drops import Dropped, Drops
from hal.errors import ConnectionFailed
from hal.interfaces import WireMessage
from hal.readings import FlightMode, RangeReading, VehicleFacts
from hal.setpoints import Reply, Request, RequestKind
from hal.sim.autopilot import Autopilot
from hal.sim.faults import with_beam_faults
from hal.sim.scenario import Scenario
from hal.sim.sensors import SimulatedBeams
from hal.sim.vehicle import SimVehicle
from hal.sim.world import World


class DrivenVehicle(SimVehicle):
    """A simulated vehicle with the door that the deadman and drivers need."""

    opened = 0
    away = False
    """True: opening fails, as with a vehicle that is switched off."""
    seconds_a_request = 0.0
    """How much simulated time passes after a request, for those who send one and then wait."""

    def listen(self, name: str, take: Callable[[WireMessage], None]) -> None:
        """Nothing comes over a wire."""

    def stamp_s(self, message: WireMessage, boot_s: float) -> float:  # noqa: ARG002 - the contract
        """When it was received."""
        return message.received_s

    def send_message(self, name: str, fields_json: str) -> None:
        """Nothing goes over a wire."""

    async def read_parameters(
        self, kinds: Mapping[str, type[int] | type[float]]
    ) -> dict[str, float]:
        """Those that the simulated autopilot has."""
        held = self.autopilot.parameters
        return {name: float(held[name]) for name in kinds if name in held}

    async def write_parameter(self, name: str, value: int | float) -> float | None:
        """Set it and read it back."""
        self.autopilot.set_parameter(name, value)
        return (await self.read_parameters({name: float})).get(name)

    async def report_health(self) -> bool:
        """There is no report beside the status."""
        return True

    def hold_now(self) -> bool:
        """The deadman's second step."""
        if self.status().mode is not FlightMode.OFFBOARD:
            return False
        if not self.execute_now(Request(RequestKind.HOLD)).accepted:
            self.execute_now(Request(RequestKind.LAND))
        return True

    async def execute(self, request: Request) -> Reply:
        """As the contract says; time passes."""
        reply = self.execute_now(request)
        if self.seconds_a_request:
            self.advance(self.seconds_a_request)
        return reply

    async def open(self, deadline_s: float) -> VehicleFacts:
        """As the contract says, unless it is away."""
        if self.away:
            raise ConnectionFailed("nobody answered; switch the vehicle on")
        self.opened += 1
        return await super().open(deadline_s)


class DrivenBeams:
    """All beams of one scenario; `take` lets a tick pass first."""

    def __init__(self, rig: "Rig") -> None:
        self._rig = rig

    async def open(self, deadline_s: float) -> None:
        """Nothing to start."""

    async def close(self) -> None:
        """Nothing to stop."""

    def take(self) -> tuple[RangeReading, ...]:
        """One tick's readings."""
        return self._rig.pass_time()

    def dropped(self) -> Dropped:
        """What the rig is told to have dropped."""
        return self._rig.drops.dropped()


class Rig:
    """One simulated vehicle in one scenario, and the service's drivers to it."""

    def __init__(self, scenario: Scenario, config: Config, seed: int = 0) -> None:
        first, second = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2)
        )
        self.clock = SimClock()
        self.drops = Drops()
        self._period_s = 1.0 / config.control.rate_hz
        self.vehicle = DrivenVehicle(Autopilot(scenario, first), self.clock)
        self._beams = with_beam_faults(
            SimulatedBeams(World(scenario), config.beams, scenario.beams, second),
            scenario.faults,
            second,
        )
        self.vehicle.advance(6.0)
        self.at_tick: Callable[[], None] | None = None
        """Called once a tick, to do something to the vehicle or to ask something of the service."""

    def pass_time(self) -> tuple[RangeReading, ...]:
        """Let one tick pass; the readings at its end."""
        self.vehicle.advance(self._period_s)
        if self.at_tick is not None:
            self.at_tick()
        truth = self.vehicle.truth()
        return self._beams.sample(
            self.clock.now_s(),
            truth.position_ned_m,
            truth.roll_rad,
            truth.pitch_rad,
            truth.yaw_rad,
        )

    def drivers(self) -> Drivers:
        """What the service flies with."""
        return Drivers(
            lambda: self.vehicle, lambda _: (DrivenBeams(self),), lambda _: None, self.clock
        )
