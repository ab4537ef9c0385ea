"""From what the station holds to what goes over the wire. Pure; runs on the web side."""

import math

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.model import SOURCES, FusedState, MovingObstacle, NoPlan, Obstacle
from autonomy.service.contract import (
    BeamView,
    FilterView,
    FlightView,
    GuardView,
    Hits,
    LegView,
    MoverView,
    ObstacleView,
    PlanView,
    Room,
    SourceView,
    State,
    Track,
    VehicleView,
)
from autonomy.service.sightings import seen
from autonomy.service.station import Drawn, Instant, Station
from hal.config import BeamMount
from hal.readings import RangeReading, RangeStatus
from hal.vehicle.guard import WORDS

_SEES = {
    RangeStatus.VALID: "hit",
    RangeStatus.SUSPECT: "hit",
    RangeStatus.TOO_NEAR: "too near",
    RangeStatus.OUT_OF_RANGE: "clear",
    RangeStatus.NO_SIGNAL: "nothing",
}


def state(station: Station) -> State:
    """What is true now."""
    instant, drawn = station.instant, station.drawn
    if instant is None:
        return State(0.0, station.phase, station.why, None, (), None, None)
    command = instant.command
    vehicle = _vehicle(instant, drawn)
    guard = None
    if command is not None:
        report = command.guard
        why = tuple(WORDS.get(limit, limit) for limit in report.limits)
        guard = GuardView(report.limits, report.speed_limit_m_s, report.free_distance_m, why)
    return State(
        time_s=instant.now_s,
        phase=station.phase,
        why=station.why,
        vehicle=vehicle,
        beams=beams(station.config, instant, vehicle),
        guard=guard,
        flight=_flight(instant, drawn),
        filter=estimate(command.decision.fused) if command is not None else None,
        faults=seen(station.config, drawn.faults) if command is not None and drawn else (),
        movers=_movers(command.decision.movers, drawn) if command is not None else (),
    )


def _movers(movers: tuple[MovingObstacle, ...], drawn: Drawn | None) -> tuple[MoverView, ...]:
    offset = drawn.flown.offset if drawn is not None else (0.0, 0.0)
    return tuple(
        MoverView(
            _moved((mover.point,), offset)[0], mover.velocity_ne_m_s, mover.radius_m, mover.moving
        )
        for mover in movers
    )


def estimate(fused: FusedState | None) -> FilterView | None:
    """The filter's sources, as far as they were heard."""
    if fused is None:
        return None
    health = fused.health
    sources = [(name, getattr(health, name)) for name in SOURCES]
    return FilterView(
        sources=tuple(
            SourceView(name, each.test_ratio, each.fused, each.rejected, each.age_s)
            for name, each in sources
            if each.fused or each.rejected
        ),
        position_sigma_m=round(fused.position_sigma_m, 4),
        room_sigma_m=health.room_sigma_m,
        gnss_apart_m=health.gnss_apart_m,
        frame_jumps=health.frame_jumps,
        restarts=health.restarts,
    )


def room(config: Config, scenario: str | None, *, token_required: bool) -> Room:
    """What stays."""
    return Room(
        fence=tuple(config.guard.fence.outline_ne_m),
        body_radius_m=config.body.radius_m,
        beam_max_m=config.beams.max_m,
        speed_max_m_s=config.guidance.speed_max_m_s,
        altitude_m=config.mission.altitude_m,
        scenario=scenario,
        token_required=token_required,
    )


def hits(drawn: Drawn) -> Hits:
    """All hits in the service's frame, to the millimetre."""
    moved = np.round(drawn.hits + np.asarray(drawn.flown.offset), 3)
    return Hits(points=moved.tolist())


def track(drawn: Drawn, start: int) -> Track:
    """The flown path from its `start`-th point on."""
    return Track(start, drawn.track[start:])


def plan(drawn: Drawn) -> PlanView | None:
    """The newest plan, or the newest reason why there is none."""
    found, offset = drawn.plan, drawn.flown.offset
    if found is None:
        return None
    obstacles = tuple(_obstacle(obstacle, offset) for obstacle in found.obstacles)
    environment = found.environment.value
    if isinstance(found, NoPlan):
        evidence = _moved(found.evidence, offset)
        return PlanView(
            found=False,
            why=found.reason,
            environment=environment,
            keep_out_m=0.0,
            legs=(),
            rejected=(),
            obstacles=obstacles,
            evidence=evidence,
        )
    return PlanView(
        found=True,
        why=drawn.plan_why,
        environment=environment,
        keep_out_m=found.keep_out_m,
        legs=tuple(LegView(leg.kind.value, _moved(leg.points, offset)) for leg in found.legs),
        rejected=tuple(_moved(line, offset) for line in found.rejected),
        obstacles=obstacles,
        height_m=found.height_m,
    )


