"""One flight in real time: the pure core between a vehicle's readings and its wire.

The shell has three tasks in one TaskGroup: the control loop at a fixed rate, a server that carries
requests to the autopilot one after another, and whoever feeds operator commands. Whatever ends the
loop (exception, cancellation, a defect) ends in stop, hold and land, unless a pilot or PX4 has
taken the vehicle: it is left alone then.
"""

import asyncio
import math
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Protocol

from autonomy.config import Config
from autonomy.custody import Custody
from autonomy.errors import AutonomyError, Stalled
from autonomy.mission.guarded import Command, GuardedPilot
from autonomy.mission.sensing import Sensing
from autonomy.model import Ending, Inputs, OperatorCommand, Outcome, Resumed
from autonomy.tally import Tally
from hal.frames import Vector3
from hal.interfaces import Clock, GnssReceiver, RangeSensor, Vehicle
from hal.readings import FlightMode, LandedState, StatusText, VehicleFacts, VehicleStatus
from hal.setpoints import Reply, Request, RequestKind, Setpoint
from hal.vehicle.deadman import Deadman

_FAILSAFE_DOES = {FlightMode.HOLD: RequestKind.HOLD, FlightMode.LAND: RequestKind.LAND}
"""What PX4 does by itself with a vehicle in the air that lost its setpoints, as it is asked for."""
_KEEP_ASKING = 4
_LOOKS, _LOOK_S = 13, 0.1
"""Together longer than from one heartbeat to the next."""
_CLOSING_S = 30.0
"""What bringing a vehicle down takes beside the landing itself: requests, and their answers."""
_ARMED_IS_TOLD_S = 1.5
"""A heartbeat a second tells "armed"."""


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
        resumed: Resumed | None = None,
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
        self._guarded = GuardedPilot(config, route, resumed)
        # At most a handful of requests in a whole flight; full means a defect, not a backlog.
        self._requests: asyncio.Queue[Request] = asyncio.Queue(maxsize=16)
        self._replies: list[Reply] = []
        self._commands: list[OperatorCommand] = []
        self._streaming = False
        """The link repeats a setpoint of this flight."""
        self._told_too_late = False
        self._ended_s: float | None = None
        self._arming_until_s = -math.inf
        """An ARM that was asked for may take effect until then."""
        self.tally = Tally()
        self.custody = Custody()
        """Which modes of the vehicle are this flight's doing, during it and after."""
        self.lost = False
        """Link or setpoints were lost: PX4's failsafe, and nobody else, may have the vehicle."""
        if resumed is not None:
            self.custody.adopt(RequestKind.HOLD)

    @property
    def sensing(self) -> Sensing:
        """Newest beams, map and frame, for those who show the flight; read only."""
        return self._guarded.pilot.sensing

    def is_closing(self, now_s: float) -> bool:
        """True while what follows the control loop runs: no tick comes any more, and the process is
        not to be killed for that before the vehicle is down. It has a bounded time for it.
        """
        bound_s = self._config.mission.land_timeout_s + _CLOSING_S
        return self._ended_s is not None and now_s - self._ended_s <= bound_s

    def command(self, command: OperatorCommand) -> None:
        """Queue an operator's command for the next tick; call from the loop's thread."""
        self._commands.append(command)

    async def run(self) -> Outcome:
        """Fly. Cancelling, or an exception inside, brings the vehicle down before it passes on."""
        safe = False
        try:
            async with asyncio.TaskGroup() as group:
                server = group.create_task(self._serve_requests())
                try:
                    outcome = await self._control_loop(server)
                finally:
                    self._ended_s = self._clock.now_s()
                server.cancel()
            if outcome.ending is Ending.TAKEN_OVER:
                await self._let_go()
            safe = True
            return outcome
        finally:
            # The link repeats the last setpoint, which may move, until PX4 has left Offboard.
            self._stop_streaming()
            try:
                if not safe:
                    await _to_the_end(self._bring_down())
            finally:
                self._deadman.release()
                silent_s = self._vehicle.status().link_age_s
                self.lost = self.lost or silent_s > self._config.vehicle.link_timeout_s

    async def _let_go(self) -> None:
        """A pilot keeps what he took; what PX4's failsafe does it is to go on doing."""
        mode = await self._by_failsafe()
        if mode is None:
            self.custody.let_go()
            await self._leave_offboard()
            return
        self.lost, kind = True, _FAILSAFE_DOES[mode]
        self.custody.adopt(kind, RequestKind.OFFBOARD)
        await self._keep(mode, kind)

    async def _by_failsafe(self) -> FlightMode | None:
        """The mode into which PX4's failsafe brought the vehicle; None for anybody else's.

        A mode may be told before the failsafe's flag, which the next heartbeat brings. Offboard
        again means that setpoints came through again: no person took the vehicle.
        """
        mode = self._vehicle.status().mode
        if mode not in _FAILSAFE_DOES:
            return None
        for _ in range(_LOOKS):
            status = self._vehicle.status()
            back = status.mode is FlightMode.OFFBOARD
            if not status.armed or not (back or status.mode is mode):
                return None
            if back or status.in_failsafe:
                return mode
            await asyncio.sleep(_LOOK_S)
        return None

    async def _keep(self, mode: FlightMode, kind: RequestKind) -> None:
        """Ask for what PX4's failsafe does.

        Offboard stays chosen else: when the link's repeated setpoint comes through again, PX4 would
        go back to it, and hover there with nobody in command.
        """
        for _ in range(_KEEP_ASKING):
            status = self._vehicle.status()
            if not status.armed or status.mode not in (mode, FlightMode.OFFBOARD):
                return
            if (await self._vehicle.execute(Request(kind))).accepted:
                self.custody.asked(kind)
                return
            await asyncio.sleep(1.0)

    async def _leave_offboard(self) -> None:
        """Out of Offboard, if the vehicle was disarmed in it.

        Whoever arms it next would else see it take off to where the link's repeated setpoint is.
        """
        status = self._vehicle.status()
        if not status.armed and status.mode is FlightMode.OFFBOARD:
            await self._vehicle.execute(Request(RequestKind.HOLD))

    async def _bring_down(self) -> None:
        """The deadman, which nobody feeds, stays armed until PX4 has the vehicle."""
        if self._deadman.handovers > self._handovers:
            self.custody.asked(RequestKind.HOLD)
            self.custody.asked(RequestKind.LAND)
        arming_s = self._arming_until_s - self._clock.now_s()
        await bring_down(self._vehicle, self._config, self.custody, self._deadman.release, arming_s)

    def _stop_streaming(self) -> None:
        """What the link goes on to repeat stays where the vehicle is."""
        if self._streaming:
            self._streaming = False
            self._vehicle.stop_now()

    async def _control_loop(self, server: asyncio.Task[None]) -> Outcome:
        """Tick until the pilot is done. Without its server it cannot even land: that ends it."""
        period_s = 1.0 / self._config.control.rate_hz
        due_s = self._clock.now_s()
        while True:
            counted = self.tally.late_ticks
            if server.done():
                raise AutonomyError("the task that carries requests to the autopilot has ended")
            outcome = self._tick()
            if outcome is not None:
                return outcome
            due_s += period_s
            wait_s = due_s - self._clock.now_s()
            if wait_s < -period_s:
                # Late by more than a tick: do not hurry after it, the world has moved on.
                self.tally.late_ticks = counted + 1
                due_s = self._clock.now_s()
            await asyncio.sleep(max(0.0, wait_s))

    def _tick(self) -> Outcome | None:
        """One step of the core, and its effects."""
        inputs = self._gather()
        # After gathering: a Hold that it shows may be the deadman's, and is no pilot's then.
        if self._deadman.handovers > self._handovers:
            raise Stalled(
                "the control loop stood still in flight; the vehicle was stopped, held and, unless "
                "a pilot took it, landed: the machine was overloaded or this program has a defect, "
                "and the last tick of the flight log says when"
            )
        before = time.perf_counter()
        command = self._guarded.step(inputs)
        step_s = time.perf_counter() - before
        decision = command.decision
        self.custody.see(inputs.status.mode)
        self._put_on_wire(command.wire_setpoint, inputs.now_s)
        for request in decision.requests:
            self.custody.asked(request.kind)
            self._requests.put_nowait(request)
            if request.kind is RequestKind.ARM:
                answer_s = self._config.vehicle.request_timeout_s
                self._arming_until_s = self._clock.now_s() + answer_s + _ARMED_IS_TOLD_S
        self.tally.note(command, inputs, step_s)
        for text in self._vehicle.take_texts():
            self._tell(text)
        if self._recorder is not None:
            self._recorder.tick(inputs, command, step_s)
        if self._observer is not None:
            self._observer.tick(command)
        return decision.outcome

    def _put_on_wire(self, setpoint: Setpoint | None, decided_on_s: float) -> None:
        """Send and feed, unless the world that was decided on is gone: the deadman sees to it."""
        if setpoint is None:
            self._stop_streaming()
            self._deadman.release()
            return
        age_s = self._clock.now_s() - decided_on_s
        if age_s <= self._config.guard.setpoint_max_age_s:
            self._vehicle.send(setpoint)
            self._streaming = True
            self._deadman.feed()
            return
        self.tally.late_ticks += 1
        if not self._told_too_late and self._observer is not None:
            self._told_too_late = True
            self._observer.note(
                f"a decision took {age_s:.2f} s and was not sent: this computer is overloaded"
            )

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
            if request.kind is RequestKind.ARM:
                self._arming_until_s = self._clock.now_s() + _ARMED_IS_TOLD_S


