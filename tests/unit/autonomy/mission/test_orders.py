"""Orders against faults: who comes first, and what goes on afterwards."""

import pytest

from autonomy.config import Config
from autonomy.mission.drift import Drift
from autonomy.mission.failsafe import Fault, Found, Response, found
from autonomy.mission.machine import NAVIGATING_STATES
from autonomy.mission.orders import Orders
from autonomy.mission.responding import Responding
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.tick import Tick
from autonomy.mission.trail import Trail
from autonomy.model import FusedState, Inputs, MissionState, OperatorCommand
from hal.frames import ZERO3
from hal.readings import FlightMode, LandedState, VehicleStatus

S = MissionState
CONFIG = Config()
ORDERS = (OperatorCommand.STOP, OperatorCommand.HOLD, OperatorCommand.LAND)
HEARD = [each for each in Fault if found(CONFIG, each, "").response is not Response.LET_GO]
"""The others are read off the vehicle's mode."""
PAIRS = [(order, fault) for order in ORDERS for fault in HEARD]


class Flight:
    """Orders and faults tick by tick, with nothing else."""

    def __init__(self, state: MissionState = S.CRUISE) -> None:
        sensing = Sensing(CONFIG)
        self.orders = Orders()
        self.responding = Responding(CONFIG, sensing, Sequence(CONFIG), Trail(), Drift(CONFIG))
        self.state, self.held_from, self.entered_s, self.now_s = state, state, 0.0, 10.0
        self.returning = state is S.RETURN
        self.said: list[str] = []

    def tick(self, *faults: Found, order: OperatorCommand | None = None) -> MissionState:
        self.now_s += 0.05
        now_s = self.now_s
        status = VehicleStatus(now_s, True, FlightMode.OFFBOARD, LandedState.IN_AIR, 0.0)
        inputs = Inputs(now_s, (), None, None, None, status)
        fused = FusedState(now_s, ZERO3, ZERO3, 0.0, 0.02, None, ok=True)
        tick = Tick(inputs, fused, 0.05, self.state, self.entered_s)
        tick.returning, tick.faults = self.returning, faults
        if order is not None:
            self._go(tick, self.orders.obey(tick, order))
        self._go(tick, self.orders.stay(tick))
        self._go(tick, self.responding.respond(tick))
        if tick.state is S.HOLD:
            self._go(tick, self.orders.hold(tick, self.held_from))
        self.state, self.entered_s = tick.state, tick.entered_s
        self.said += [event.why for event in tick.events]
        return self.state

    def _go(self, tick: Tick, move: Move | None) -> None:
        if move is None:
            return
        if move.state is S.HOLD:
            self.held_from = tick.state
        tick.state, tick.entered_s = move.state, tick.now_s
        self.returning = self.returning or move.state is S.RETURN


def fault(kind: Fault) -> Found:
    return found(CONFIG, kind, f"{kind.value} is there")


@pytest.mark.parametrize(("order", "kind"), PAIRS)
@pytest.mark.parametrize("state", sorted(NAVIGATING_STATES))
def test_an_order_is_overruled_only_by_what_lands(
    state: MissionState, order: OperatorCommand, kind: Fault
) -> None:
    flight, wrong = Flight(state), fault(kind)
    flight.responding._may_return = lambda *_: True  # type: ignore[method-assign]
    flight.tick(order=order)
    lands = order is OperatorCommand.LAND or wrong.response >= Response.LAND
    for _ in range(40):
        assert flight.tick(wrong) is (S.LAND if lands else S.HOLD)
    if order is OperatorCommand.STOP:
        assert [flight.tick(wrong) for _ in range(30)][-1] is S.LAND


def test_a_stop_is_not_turned_into_a_flight_back_within_its_three_seconds() -> None:
    flight = Flight()
    flight.responding._may_return = lambda *_: True  # type: ignore[method-assign]
    assert flight.tick(fault(Fault.FENCE_LEFT), order=OperatorCommand.STOP) is S.HOLD
    seen = {flight.tick(fault(Fault.FENCE_LEFT)) for _ in range(70)}
    assert seen == {S.HOLD, S.LAND}


def test_a_hold_puts_a_return_off_and_says_so_once() -> None:
    flight, low = Flight(), fault(Fault.BATTERY_LOW)
    flight.responding._may_return = lambda *_: True  # type: ignore[method-assign]
    flight.tick(order=OperatorCommand.HOLD)
    for _ in range(100):
        assert flight.tick(low) is S.HOLD
    assert [why for why in flight.said if "returning when told to go on" in why] == [
        "battery_low is there: held by the operator; returning when told to go on"
    ]
    assert flight.tick(low, order=OperatorCommand.RESUME) is S.RETURN


def test_a_return_that_is_held_goes_on_when_told_to() -> None:
    flight, low = Flight(S.RETURN), fault(Fault.BATTERY_LOW)
    assert flight.tick(low, order=OperatorCommand.HOLD) is S.HOLD
    assert flight.tick(low) is S.HOLD
    assert flight.tick(low, order=OperatorCommand.RESUME) is S.RETURN
