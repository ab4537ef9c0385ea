"""From the ground into the air and back, one state at a time."""

import msgspec
import pytest

from autonomy.config import Config
from autonomy.mission.sequence import Sequence
from autonomy.mission.tick import Tick
from autonomy.model import Ending, FusedState, Inputs, MissionState
from hal.frames import ZERO3
from hal.readings import FlightMode, LandedState, VehicleStatus
from hal.setpoints import Reply, RequestKind

FUSED = FusedState(0.0, ZERO3, ZERO3, 0.0, 0.03, 0.0, True)
GROUND = VehicleStatus(0.0, False, FlightMode.HOLD, LandedState.ON_GROUND, 0.05)


def tick(status: VehicleStatus, now_s: float = 0.0, *replies: Reply) -> Tick:
    inputs = Inputs(now_s, (), None, None, None, status, replies=replies)
    return Tick(inputs, FUSED, 0.05)


def asked(at: Tick) -> list[RequestKind]:
    return [request.kind for request in at.requests]


def changed(status: VehicleStatus, **fields: object) -> VehicleStatus:
    return msgspec.structs.replace(status, **fields)


def test_arming_is_asked_for_once() -> None:
    sequence = Sequence(Config())
    first, second = tick(GROUND), tick(GROUND, 0.05)
    assert sequence.arm(first, 0.0) is None
    assert sequence.arm(second, 0.05) is None
    assert asked(first) == [RequestKind.ARM]
    assert asked(second) == []


def test_a_vehicle_in_the_air_is_refused_at_once_and_told_what_to_do() -> None:
    flown = changed(GROUND, armed=True, landed=LandedState.IN_AIR)
    assert Sequence(Config()).preflight(tick(flown), 1.4, ()) is None
    move = Sequence(Config()).preflight(tick(flown), 1.5, ())
    assert move is not None
    assert move.state is MissionState.DONE
    assert "not taken over; land it" in move.why


def test_a_vehicle_left_in_offboard_by_its_last_landing_is_put_in_hold_first() -> None:
    sequence = Sequence(Config())
    left = changed(GROUND, mode=FlightMode.OFFBOARD, armable=False)
    first, second = tick(left), tick(left, 0.05)
    assert sequence.preflight(first, 0.0, ()) is None
    assert sequence.preflight(second, 0.05, ()) is None
    assert [asked(first), asked(second)] == [[RequestKind.HOLD], []]
    move = sequence.preflight(tick(GROUND, 0.1), 0.1, ())
    assert move is not None
    assert move.state is MissionState.ARM
    sequence.arm(tick(changed(GROUND, armed=True), 0.2), 0.2)
    end = tick(changed(GROUND, armed=True, landed=LandedState.IN_AIR), 60.0)
    sequence.ask_hold(end)
    assert asked(end) == [RequestKind.HOLD], "the mission's end may ask for Hold again"


@pytest.mark.parametrize("elapsed_s", [0.05, 5.01])
def test_a_refused_or_silent_arming_ends_the_mission_on_the_ground(elapsed_s: float) -> None:
    refusal = (Reply(0.05, RequestKind.ARM, False, "no compass"),) if elapsed_s < 1.0 else ()
    move = Sequence(Config()).arm(tick(GROUND, elapsed_s, *refusal), elapsed_s)
    assert move is not None
    assert move.state is MissionState.LAND
    assert move.outcome is not None
    assert move.outcome.ending is Ending.PREFLIGHT_REFUSED
    assert ("no compass" in move.why) == bool(refusal)


def test_landing_is_asked_for_again_until_px4_lands() -> None:
    sequence = Sequence(Config())
    flying = changed(GROUND, armed=True, landed=LandedState.IN_AIR, mode=FlightMode.HOLD)
    times = [0.05 * k for k in range(60)]
    asking = []
    for now_s in times:
        step = tick(flying, now_s)
        assert sequence.land(step, now_s) is None
        asking += [now_s for kind in asked(step) if kind is RequestKind.LAND]
    assert asking == pytest.approx([0.0, 2.0])


def test_px4_disarms_by_itself_and_is_asked_only_when_it_did_not() -> None:
    sequence = Sequence(Config())
    down = changed(GROUND, armed=True, mode=FlightMode.LAND)
    first_s = None
    for k in range(200):
        step = tick(down, 0.05 * k)
        assert sequence.land(step, 0.05 * k) is None
        if RequestKind.DISARM in asked(step):
            first_s = first_s if first_s is not None else step.now_s
    assert first_s == pytest.approx(5.0)


def test_in_the_air_nothing_ever_asks_to_disarm() -> None:
    sequence = Sequence(Config())
    for landed in (LandedState.IN_AIR, LandedState.LANDING, LandedState.TAKEOFF):
        flying = changed(GROUND, armed=True, landed=landed, mode=FlightMode.LAND)
        for k in range(400):
            step = tick(flying, 0.05 * k)
            sequence.land(step, 0.05 * k)
            assert RequestKind.DISARM not in asked(step)