async def _to_the_end(doing: Coroutine[None, None, None]) -> None:
    """Await it whatever is cancelled meanwhile; a cancellation is passed on when it is done."""
    # No group: it would end its task with the cancellation that this is to outlast.
    task = asyncio.get_running_loop().create_task(doing)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled


async def bring_down(
    vehicle: Vehicle,
    config: Config,
    custody: Custody,
    held: Callable[[], None] = lambda: None,
    arming_s: float = 0.0,
) -> None:
    """Hold, land: for when the core is gone. Never disarms in the air; never raises.

    One that stands disarmed in the Takeoff that this program selected is put into Hold, and an
    arming that may take effect within `arming_s` is waited for.

    Ends without another word once the mode is not this program's doing: a pilot, or PX4's own
    failsafe, has the vehicle. `held()` is called when PX4 has accepted Hold
    or Land.
    """
    await _stay_on_ground(vehicle, custody, arming_s)
    status = vehicle.status()
    if not _ours_in_the_air(status, custody):
        return
    if status.mode is not FlightMode.LAND:
        custody.asked(RequestKind.HOLD)
        if (await vehicle.execute(Request(RequestKind.HOLD))).accepted:
            held()
        await asyncio.sleep(1.0)
    ends_s = time.monotonic() + config.mission.land_timeout_s
    while time.monotonic() < ends_s:
        status = vehicle.status()
        if not _ours_in_the_air(status, custody):
            return
        if status.link_age_s > 2.0 * config.vehicle.link_timeout_s:
            return
        if status.mode is not FlightMode.LAND:
            custody.asked(RequestKind.LAND)
            if (await vehicle.execute(Request(RequestKind.LAND))).accepted:
                held()
        await asyncio.sleep(2.0)


async def _stay_on_ground(vehicle: Vehicle, custody: Custody, arming_s: float) -> None:
    """A disarmed vehicle is not to climb when it is armed; it is watched while it may be yet."""
    if vehicle.status().armed:
        return
    if custody.climbs_when_armed:
        custody.asked(RequestKind.HOLD)
        await vehicle.execute(Request(RequestKind.HOLD))
    for _ in range(math.ceil(max(0.0, arming_s))):
        if vehicle.status().armed:
            return
        await asyncio.sleep(1.0)


def _ours_in_the_air(status: VehicleStatus, custody: Custody) -> bool:
    """True for a vehicle that is not down yet and that nobody else has taken."""
    # Disarmed, and it does not tell where: nothing that is asked for brings it down.
    down = status.landed in (LandedState.ON_GROUND, LandedState.UNKNOWN) and not status.armed
    return not down and custody.holds(status.mode)
