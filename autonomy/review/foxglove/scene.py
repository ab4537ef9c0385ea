"""From a flight that is flown again to Foxglove's messages: what is where, drawn in its frame.

Frames: `room` is east-north-up, `ned` the mission frame about the take-off point, `body` the
vehicle, forward-right-down. Every message on a topic says all that there is to say on it, so that
jumping in time shows the right picture.
"""

import math
from collections.abc import Iterable, Iterator, Sequence

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.flightlog.schema import Tick
from autonomy.geometry import Point, distance
from autonomy.mission.guarded import GuardedPilot
from autonomy.model import Decision, MovingObstacle, NoPlan, Obstacle, ObstacleKind, Plan
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.review.foxglove import messages as fox
from hal.config import BeamMount
from hal.frames import Vector3
from hal.readings import RangeReading, RangeStatus
from hal.setpoints import Setpoint

ROOM, NED, BODY = "room", "ned", "body"

TOPICS: dict[str, type[msgspec.Struct]] = {
    "/tf": fox.FrameTransforms,
    "/pose": fox.PoseInFrame,
    "/beams": fox.SceneUpdate,
    "/map": fox.Grid,
    "/hits": fox.PointCloud,
    "/fence": fox.SceneUpdate,
    "/obstacles": fox.SceneUpdate,
    "/movers": fox.SceneUpdate,
    "/plan": fox.SceneUpdate,
    "/candidates": fox.SceneUpdate,
    "/path": fox.SceneUpdate,
    "/setpoints": fox.SceneUpdate,
    "/setpoint/asked": fox.SetpointMessage,
    "/setpoint/sent": fox.SetpointMessage,
    "/state": fox.StateMessage,
    "/estimate": fox.EstimateMessage,
    "/px4": fox.Px4Message,
    "/events": fox.Log,
    "/configuration": fox.ConfigurationMessage,
}
"""Every topic of an export, and what is on it."""

MAP_EVERY_S = 1.0
"""Map, hits and path are told this often, and with every plan."""
PATH_STEP_M = 0.03
_ARROW_S = 1.0
"""A setpoint's arrow is as long as what it flies in this time."""

Message = tuple[str, msgspec.Struct]


def _rgb(hex_colour: int, alpha: float = 1.0) -> fox.Color:
    red, green, blue = ((hex_colour >> shift & 255) / 255.0 for shift in (16, 8, 0))
    return fox.Color(red, green, blue, alpha)


# Okabe and Ito's palette, as in the pictures.
_BLUE, _ORANGE, _GREEN, _RED = 0x0072B2, 0xE69F00, 0x009E73, 0xD55E00
_PURPLE, _SKY, _GREY = 0xCC79A7, 0x56B4E9, 0x8B949E
_LEGS = {
    "straight": _BLUE,
    "tangent": _SKY,
    "arc": _GREEN,
    "hyperbola": _PURPLE,
    "geodesic": _ORANGE,
}
_FREE_RGBA, _ABSENT_RGBA = (0, 158, 115, 60), (0, 0, 0, 0)
_BEAMS = {
    RangeStatus.VALID: _rgb(_RED),
    RangeStatus.SUSPECT: _rgb(_ORANGE),
    RangeStatus.TOO_NEAR: _rgb(_RED),
    RangeStatus.OUT_OF_RANGE: _rgb(_SKY, 0.5),
    RangeStatus.NO_SIGNAL: _rgb(_GREY, 0.5),
}
_DOUBTED = _rgb(_GREY, 0.8)