def test_a_vehicle_that_fell_silent_is_px4s() -> None:
    gone = changed(GROUND, armed=True, landed=LandedState.IN_AIR, link_age_s=10.1)
    move = Sequence(Config()).land(tick(gone, 20.0), 20.0)
    assert move is not None
    assert move.state is MissionState.DONE
    assert "failsafe" in move.why
    assert move.outcome is not None
    assert move.outcome.ending is Ending.LINK_LOST, "exit code 0 is for vehicles on the ground"


def test_a_landing_that_does_not_end_is_no_success() -> None:
    stuck = changed(GROUND, armed=True, landed=LandedState.LANDING, mode=FlightMode.LAND)
    limit_s = Config().mission.land_timeout_s
    assert Sequence(Config()).land(tick(stuck, limit_s), limit_s) is None
    move = Sequence(Config()).land(tick(stuck, limit_s + 0.1), limit_s + 0.1)
    assert move is not None
    assert move.outcome is not None
    assert move.outcome.ending is Ending.FAILSAFE


def test_landed_and_disarmed_ends_the_mission_after_a_moment() -> None:
    sequence = Sequence(Config())
    assert sequence.land(tick(GROUND, 0.5), 0.5) is None
    move = sequence.land(tick(GROUND, 1.0), 1.0)
    assert move is not None
    assert move.state is MissionState.DONE


LOCAL_ONLY = changed(
    GROUND, armable=False, global_position=False, not_armable_because="No global position"
)
TAKEOFF_SELECTED = changed(LOCAL_ONLY, mode=FlightMode.TAKEOFF, armable=True)


def test_takeoff_is_selected_where_hold_keeps_the_vehicle_from_arming() -> None:
    sequence = Sequence(Config())
    early, late = tick(LOCAL_ONLY, 1.0), tick(LOCAL_ONLY, 2.0)
    assert sequence.preflight(early, 1.0, ()) is None
    assert sequence.preflight(late, 2.0, ()) is None
    assert [asked(early), asked(late)] == [[], [RequestKind.TAKEOFF]]
    move = sequence.preflight(tick(TAKEOFF_SELECTED, 2.1), 2.1, ())
    assert move is not None
    assert move.state is MissionState.ARM


@pytest.mark.parametrize(
    "fields",
    [{"global_position": True}, {"armable": True}, {"mode": FlightMode.MANUAL}, {"armed": True}],
)
def test_takeoff_is_not_selected_for_any_other_reason(fields: dict[str, object]) -> None:
    step = tick(changed(LOCAL_ONLY, **fields), 2.0)
    Sequence(Config()).preflight(step, 2.0, ())
    assert RequestKind.TAKEOFF not in asked(step)


def test_a_vehicle_that_refused_to_arm_is_given_back_in_hold() -> None:
    sequence = Sequence(Config())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    refused = tick(TAKEOFF_SELECTED, 2.1, Reply(2.1, RequestKind.ARM, False, "no compass"))
    assert sequence.arm(refused, 0.1) is None
    assert asked(refused) == [RequestKind.HOLD]
    move = sequence.arm(tick(LOCAL_ONLY, 2.2), 0.2)
    assert move is not None
    assert "no compass" in move.why


def test_giving_back_does_not_wait_for_ever() -> None:
    sequence = Sequence(Config())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    refused = tick(TAKEOFF_SELECTED, 2.1, Reply(2.1, RequestKind.ARM, False, "no compass"))
    assert sequence.arm(refused, 0.1) is None
    assert sequence.arm(tick(TAKEOFF_SELECTED, 7.0), 5.0) is None
    assert sequence.arm(tick(TAKEOFF_SELECTED, 7.3), 5.3) is not None


def test_hold_is_asked_for_again_where_the_last_landing_was_given_back_already() -> None:
    sequence = Sequence(Config())
    left = changed(LOCAL_ONLY, mode=FlightMode.OFFBOARD)
    sequence.preflight(tick(left, 0.1), 0.1, ())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    refused = tick(TAKEOFF_SELECTED, 2.1, Reply(2.1, RequestKind.ARM, False, "no compass"))
    assert sequence.arm(refused, 0.1) is None
    assert asked(refused) == [RequestKind.HOLD]


def stopping(status: VehicleStatus, now_s: float, *replies: Reply) -> Tick:
    step = tick(status, now_s, *replies)
    step.stopping = True
    return step


def test_a_stop_before_arming_ends_at_once_where_nothing_was_selected() -> None:
    move = Sequence(Config()).preflight(stopping(GROUND, 0.5), 0.5, ())
    assert move is not None
    assert move.state is MissionState.DONE
    assert move.outcome is not None
    assert move.outcome.ending is Ending.ABORTED


def test_a_stop_before_arming_gives_the_vehicle_back_first() -> None:
    sequence = Sequence(Config())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    first = stopping(TAKEOFF_SELECTED, 2.1)
    assert sequence.preflight(first, 2.1, ()) is None
    assert asked(first) == [RequestKind.HOLD]
    assert sequence.preflight(stopping(TAKEOFF_SELECTED, 2.2), 2.2, ()) is None
    move = sequence.preflight(stopping(LOCAL_ONLY, 2.3), 2.3, ())
    assert move is not None
    assert move.state is MissionState.DONE


