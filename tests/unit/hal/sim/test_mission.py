import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import Vector3, geodetic_from_ned
from hal.sim.mission import (
    CHANGE_SPEED,
    DELAY,
    LAND,
    LOITER_TIME,
    LOITER_UNLIMITED,
    RETURN,
    TAKEOFF,
    WAYPOINT,
    Mission,
    MissionItem,
    velocity_to,
)

ORIGIN: Vector3 = (47.3977, 8.5456, 488.0)
HOME: Vector3 = (0.0, 0.0, 0.1)
RADII = (0.5, 0.3)
RELATIVE, AMSL = 6, 5


def item(
    command: int,
    place: Vector3 = (0.0, 0.0, 0.0),
    *parameters: float,
    frame: int = RELATIVE,
) -> MissionItem:
    """An item at a place in NED; its height is above home in the relative frame."""
    latitude, longitude, amsl = geodetic_from_ned(place, ORIGIN)
    filled = (*parameters, *(0.0,) * (4 - len(parameters)))
    height = HOME[2] - place[2] if frame == RELATIVE else amsl
    four = (filled[0], filled[1], filled[2], filled[3])
    return MissionItem(frame, command, four, latitude, longitude, height)


def mission(*items: MissionItem) -> Mission:
    made = Mission()
    made.replace(items)
    made.enter()
    return made


def place_of(flown: Mission, here: Vector3, now_s: float = 0.0) -> Vector3 | None:
    return flown.step(now_s, here, ORIGIN, HOME, RADII).place_ned_m


@pytest.mark.parametrize("frame", [RELATIVE, AMSL])
def test_waypoints_are_flown_in_order_and_told_when_reached(frame: int) -> None:
    places = ((2.0, 0.0, -1.5), (2.0, 2.0, -2.0))
    flown = mission(*(item(WAYPOINT, place, frame=frame) for place in places))
    assert place_of(flown, (0.0, 0.0, -1.5)) == pytest.approx(places[0], abs=1e-6)
    assert flown.current == 0
    assert place_of(flown, places[0]) == pytest.approx(places[1], abs=1e-6)
    assert (flown.current, flown.reached) == (1, [0])
    assert place_of(flown, places[1]) is None
    assert flown.finished
    assert flown.reached == [0, 1]


@pytest.mark.parametrize(
    ("here", "there"),
    [((1.6, 0.0, -1.5), True), ((1.4, 0.0, -1.5), False), ((2.0, 0.0, -1.1), False)],
)
def test_near_enough_is_there(here: Vector3, there: bool) -> None:
    flown = mission(item(WAYPOINT, (2.0, 0.0, -1.5)))
    assert (place_of(flown, here) is None) == there


def test_a_waypoints_own_radius_counts_instead_of_the_parameter() -> None:
    flown = mission(item(WAYPOINT, (2.0, 0.0, -1.5), 0.0, 1.5))
    assert place_of(flown, (0.8, 0.0, -1.5)) is None


@pytest.mark.parametrize("command", [WAYPOINT, LOITER_TIME, DELAY])
def test_waiting_lasts_as_long_as_asked_also_when_blown_away(command: int) -> None:
    there = (2.0, 0.0, -1.5)
    flown = mission(item(command, there, 3.0))
    assert place_of(flown, there, 10.0) is not None
    assert place_of(flown, (2.6, 0.0, -1.5), 12.9) is not None
    assert place_of(flown, there, 13.0) is None


def test_loitering_without_end_has_none() -> None:
    flown = mission(item(LOITER_UNLIMITED, (2.0, 0.0, -1.5)))
    assert place_of(flown, (2.0, 0.0, -1.5), 1e6) is not None


def test_a_speed_holds_from_its_item_on_and_not_for_the_next_mission() -> None:
    flown = mission(
        item(WAYPOINT, (1.0, 0.0, -1.0)),
        item(CHANGE_SPEED, (0.0, 0.0, 0.0), 1.0, 0.7),
        item(WAYPOINT, (5.0, 0.0, -1.0)),
    )
    assert flown.step(0.0, (0.0, 0.0, -1.0), ORIGIN, HOME, RADII).speed_m_s == math.inf
    assert flown.step(1.0, (1.0, 0.0, -1.0), ORIGIN, HOME, RADII).speed_m_s == 0.7
    assert place_of(flown, (5.0, 0.0, -1.0)) is None
    flown.enter()
    assert flown.step(2.0, (0.0, 0.0, -1.0), ORIGIN, HOME, RADII).speed_m_s == math.inf