class Scene:
    """Feeds on ticks in order. Remembers the newest beams, the path, and which rules held."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._mounts = {mount.name: mount for mount in config.beams.mounts}
        self._readings: dict[str, RangeReading] = {}
        self._path: list[fox.Vector3] = []
        self._limits: frozenset[str] = frozenset()
        self._map_due_s = -math.inf
        self._had_movers = True
        self._goals: tuple[Vector3, ...] = ()

    def begin(self, at_s: float, goals: Sequence[Vector3]) -> Iterator[Message]:
        """What stays: fence and goals; and empty scenes, until there is something."""
        stamp = fox.time_of(at_s)
        fence = self._config.guard.fence.outline_ne_m
        up_m = self._config.mission.altitude_m
        goal_marks = tuple(
            fox.CylinderPrimitive(
                fox.Pose(fox.Vector3(*goal)), fox.Vector3(0.15, 0.15, 0.02), 1.0, 1.0, _rgb(_GREEN)
            )
            for goal in goals
        )
        ring = _line(fence, up_m, _rgb(_GREEN), kind=fox.LINE_LOOP)
        yield "/fence", _scene(stamp, "fence", lines=(ring,), cylinders=goal_marks)
        for topic in ("/obstacles", "/plan", "/candidates"):
            yield topic, _scene(stamp, topic[1:])

    def tick(self, tick: Tick, guarded: GuardedPilot) -> Iterator[Message]:
        """Everything that one tick has to say; `guarded` has just flown it."""
        inputs, decision = tick.inputs, tick.command.decision
        stamp = fox.time_of(inputs.now_s)
        self._readings.update((reading.beam, reading) for reading in inputs.ranges)
        yield from self._pose(stamp, decision)
        yield "/beams", self._beams(stamp, decision)
        yield from self._setpoints(stamp, tick)
        yield "/state", self._state(stamp, tick)
        yield "/estimate", _estimate(stamp, decision)
        yield "/px4", _px4(stamp, tick)
        yield from self._events(stamp, tick)
        yield from self._movers(stamp, decision)
        if decision.plan is not None:
            yield from self._plan(stamp, decision, decision.plan)
        if decision.plan is not None or inputs.now_s >= self._map_due_s:
            self._map_due_s = inputs.now_s + MAP_EVERY_S
            yield from self._map(stamp, inputs.now_s, decision, guarded.pilot.sensing.map)

    # ------------------------------------------------------------ the vehicle

    def _pose(self, stamp: fox.Time, decision: Decision) -> Iterator[Message]:
        half = math.sqrt(0.5)
        up = fox.Quaternion(half, half, 0.0, 0.0)  # north is y, east is x, down is -z
        transforms = [fox.FrameTransform(stamp, ROOM, NED, fox.Vector3(), up)]
        fused = decision.fused
        if fused is not None:
            place = fox.Vector3(*fused.position_ned_m)
            turn = fox.quaternion_of(fused.roll_rad, fused.pitch_rad, fused.yaw_rad)
            transforms.append(fox.FrameTransform(stamp, NED, BODY, place, turn))
            if not self._path or _apart_m(self._path[-1], place) > PATH_STEP_M:
                self._path.append(place)
            yield "/pose", fox.PoseInFrame(stamp, NED, fox.Pose(place, turn))
        yield "/tf", fox.FrameTransforms(tuple(transforms))

    def _beams(self, stamp: fox.Time, decision: Decision) -> fox.SceneUpdate:
        doubted = {doubt.beam for doubt in decision.doubts}
        lines = tuple(
            _beam(self._mounts[name], reading, name in doubted)
            for name, reading in sorted(self._readings.items())
            if name in self._mounts
        )
        radius_m = self._config.body.radius_m
        body = fox.SpherePrimitive(
            fox.Pose(), fox.Vector3(2 * radius_m, 2 * radius_m, 0.1), _rgb(_BLUE, 0.35)
        )
        return _scene(stamp, "beams", frame=BODY, lines=lines, spheres=(body,))

    def _setpoints(self, stamp: fox.Time, tick: Tick) -> Iterator[Message]:
        command, fused = tick.command, tick.command.decision.fused
        asked, sent = command.decision.setpoint, command.setpoint
        if asked is not None:
            yield "/setpoint/asked", _setpoint(stamp, asked)
        if sent is not None:
            yield "/setpoint/sent", _setpoint(stamp, sent)
        arrows: tuple[fox.ArrowPrimitive, ...] = ()
        if fused is not None:
            both = ((asked, _rgb(_ORANGE)), (sent, _rgb(_GREEN)))
            arrows = tuple(
                _arrow(fused.position_ned_m, setpoint.velocity_ned_m_s, colour)
                for setpoint, colour in both
                if setpoint is not None
            )
        yield "/setpoints", _scene(stamp, "setpoints", arrows=arrows)

    def _state(self, stamp: fox.Time, tick: Tick) -> fox.StateMessage:
        decision, report = tick.command.decision, tick.command.guard
        fused = decision.fused
        flying = decision.setpoint is not None
        return fox.StateMessage(
            timestamp=stamp,
            state=decision.state.value,
            speed_m_s=fox.finite(
                math.hypot(*fused.velocity_ned_m_s[:2]) if fused is not None else None
            ),
            speed_limit_m_s=fox.finite(decision.speed_limit_m_s if flying else None),
            clearance_m=fox.finite(decision.clearance_m if flying else None),
            free_ahead_m=fox.finite(report.free_distance_m if flying else None),
            distance_to_go_m=fox.finite(decision.distance_to_go_m),
            altitude_m=fox.finite(-fused.position_ned_m[2] if fused is not None else None),
            stops=decision.stops,
            replans=decision.replans,
            guard=", ".join(report.limits),
            faults=", ".join(decision.faults),
            doubted_beams=", ".join(doubt.beam for doubt in decision.doubts),
            step_ms=tick.step_s * 1e3,
        )

    # ------------------------------------------------------------ what was told

    def _events(self, stamp: fox.Time, tick: Tick) -> Iterator[Message]:
        for event in tick.command.decision.events:
            at = fox.time_of(event.stamp_s)
            yield "/events", fox.Log(at, fox.INFO, f"{event.name}: {event.why}", "pilot")
        limits = frozenset(tick.command.guard.limits)
        for rule in sorted(limits - self._limits):
            yield "/events", fox.Log(stamp, fox.WARNING, f"holds back: {rule}", "guard")
        for rule in sorted(self._limits - limits):
            yield "/events", fox.Log(stamp, fox.INFO, f"no longer: {rule}", "guard")
        self._limits = limits

    # ------------------------------------------------------------ the room

    def _plan(self, stamp: fox.Time, decision: Decision, plan: Plan | NoPlan) -> Iterator[Message]:
        up_m = _height_m(decision)
        keep_out_m = plan.keep_out_m if isinstance(plan, Plan) else 0.0
        drawn = [_obstacle(obstacle, keep_out_m, up_m) for obstacle in plan.obstacles]
        yield (
            "/obstacles",
            _scene(
                stamp,
                "obstacles",
                spheres=tuple(sphere for spheres, _ in drawn for sphere in spheres),
                lines=tuple(line for _, lines in drawn for line in lines),
            ),
        )
        if isinstance(plan, NoPlan):
            bar = (_line(plan.evidence, up_m, _rgb(_RED), thickness=0.04),)
            yield "/plan", _scene(stamp, "plan", lines=bar, words=(("no way", plan.reason),))
            yield "/candidates", _scene(stamp, "candidates")
            return
        legs = tuple(
            _line(leg.points, up_m, _rgb(_LEGS.get(leg.kind.value, _BLUE)), thickness=0.03)
            for leg in plan.legs
        )
        words = (
            ("length", f"{plan.length_m:.3f} m"),
            ("keep-out radius", f"{plan.keep_out_m:.3f} m"),
            ("surroundings", plan.environment.value),
        )
        yield "/plan", _scene(stamp, "plan", lines=legs, words=words)
        others = tuple(_line(points, up_m, _rgb(_GREY, 0.8)) for points in plan.rejected)
        yield "/candidates", _scene(stamp, "candidates", lines=others)

    def _movers(self, stamp: fox.Time, decision: Decision) -> Iterator[Message]:
        """Told while there are any, and once when they are gone."""
        if not decision.movers and not self._had_movers:
            return
        self._had_movers = bool(decision.movers)
        up_m = _height_m(decision)
        discs = tuple(_mover(mover, up_m) for mover in decision.movers)
        arrows = tuple(
            _arrow((*mover.point, -up_m), (*mover.velocity_ne_m_s, 0.0), _rgb(_PURPLE))
            for mover in decision.movers
            if mover.moving
        )
        yield "/movers", _scene(stamp, "movers", cylinders=discs, arrows=arrows)

    def _map(
        self, stamp: fox.Time, now_s: float, decision: Decision, seen: ObstacleMap
    ) -> Iterator[Message]:
        down_m = -_height_m(decision)
        yield "/map", _grid(stamp, seen.seen_cells(now_s), self._config.map.cell_m, down_m)
        yield "/hits", _cloud(stamp, seen.hits(), down_m)
        flown = fox.LinePrimitive(
            fox.LINE_STRIP, fox.Pose(), 0.02, tuple(self._path), _rgb(0x24292F)
        )
        yield "/path", _scene(stamp, "path", lines=(flown,))


# ---------------------------------------------------------------- pieces of the picture


def _scene(
    stamp: fox.Time,
    name: str,
    *,
    frame: str = NED,
    words: Iterable[tuple[str, str]] = (),
    arrows: tuple[fox.ArrowPrimitive, ...] = (),
    spheres: tuple[fox.SpherePrimitive, ...] = (),
    cylinders: tuple[fox.CylinderPrimitive, ...] = (),
    lines: tuple[fox.LinePrimitive, ...] = (),
) -> fox.SceneUpdate:
    """One entity, which replaces the one before; what is in the body's frame moves with it."""
    entity = fox.SceneEntity(
        stamp,
        frame,
        name,
        frame_locked=True,
        metadata=tuple(fox.KeyValuePair(key, value) for key, value in words),
        arrows=arrows,
        spheres=spheres,
        cylinders=cylinders,
        lines=lines,
    )
    return fox.SceneUpdate(entities=(entity,))