def test_a_selection_that_is_still_on_its_way_is_waited_for() -> None:
    sequence = Sequence(Config())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    assert sequence.preflight(stopping(LOCAL_ONLY, 2.05), 2.05, ()) is None
    assert sequence.preflight(stopping(LOCAL_ONLY, 2.5), 2.5, ()) is None
    held = stopping(LOCAL_ONLY, 2.6, Reply(2.6, RequestKind.HOLD, True))
    assert sequence.preflight(held, 2.6, ()) is not None


def test_a_stop_while_arming_gives_the_vehicle_back_in_hold() -> None:
    sequence = Sequence(Config())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    sequence.arm(tick(TAKEOFF_SELECTED, 2.1), 0.0)
    first = tick(TAKEOFF_SELECTED, 2.2, Reply(2.2, RequestKind.ARM, False, "no compass"))
    assert sequence.land(first, 0.0) is None
    assert asked(first) == [RequestKind.HOLD]
    assert sequence.land(tick(TAKEOFF_SELECTED, 6.0), 3.8) is None
    assert sequence.land(tick(LOCAL_ONLY, 6.1), 3.9) is not None


def test_the_mode_of_a_vehicle_that_flew_and_landed_stays() -> None:
    sequence = Sequence(Config())
    sequence.preflight(tick(LOCAL_ONLY, 2.0), 2.0, ())
    sequence.preflight(tick(TAKEOFF_SELECTED, 2.1), 2.1, ())
    sequence.arm(tick(changed(TAKEOFF_SELECTED, armed=True), 2.3), 0.1)
    down = tick(changed(LOCAL_ONLY, mode=FlightMode.LAND), 60.0)
    assert sequence.land(down, 10.0) is not None
    assert asked(down) == []


def test_a_stop_while_arming_waits_for_what_arming_may_still_do() -> None:
    sequence = Sequence(Config())
    sequence.arm(tick(GROUND, 10.0), 0.0)
    assert sequence.land(tick(GROUND, 13.0), 2.9) is None
    late = tick(GROUND, 13.1, Reply(13.1, RequestKind.ARM, True))
    assert sequence.land(late, 3.0) is None
    assert sequence.land(tick(GROUND, 14.5), 4.4) is None, "a heartbeat a second tells it"
    climbs = changed(GROUND, armed=True, landed=LandedState.TAKEOFF, mode=FlightMode.TAKEOFF)
    armed = tick(climbs, 14.55)
    assert sequence.land(armed, 4.45) is None
    assert asked(armed) == [RequestKind.LAND]


def test_an_arming_that_had_no_effect_in_time_ends_the_mission() -> None:
    sequence = Sequence(Config())
    sequence.arm(tick(GROUND, 10.0), 0.0)
    sequence.land(tick(GROUND, 10.5, Reply(10.5, RequestKind.ARM, False, "no")), 0.4)
    assert sequence.land(tick(GROUND, 11.9), 1.8) is None
    assert sequence.land(tick(GROUND, 12.0), 1.9) is not None


def test_an_arming_that_nobody_answered_is_not_waited_for_for_ever() -> None:
    sequence = Sequence(Config())
    sequence.arm(tick(GROUND, 10.0), 0.0)
    assert sequence.land(tick(GROUND, 17.4), 7.0) is None
    assert sequence.land(tick(GROUND, 17.6), 7.1) is not None


def test_above_the_take_off_height_it_is_landed_whatever_it_says_of_the_ground() -> None:
    sequence, kinds = Sequence(Config()), list[RequestKind]()
    stale = changed(GROUND, armed=True, mode=FlightMode.TAKEOFF)
    for k in range(400):
        step = tick(stale, 0.05 * k)
        step.fused = msgspec.structs.replace(FUSED, position_ned_m=(0.0, 0.0, -0.31))
        sequence.land(step, 0.05 * k)
        kinds += asked(step)
    assert set(kinds) == {RequestKind.LAND}
    assert len(kinds) == 10


def test_a_vehicle_that_does_not_tell_of_the_ground_is_landed() -> None:
    sequence = Sequence(Config())
    unknown = changed(GROUND, armed=True, landed=LandedState.UNKNOWN, mode=FlightMode.TAKEOFF)
    step = tick(unknown, 0.1)
    assert sequence.land(step, 0.1) is None
    assert asked(step) == [RequestKind.LAND]


@pytest.mark.parametrize(
    ("height_m", "global_position", "goes_on"),
    [(0.84, False, False), (0.86, False, True), (0.99, True, False)],
)
def test_without_a_global_position_the_height_ends_the_takeoff(
    height_m: float, global_position: bool, goes_on: bool
) -> None:
    status = changed(
        GROUND,
        armed=True,
        mode=FlightMode.TAKEOFF,
        landed=LandedState.TAKEOFF,
        global_position=global_position,
    )
    inputs = Inputs(3.0, (), None, None, None, status)
    fused = msgspec.structs.replace(FUSED, position_ned_m=(0.0, 0.0, -height_m))
    move = Sequence(Config()).takeoff(Tick(inputs, fused, 0.05), 3.0)
    assert (move is not None) is goes_on
