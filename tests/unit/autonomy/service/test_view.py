import dataclasses
import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from autonomy.config import Config
from autonomy.model import (
    BeamDoubt,
    BeamWord,
    Command,
    Decision,
    Environment,
    FilterHealth,
    FusedState,
    GuardReport,
    Leg,
    LegKind,
    MissionState,
    NoPlan,
    Obstacle,
    ObstacleKind,
    Plan,
    SourceHealth,
)
from autonomy.service import view
from autonomy.service.metrics import Metrics
from autonomy.service.station import Drawn, FlownMission, Instant, Station
from autonomy.service.stream import Cursor
from hal.readings import (
    Attitude,
    FlightMode,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleStatus,
)

CONFIG = Config()
STATUS = VehicleStatus(9.0, True, FlightMode.OFFBOARD, LandedState.IN_AIR, 0.1)
OFFSET = (2.0, -1.0)
DISC = Obstacle(
    ObstacleKind.DISCRETE, (1.0, 1.0), 0.1, ((0.9, 1.0),), ((1.1, 1.0),), 0.0, 0.0, math.inf
)


def reading(status: RangeStatus, stamp_s: float = 9.9, beam: str = "right") -> RangeReading:
    return RangeReading(stamp_s, beam, status, 0.5, 1e-4, 0.02, 1.0)


def flying() -> Instant:
    fused = FusedState(10.0, (1.0, 0.0, -1.2), (0.3, 0.4, 0.0), math.pi / 2.0, 0.01, 1.2, ok=True)
    decision = Decision(10.0, MissionState.FOLLOW, fused, None, distance_to_go_m=1.5)
    command = Command(decision, None, None, GuardReport(("fence",), 0.1, 0.2))
    return Instant(10.0, STATUS, {"right": reading(RangeStatus.VALID)}, command=command)


def drawn() -> Drawn:
    return Drawn(FlownMission("m", ((3.0, -1.0),), OFFSET), 1)


def station() -> Station:
    station = Station(CONFIG, lambda _: None)
    station.instant, station.drawn = flying(), drawn()
    return station


def test_in_flight_everything_is_in_the_service_s_frame() -> None:
    state = view.state(station())
    assert state.vehicle is not None
    assert state.vehicle.position == (3.0, -1.0)
    assert state.vehicle.height_m == 1.2
    assert state.vehicle.speed_m_s == pytest.approx(0.5)
    assert state.flight is not None
    assert state.flight.goals == ((3.0, -1.0),)
    assert state.guard is not None
    assert state.guard.limits == ("fence",)
    assert state.guard.why == ("the fence was ahead",)


def test_at_rest_the_vehicle_is_where_its_frame_says_less_the_origin() -> None:
    resting = station()
    resting.drawn = None
    resting.instant = Instant(
        10.0,
        STATUS,
        {},
        LocalPosition(10.0, (5.0, 6.0, -0.5), (0.0, 0.0, 0.0)),
        Attitude(10.0, 0.0, 0.0, 1.0, 0.0),
        origin_ned_m=(4.0, 4.0, 0.5),
    )
    vehicle = view.state(resting).vehicle
    assert vehicle is not None
    assert (vehicle.position, vehicle.height_m, vehicle.yaw_rad) == ((1.0, 2.0), 1.0, 1.0)


def test_hits_plans_and_tracks_are_shifted_by_the_mission_s_offset() -> None:
    picture = drawn()
    picture.hits = np.array([[1.0, 2.0]])
    picture.track = [(0.0, 0.0), (1.0, 1.0)]  # the station shifted these already
    legs = (Leg(LegKind.TANGENT, ((0.0, 0.0), (1.0, 0.5)), 1.1, 0.23),)
    picture.plan = Plan(legs, 1.1, 0.23, Environment.DISCRETE, (DISC,), (((0.0, 0.0), (0.0, 1.0)),))
    assert view.hits(picture).points == [[3.0, 1.0]]
    assert view.track(picture, 1).points == [(1.0, 1.0)]
    plan = view.plan(picture)
    assert plan is not None
    assert plan.legs[0].points == ((2.0, -1.0), (3.0, -0.5))
    assert plan.rejected == (((2.0, -1.0), (2.0, 0.0)),)
    assert plan.obstacles[0].centre == (3.0, 0.0)
    assert plan.obstacles[0].hits == ((3.1, 0.0),)


def test_no_plan_shows_its_evidence_and_its_reason() -> None:
    picture = drawn()
    picture.plan = NoPlan("it is walled in", ((1.0, 1.0),), Environment.CONTINUOUS, ())
    plan = view.plan(picture)
    assert plan is not None
    assert (plan.found, plan.why, plan.evidence) == (False, "it is walled in", ((3.0, 0.0),))


def test_a_beam_points_where_its_mount_and_the_heading_say() -> None:
    beams = {beam.name: beam for beam in view.state(station()).beams}
    right = beams["right"]
    assert right.origin == (3.0, -1.0)
    assert right.bearing_rad == pytest.approx(math.pi)
    assert (right.sees, right.range_m, right.health) == ("hit", 0.5, "ok")
    assert beams["front"].health == "not heard yet"
    assert beams["up"].bearing_rad is None