def _line(
    points: Iterable[Point],
    up_m: float,
    colour: fox.Color,
    *,
    kind: int = fox.LINE_STRIP,
    thickness: float = 0.015,
) -> fox.LinePrimitive:
    places = tuple(fox.Vector3(north, east, -up_m) for north, east in points)
    return fox.LinePrimitive(kind, fox.Pose(), thickness, places, colour)


def _arrow(at: Vector3, velocity: Vector3, colour: fox.Color) -> fox.ArrowPrimitive:
    """A velocity at a place."""
    north, east, down = velocity
    level = math.hypot(north, east)
    turn = fox.quaternion_of(0.0, math.atan2(-down, level), math.atan2(east, north))
    length = _ARROW_S * math.hypot(level, down)
    return fox.ArrowPrimitive(
        fox.Pose(fox.Vector3(*at), turn), 0.8 * length, 0.02, 0.2 * length, 0.05, colour
    )


def _beam(mount: BeamMount, reading: RangeReading, doubted: bool) -> fox.LinePrimitive:  # noqa: FBT001  a fact about it, not a mode
    """From the sensor's face as far as it saw."""
    yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
    start = fox.Vector3(mount.forward_m, mount.right_m, mount.down_m)
    level = reading.range_m * math.cos(pitch)
    end = fox.Vector3(
        start.x + level * math.cos(yaw),
        start.y + level * math.sin(yaw),
        start.z - reading.range_m * math.sin(pitch),
    )
    colour = _DOUBTED if doubted else _BEAMS[reading.status]
    return fox.LinePrimitive(fox.LINE_STRIP, fox.Pose(), 0.01, (start, end), colour)