def beams(config: Config, instant: Instant, vehicle: VehicleView | None) -> tuple[BeamView, ...]:
    """Every configured beam, heard or not; of one that is doubted in flight, why in a word."""
    doubts = instant.command.decision.doubts if instant.command is not None else ()
    words = {doubt.beam: doubt.word.value for doubt in doubts}
    seen = (
        _beam(mount, instant.readings.get(mount.name), config, instant.now_s, vehicle)
        for mount in config.beams.mounts
    )
    return tuple(
        msgspec.structs.replace(beam, health=words[beam.name]) if beam.name in words else beam
        for beam in seen
    )


def _beam(
    mount: BeamMount,
    reading: RangeReading | None,
    config: Config,
    now_s: float,
    vehicle: VehicleView | None,
) -> BeamView:
    origin = bearing_rad = None
    if mount.horizontal and vehicle is not None:
        c, s = math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad)
        origin = (
            vehicle.position[0] + c * mount.forward_m - s * mount.right_m,
            vehicle.position[1] + s * mount.forward_m + c * mount.right_m,
        )
        bearing_rad = vehicle.yaw_rad + math.radians(mount.yaw_deg)
    if reading is None:
        return BeamView(
            mount.name,
            "not heard yet",
            "nothing",
            None,
            config.beams.max_m,
            None,
            origin,
            bearing_rad,
        )
    age_s = max(0.0, now_s - reading.stamp_s)
    measured = reading.status is not RangeStatus.NO_SIGNAL
    return BeamView(
        name=mount.name,
        health=health(reading, age_s, config.beams.stale_after_s),
        sees=_SEES[reading.status],
        range_m=reading.range_m if measured else None,
        max_m=reading.max_m,
        age_s=age_s,
        origin=origin,
        bearing_rad=bearing_rad,
    )


def health(reading: RangeReading, age_s: float, stale_after_s: float) -> str:
    """A beam's health as a word."""
    if age_s > stale_after_s:
        return "silent"
    if reading.status is RangeStatus.NO_SIGNAL:
        return "no signal"
    return "doubted" if reading.status is RangeStatus.SUSPECT else "ok"


def _vehicle(instant: Instant, drawn: Drawn | None) -> VehicleView | None:
    """The vehicle in the service's frame; None while it says nothing of where it is."""
    status = instant.status
    height_agl_m = room_above_m = None
    if instant.command is not None and drawn is not None:
        fused = instant.command.decision.fused
        if fused is None:
            return None
        position = _moved((fused.point,), drawn.flown.offset)[0]
        height_m, yaw_rad = -fused.position_ned_m[2], fused.yaw_rad
        velocity = (fused.velocity_ned_m_s[0], fused.velocity_ned_m_s[1])
        ok, why_not = fused.ok, fused.why_not_ok
        height_agl_m, room_above_m = fused.height_agl_m, fused.room_above_m
    elif instant.position is not None and instant.attitude is not None:
        local, origin = instant.position.position_ned_m, instant.origin_ned_m
        position = (local[0] - origin[0], local[1] - origin[1])
        height_m, yaw_rad = origin[2] - local[2], instant.attitude.yaw_rad
        velocity = instant.position.velocity_ned_m_s[:2]
        ok, why_not = True, ""
    else:
        return None
    return VehicleView(
        position=position,
        height_m=height_m,
        yaw_rad=yaw_rad,
        velocity=velocity,
        speed_m_s=math.hypot(*velocity),
        position_ok=ok,
        why_not_ok=why_not,
        mode=status.mode.value,
        armed=status.armed,
        landed=status.landed.value,
        battery=status.battery_remaining,
        link_age_s=max(0.0, status.link_age_s) if math.isfinite(status.link_age_s) else 1e6,
        height_agl_m=height_agl_m,
        room_above_m=room_above_m,
    )


def _flight(instant: Instant, drawn: Drawn | None) -> FlightView | None:
    if instant.command is None or drawn is None:
        return None
    decision = instant.command.decision
    return FlightView(
        mission=drawn.flown.id,
        state=decision.state.value,
        goals=drawn.flown.goals,
        distance_to_go_m=decision.distance_to_go_m,
        clearance_m=decision.clearance_m,
        speed_limit_m_s=decision.speed_limit_m_s,
        stops=decision.stops,
        replans=decision.replans,
    )


def _obstacle(obstacle: Obstacle, offset: Point) -> ObstacleView:
    return ObstacleView(
        kind=obstacle.kind.value,
        centre=_moved((obstacle.centre,), offset)[0],
        radius_m=obstacle.radius_m,
        hull=_moved(obstacle.hull, offset),
        hits=_moved(obstacle.hits, offset),
    )


def _moved(points: tuple[Point, ...], offset: Point) -> tuple[Point, ...]:
    return tuple((round(n + offset[0], 4), round(e + offset[1], 4)) for n, e in points)