def test_a_landing_is_over_its_place_first_and_done_on_the_ground() -> None:
    flown = mission(item(LAND, (2.0, 0.0, 0.0)))
    assert place_of(flown, (0.0, 0.0, -1.5)) == pytest.approx((2.0, 0.0, -1.5), abs=1e-6)
    step = flown.step(1.0, (1.9, 0.0, -1.5), ORIGIN, HOME, RADII)
    assert step.land
    assert not flown.finished
    flown.landed()
    assert flown.finished


def test_a_return_is_left_to_the_autopilot() -> None:
    assert mission(item(RETURN)).step(0.0, (3.0, 0.0, -1.0), ORIGIN, HOME, RADII).home


def test_a_take_off_without_a_place_is_here() -> None:
    takeoff = MissionItem(RELATIVE, TAKEOFF, (0.0,) * 4, math.nan, math.nan, 2.0)
    flown = mission(takeoff)
    assert place_of(flown, (1.0, 2.0, 0.0)) == pytest.approx((1.0, 2.0, -1.9))


def test_cameras_and_gimbals_are_taken_and_passed_over() -> None:
    flown = mission(item(2000, frame=2), item(1000, frame=2), item(WAYPOINT, (1.0, 0.0, -1.0)))
    assert place_of(flown, (0.0, 0.0, -1.0)) is not None
    assert flown.current == 2


@pytest.mark.parametrize(
    ("made", "supported"),
    [
        (item(WAYPOINT), True),
        (item(31999), False),
        (item(WAYPOINT, frame=AMSL), True),
        (MissionItem(1, WAYPOINT, (0.0,) * 4, 0.0, 0.0, 0.0), False),
        (MissionItem(2, CHANGE_SPEED, (0.0,) * 4, 0.0, 0.0, 0.0), True),
    ],
)
def test_what_px4_could_not_fly_is_not_supported(made: MissionItem, supported: bool) -> None:
    assert made.supported is supported


def test_another_item_can_be_made_the_current_one_if_there_is_one() -> None:
    flown = mission(*(item(WAYPOINT, (north, 0.0, -1.0)) for north in (1.0, 5.0, 9.0)))
    before = flown.changes
    assert flown.set_current(2)
    assert flown.changes == before + 1
    assert place_of(flown, (0.0, 0.0, -1.0)) == pytest.approx((9.0, 0.0, -1.0), abs=1e-6)
    assert not flown.set_current(3)
    assert not flown.set_current(-1)
    assert flown.current == 2


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-5, -1)), min_size=1, max_size=6
    )
)
def test_flying_to_every_place_reaches_every_item_once(places: list[Vector3]) -> None:
    flown = mission(*(item(WAYPOINT, place) for place in places))
    here: Vector3 = (0.0, 0.0, -1.0)
    for _ in range(len(places) + 1):
        target = place_of(flown, here)
        if target is None:
            break
        here = target
    assert flown.finished
    assert flown.reached == list(range(len(places)))


@settings(max_examples=100, deadline=None)
@given(
    st.tuples(*[st.floats(-20, 20)] * 3),
    st.tuples(*[st.floats(-20, 20)] * 3),
    st.floats(0.1, 5.0),
)
def test_the_velocity_points_there_and_is_never_too_fast(
    place: Vector3, here: Vector3, fastest_m_s: float
) -> None:
    north, east, down = velocity_to(place, here, fastest_m_s, (1.0, 0.7))
    assert math.hypot(north, east) <= fastest_m_s + 1e-9
    assert -1.0 <= down <= 0.7
    to_north, to_east = place[0] - here[0], place[1] - here[1]
    assert north * to_north + east * to_east >= 0.0
    assert abs(north * to_east - east * to_north) < 1e-6