def _obstacle(
    obstacle: Obstacle, keep_out_m: float, up_m: float
) -> tuple[tuple[fox.SpherePrimitive, ...], tuple[fox.LinePrimitive, ...]]:
    """A discrete one as its keep-out sphere, a continuous one as its hull and one for each hit."""
    if obstacle.kind is ObstacleKind.DISCRETE:
        ring = _sphere(obstacle.centre, obstacle.radius_m + keep_out_m, up_m, _rgb(_PURPLE, 0.3))
        return (ring,), ()
    spheres = tuple(_sphere(hit, keep_out_m, up_m, _rgb(_SKY, 0.08)) for hit in obstacle.hits)
    hull = _line(obstacle.hull, up_m, _rgb(_BLUE), kind=fox.LINE_LOOP, thickness=0.025)
    return spheres, (hull,)


def _sphere(centre: Point, radius_m: float, up_m: float, colour: fox.Color) -> fox.SpherePrimitive:
    width = 2.0 * radius_m
    place = fox.Pose(fox.Vector3(*centre, -up_m))
    return fox.SpherePrimitive(place, fox.Vector3(width, width, width), colour)


def _mover(mover: MovingObstacle, up_m: float) -> fox.CylinderPrimitive:
    width = 2.0 * mover.radius_m
    colour = _rgb(_PURPLE, 0.8 if mover.moving else 0.4)
    place = fox.Pose(fox.Vector3(*mover.point, -up_m))
    return fox.CylinderPrimitive(place, fox.Vector3(width, width, 0.2), 1.0, 1.0, colour)


