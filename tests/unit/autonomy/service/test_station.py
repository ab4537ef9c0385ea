import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.model import OperatorCommand
from autonomy.service.contract import MissionOrder, MissionStatus, Phase
from autonomy.service.station import EVENTS_KEPT, MISSIONS_KEPT, Instant, Refused, Station
from hal.readings import FlightMode, LandedState, VehicleStatus

ORDER = MissionOrder(goals=([1.0, 2.0],))


def status(*, armed: bool = False) -> VehicleStatus:
    landed = LandedState.IN_AIR if armed else LandedState.ON_GROUND
    return VehicleStatus(0.0, armed, FlightMode.HOLD, landed, 0.0)


def accept(_: MissionOrder) -> None:
    """Anything may be flown."""


def ready(*, armed: bool = False) -> Station:
    station = Station(Config(), accept)
    station.at_rest(Instant(0.0, status(armed=armed), {}))
    station.enter(Phase.READY, "ready")
    return station


def test_a_mission_is_queued_once_and_taken_once() -> None:
    station = ready()
    record = station.submit(ORDER)
    taken = station.take_mission()
    assert taken is not None
    assert (taken.id, taken.status) == (record.id, MissionStatus.FLYING)
    assert station.take_mission() is None


def test_what_the_check_refuses_is_not_queued() -> None:
    def refuse(_: MissionOrder) -> None:
        raise BadInput("outside the fence")

    station = Station(Config(), refuse)
    station.enter(Phase.READY, "ready")
    with pytest.raises(BadInput, match="outside the fence"):
        station.submit(ORDER)
    assert station.take_mission() is None
    assert station.missions() == ()


@pytest.mark.parametrize(
    ("phase", "sentence"),
    [(Phase.WAITING, "no vehicle to fly: why"), (Phase.STOPPING, "the service is stopping")],
)
def test_no_mission_without_a_vehicle_that_may_fly(phase: Phase, sentence: str) -> None:
    station = ready()
    station.enter(phase, "why")
    with pytest.raises(Refused, match=sentence):
        station.submit(ORDER)


def test_a_second_mission_is_refused_and_told_which_is_flown() -> None:
    station = ready()
    first = station.submit(ORDER)
    with pytest.raises(Refused, match=first.id):
        station.submit(ORDER)


def test_an_armed_vehicle_is_not_given_a_mission() -> None:
    with pytest.raises(Refused, match="land it first"):
        ready(armed=True).submit(ORDER)


def test_a_command_drops_what_is_queued_and_arrives_once() -> None:
    station = ready()
    record = station.submit(ORDER)
    station.command(OperatorCommand.LAND)
    assert station.take_mission() is None
    assert station.take_commands() == (OperatorCommand.LAND,)
    assert station.take_commands() == ()
    cancelled = station.mission(record.id)
    assert cancelled is not None
    assert cancelled.status is MissionStatus.CANCELLED


def test_a_command_without_a_vehicle_is_refused_but_still_drops_the_queue() -> None:
    station = ready()
    station.submit(ORDER)
    station.enter(Phase.WAITING, "it fell silent")
    with pytest.raises(Refused, match="it fell silent"):
        station.command(OperatorCommand.STOP)
    assert station.take_mission() is None
    assert station.take_commands() == ()


def test_aborting_takes_back_what_is_queued_and_stops_what_is_flown() -> None:
    station = ready()
    first = station.submit(ORDER)
    taken_back = station.abort(first.id)
    assert taken_back is not None
    assert taken_back.status is MissionStatus.CANCELLED
    assert station.take_commands() == ()

    second = station.submit(ORDER)
    station.take_mission()
    station.abort(second.id)
    assert station.take_commands() == (OperatorCommand.STOP,)

    station.update(second.id, status=MissionStatus.DONE)
    station.abort(second.id)
    assert station.take_commands() == ()
    assert station.abort("unknown") is None


def test_events_are_numbered_without_gaps_and_bounded() -> None:
    station = ready()
    for number in range(EVENTS_KEPT + 50):
        station.tell("note", str(number))
    numbers = [event.number for event in station.events]
    assert len(numbers) == EVENTS_KEPT
    assert numbers == list(range(numbers[0], numbers[0] + EVENTS_KEPT))
    assert station.events[-1].why == str(EVENTS_KEPT + 49)


def test_old_missions_are_forgotten_the_newest_stay() -> None:
    station = ready()
    for _ in range(MISSIONS_KEPT + 5):
        last = station.submit(ORDER)
        station.abort(last.id)
    assert len(station.missions()) == MISSIONS_KEPT
    assert station.missions()[0].id == last.id


class Orders(RuleBasedStateMachine):
    """Whatever people ask in whatever order: at most one mission lives, and none comes twice."""

    def __init__(self) -> None:
        super().__init__()
        self.station = ready()
        self.flying: str | None = None
        self.taken: set[str] = set()

    @rule()
    def submit(self) -> None:
        try:
            self.station.submit(ORDER)
        except Refused:
            assert [m for m in self.station.missions() if not m.over]

    @rule()
    def stop(self) -> None:
        self.station.command(OperatorCommand.STOP)

    @rule()
    def abort_newest(self) -> None:
        for record in self.station.missions()[:1]:
            self.station.abort(record.id)

    @precondition(lambda self: self.flying is None)
    @rule()
    def control_side_takes(self) -> None:
        record = self.station.take_mission()
        if record is not None:
            assert record.id not in self.taken
            self.taken.add(record.id)
            self.flying = record.id

    @precondition(lambda self: self.flying is not None)
    @rule()
    def control_side_ends(self) -> None:
        assert self.flying is not None
        self.station.update(self.flying, status=MissionStatus.DONE)
        self.flying = None

    @invariant()
    def at_most_one_lives(self) -> None:
        alive = [m for m in self.station.missions() if not m.over]
        assert len(alive) <= 1
        if self.flying is not None:
            assert [m.id for m in alive] == [self.flying]


TestOrders = Orders.TestCase
TestOrders.settings = settings(deadline=None, max_examples=40, stateful_step_count=20)