def test_a_beam_that_is_doubted_in_flight_says_why_in_a_word() -> None:
    told = station()
    instant = told.instant
    assert instant is not None
    assert instant.command is not None
    doubt = BeamDoubt("right", BeamWord.STUCK, 1.0, "it says one thing")
    decision = msgspec.structs.replace(instant.command.decision, doubts=(doubt,))
    command = msgspec.structs.replace(instant.command, decision=decision)
    told.instant = dataclasses.replace(instant, command=command)
    health = {beam.name: beam.health for beam in view.state(told).beams}
    assert (health["right"], health["front"]) == ("stuck", "not heard yet")


@pytest.mark.parametrize(
    ("status", "age_s", "word"),
    [
        (RangeStatus.VALID, 0.1, "ok"),
        (RangeStatus.OUT_OF_RANGE, 0.1, "ok"),
        (RangeStatus.TOO_NEAR, 0.1, "ok"),
        (RangeStatus.NO_SIGNAL, 0.1, "no signal"),
        (RangeStatus.SUSPECT, 0.1, "doubted"),
        (RangeStatus.VALID, 0.31, "silent"),
        (RangeStatus.NO_SIGNAL, 0.31, "silent"),
    ],
)
def test_a_beam_s_health_is_one_word(status: RangeStatus, age_s: float, word: str) -> None:
    assert view.health(reading(status), age_s, 0.3) == word


def test_a_watcher_is_told_what_changed_once_and_the_state_always() -> None:
    told = station()
    picture = told.drawn
    assert picture is not None
    cursor = Cursor(told, view.room(CONFIG, None, token_required=False))

    def kinds() -> list[str]:
        return [message.partition('"type":"')[2].partition('"')[0] for message in cursor.news()]

    assert kinds() == ["room", "track", "state"]
    picture.track.append((0.0, 0.0))
    told.tell("note", "hello")
    assert kinds() == ["event", "track", "state"]
    assert kinds() == ["state"]
    picture.plan, picture.plan_version = NoPlan("shut", (), Environment.FREE, ()), 1
    assert kinds() == ["plan", "state"]
    picture.hits_version = 7
    assert [kind for _ in range(8) for kind in kinds() if kind != "state"] == ["hits"]
    told.begin(FlownMission("next", (), (0.0, 0.0)))
    assert kinds() == ["track", "state"]


HEALTH = FilterHealth(
    position=SourceHealth(0.25, 900, 3, 0.05),
    floor=SourceHealth(4.0, 40, 2, 1.5),
    gnss_apart_m=3.5,
    room_sigma_m=0.2,
    floor_steps=1,
    frame_jumps=1,
)


def estimating() -> Station:
    station_ = station()
    assert station_.instant is not None
    assert station_.instant.command is not None
    decision = station_.instant.command.decision
    assert decision.fused is not None
    fused = msgspec.structs.replace(decision.fused, health=HEALTH, room_above_m=0.7)
    command = msgspec.structs.replace(
        station_.instant.command, decision=msgspec.structs.replace(decision, fused=fused)
    )
    station_.instant = replace(station_.instant, command=command)
    return station_


def test_the_filter_is_shown_source_by_source_as_far_as_they_were_heard() -> None:
    state = view.state(estimating())
    assert state.filter is not None
    assert [source.name for source in state.filter.sources] == ["position", "floor"]
    floor = state.filter.sources[1]
    assert (floor.test_ratio, floor.fused, floor.rejected, floor.age_s) == (4.0, 40, 2, 1.5)
    assert (state.filter.gnss_apart_m, state.filter.frame_jumps) == (3.5, 1)
    assert state.vehicle is not None
    assert (state.vehicle.height_agl_m, state.vehicle.room_above_m) == (1.2, 0.7)


def test_without_a_flight_there_is_no_filter_to_show() -> None:
    resting = station()
    resting.instant = Instant(10.0, STATUS, {})
    assert view.state(resting).filter is None


def test_prometheus_has_ratios_counts_and_ages_of_what_was_heard() -> None:
    text = Metrics(estimating()).text().decode()
    assert 'autonomy_filter_test_ratio{source="floor"} 4.0' in text
    assert 'autonomy_filter_measurements_total{source="floor",verdict="rejected"} 2.0' in text
    assert 'autonomy_filter_measurements_total{source="position",verdict="fused"} 900.0' in text
    assert 'autonomy_filter_age_seconds{source="floor"} 1.5' in text
    assert 'autonomy_surface_steps_total{surface="floor"} 1.0' in text
    assert 'autonomy_filter_resets_total{what="frame_jump"} 1.0' in text
    assert "autonomy_gnss_apart_metres 3.5" in text
    assert "autonomy_room_above_metres 0.7" in text
    assert 'source="gnss"' not in text