def _grid(
    stamp: fox.Time, free_ne_m: "np.typing.NDArray[np.float64]", cell_m: float, down_m: float
) -> fox.Grid:
    """The cells seen free, as the smallest grid that holds them; x is north, rows go east."""
    corner = free_ne_m.min(axis=0) if len(free_ne_m) else np.zeros(2)
    index = np.round((free_ne_m - corner) / cell_m).astype(np.int64)
    north, east = (index.max(axis=0) + 1).tolist() if len(index) else (1, 1)
    cells = np.full((east, north, 4), _ABSENT_RGBA, dtype=np.uint8)
    cells[index[:, 1], index[:, 0]] = _FREE_RGBA
    low_n, low_e = (corner - cell_m / 2.0).tolist()
    names = ("red", "green", "blue", "alpha")
    return fox.Grid(
        stamp,
        NED,
        fox.Pose(fox.Vector3(low_n, low_e, down_m)),
        north,
        fox.Vector2(cell_m, cell_m),
        4 * north,
        4,
        tuple(fox.PackedElementField(name, k, fox.UINT8) for k, name in enumerate(names)),
        cells.tobytes(),
    )


def _cloud(
    stamp: fox.Time, hits_ne_m: "np.typing.NDArray[np.float64]", down_m: float
) -> fox.PointCloud:
    points = np.full((len(hits_ne_m), 3), down_m, dtype="<f4")
    points[:, :2] = hits_ne_m
    fields = tuple(fox.PackedElementField(name, 4 * k, fox.FLOAT32) for k, name in enumerate("xyz"))
    return fox.PointCloud(stamp, NED, fox.Pose(), 12, fields, points.tobytes())


# ---------------------------------------------------------------- numbers and words


def _setpoint(stamp: fox.Time, setpoint: Setpoint) -> fox.SetpointMessage:
    speed_m_s = math.hypot(*setpoint.velocity_ned_m_s[:2])
    return fox.SetpointMessage(
        stamp,
        *setpoint.position_ned_m,
        *setpoint.velocity_ned_m_s,
        speed_m_s,
        setpoint.yaw_rad,
    )


def _estimate(stamp: fox.Time, decision: Decision) -> fox.EstimateMessage:
    fused = decision.fused
    if fused is None:
        return fox.EstimateMessage(timestamp=stamp, ok=False, why_not_ok="nothing was heard")
    health = fused.health
    ratios = {
        f"test_ratio_{name}": fox.finite(source.test_ratio if source.age_s is not None else None)
        for name, source in (
            ("position", health.position),
            ("velocity", health.velocity),
            ("gnss", health.gnss),
            ("floor", health.floor),
            ("ceiling", health.ceiling),
        )
    }
    return fox.EstimateMessage(
        timestamp=stamp,
        ok=fused.ok,
        why_not_ok=fused.why_not_ok,
        position_sigma_m=fox.finite(fused.position_sigma_m),
        room_sigma_m=fox.finite(health.room_sigma_m),
        height_agl_m=fox.finite(fused.height_agl_m),
        frame_jumps=health.frame_jumps,
        restarts=health.restarts,
        **ratios,
    )


def _px4(stamp: fox.Time, tick: Tick) -> fox.Px4Message:
    status = tick.inputs.status
    return fox.Px4Message(
        timestamp=stamp,
        mode=status.mode.value,
        armed=status.armed,
        landed=status.landed.value,
        in_failsafe=status.in_failsafe,
        link_age_s=fox.finite(status.link_age_s),
        battery_remaining=fox.finite(status.battery_remaining),
    )


def _height_m(decision: Decision) -> float:
    """The height to draw at: that of the flight, or where the vehicle is."""
    if decision.height_m is not None:
        return decision.height_m
    return -decision.fused.position_ned_m[2] if decision.fused is not None else 0.0


def _apart_m(a: fox.Vector3, b: fox.Vector3) -> float:
    return math.hypot(distance((a.x, a.y), (b.x, b.y)), a.z - b.z)
