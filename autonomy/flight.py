"""One flight in real time: the pure core between a vehicle's readings and its wire.

The shell has three tasks in one TaskGroup: the control loop at a fixed rate, a server that carries
requests to the autopilot one after another, and whoever feeds operator commands. Whatever ends the
loop (exception, cancellation, a defect) ends in stop, hold and land.
"""

import asyncio
import time
from collections.abc import Sequence
from typing import Protocol

from autonomy.config import Config
from autonomy.errors import Stalled
from autonomy.mission.guarded import Command, GuardedPilot
from autonomy.mission.sensing import Sensing
from autonomy.model import Inputs, OperatorCommand, Outcome
from autonomy.tally import Tally
from hal.frames import Vector3
from hal.interfaces import Clock, GnssReceiver, RangeSensor, Vehicle
from hal.readings import LandedState, StatusText, VehicleFacts
from hal.setpoints import Reply, Request, RequestKind
from hal.vehicle.deadman import Deadman


class Recorder(Protocol):
    """What writes the flight log; never blocks."""

    def tick(self, inputs: Inputs, command: Command, step_s: float) -> None:
        """One tick: what came in, what went out, how long the step took."""
        ...

    def text(self, text: StatusText) -> None:
        """One line of the autopilot's."""
        ...


class Observer(Protocol):
    """What shows the flight to people; never blocks for long."""

    def tick(self, command: Command) -> None:
        """One tick."""
        ...

    def note(self, text: str) -> None:
        """One line of the autopilot's or of the shell's."""
        ...


class Flight:
    """Runs one mission on one vehicle. `run()` returns its outcome; the vehicle is safe then."""

    def __init__(
        self,
        config: Config,
        route: tuple[Vector3, ...],
        *,
        vehicle: Vehicle,
        facts: VehicleFacts,
        sensors: Sequence[RangeSensor],
        gnss: GnssReceiver | None,
        deadman: Deadman,
        clock: Clock,
        recorder: Recorder | None = None,
        observer: Observer | None = None,
    ) -> None:
        self._config = config
        self._vehicle = vehicle
        self._facts = facts
        self._sensors = sensors
        self._gnss = gnss
        self._deadman = deadman
        self._handovers = deadman.handovers
        self._clock = clock
        self._recorder = recorder
        self._observer = observer
        self._guarded = GuardedPilot(config, route)
        # At most a handful of requests in a whole flight; full means a defect, not a backlog.
        self._requests: asyncio.Queue[Request] = asyncio.Queue(maxsize=16)
        self._replies: list[Reply] = []
        self._commands: list[OperatorCommand] = []
        self.tally = Tally()

    @property
    def sensing(self) -> Sensing:
        """Newest beams, map and frame, for those who show the flight; read only."""
        return self._guarded.pilot.sensing

    def command(self, command: OperatorCommand) -> None:
        """Queue an operator's command for the next tick; call from the loop's thread."""
        self._commands.append(command)

    async def run(self) -> Outcome:
        """Fly. Cancelling, or an exception inside, brings the vehicle down before it passes on."""
        safe = False
        try:
            async with asyncio.TaskGroup() as group:
                server = group.create_task(self._serve_requests())
                outcome = await self._control_loop()
                server.cancel()
            safe = True
            return outcome
        finally:
            self._deadman.release()
            if not safe:
                await asyncio.shield(bring_down(self._vehicle, self._config))

    async def _control_loop(self) -> Outcome:
        """Tick until the pilot is done."""
        period_s = 1.0 / self._config.control.rate_hz
        due_s = self._clock.now_s()
        while True:
            outcome = self._tick()
            if outcome is not None:
                return outcome
            due_s += period_s
            wait_s = due_s - self._clock.now_s()
            if wait_s < -period_s:
                # Late by more than a tick: do not hurry after it, the world has moved on.
                self.tally.late_ticks += 1
                due_s = self._clock.now_s()
            await asyncio.sleep(max(0.0, wait_s))

    def _tick(self) -> Outcome | None:
        """One step of the core, and its effects."""
        if self._deadman.handovers > self._handovers:
            raise Stalled(
                "the control loop stood still in flight; the vehicle was stopped, held and landed "
                "meanwhile: the machine was overloaded or this program has a defect, and the last "
                "tick of the flight log says when"
            )
        inputs = self._gather()
        before = time.perf_counter()
        command = self._guarded.step(inputs)
        step_s = time.perf_counter() - before
        decision = command.decision
        if command.wire_setpoint is not None:
            self._vehicle.send(command.wire_setpoint)
            self._deadman.feed()
        else:
            self._deadman.release()
        for request in decision.requests:
            self._requests.put_nowait(request)
        self.tally.note(command, inputs, step_s)
        for text in self._vehicle.take_texts():
            self._tell(text)
        if self._recorder is not None:
            self._recorder.tick(inputs, command, step_s)
        if self._observer is not None:
            self._observer.tick(command)
        return decision.outcome

    def _gather(self) -> Inputs:
        """What the pilot may know now."""
        inputs = Inputs(
            now_s=self._clock.now_s(),
            ranges=tuple(reading for sensor in self._sensors for reading in sensor.take()),
            local_position=self._vehicle.local_position(),
            attitude=self._vehicle.attitude(),
            gnss=self._gnss.fix() if self._gnss is not None else None,
            status=self._vehicle.status(),
            facts=self._facts,
            replies=tuple(self._replies),
            commands=tuple(self._commands),
        )
        self._replies.clear()
        self._commands.clear()
        return inputs

    def _tell(self, text: StatusText) -> None:
        """Pass on what the autopilot wrote."""
        if self._recorder is not None:
            self._recorder.text(text)
        if self._observer is not None:
            self._observer.note(f"PX4: {text.text}")

    async def _serve_requests(self) -> None:
        """Carry requests to the autopilot, one after another."""
        while True:
            request = await self._requests.get()
            self._replies.append(await self._vehicle.execute(request))


async def bring_down(vehicle: Vehicle, config: Config) -> None:
    """Stop, hold, land: for when the core is gone. Never disarms in the air; never raises."""
    if vehicle.status().landed is LandedState.ON_GROUND and not vehicle.status().armed:
        return
    await vehicle.execute(Request(RequestKind.HOLD))
    await asyncio.sleep(1.0)
    ends_s = time.monotonic() + config.mission.land_timeout_s
    while time.monotonic() < ends_s:
        status = vehicle.status()
        if not status.armed and status.landed is LandedState.ON_GROUND:
            return
        if status.link_age_s > 2.0 * config.vehicle.link_timeout_s:
            return
        await vehicle.execute(Request(RequestKind.LAND))
        await asyncio.sleep(2.0)
