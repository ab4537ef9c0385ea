"""SDF worlds (as Gazebo reads them): models of boxes and upright cylinders, both ways.

A world's frame is east, north, up. `<frame name="take_off">` and `<frame name="goal">` inside the
world say where the flight begins (default: at 0 0 0) and ends. Collisions count, visuals do not;
planes are the ground and are left out. What SDF has besides and this project cannot fly around
(meshes, spheres, what lies or leans, includes) is refused by name. A document with a DTD is not
read: entities cannot be hidden in one that has none.
"""

import io
import math
import xml.parsers.expat
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, TreeBuilder, indent, tostring

import msgspec
from pydantic import ValidationError

from autonomy.geometry import Point
from hal.config import Fence
from hal.errors import DocumentError
from hal.sim.scenario import Box, Disc, Scenario, SimObstacle

VERSION = "1.9"
BYTES_MAX = 20_000_000
MARGIN_M = 1.0
"""How far the fence reaches beyond all that stands in the world, and both ends."""
ENDLESS_M = 5.0
"""What reaches endlessly up is written this high."""
_LEVEL_RAD = 1e-3


class _Refused(Exception):
    """What is wrong with a document, without its name."""


class Pose(msgspec.Struct, frozen=True):
    """x, y, z (east, north, up) in metres and yaw, anticlockwise from east."""

    east_m: float = 0.0
    north_m: float = 0.0
    up_m: float = 0.0
    yaw_rad: float = 0.0

    def then(self, inner: "Pose") -> "Pose":
        """`inner`, given in this pose's frame, in the frame of this pose."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Pose(
            self.east_m + c * inner.east_m - s * inner.north_m,
            self.north_m + s * inner.east_m + c * inner.north_m,
            self.up_m + inner.up_m,
            self.yaw_rad + inner.yaw_rad,
        )


def read(path: Path) -> Scenario:
    """The first world of an SDF file. Raises DocumentError: file, what is wrong, what to do."""
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        raise DocumentError(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error})") from None
    try:
        return _scenario(_tree(text), path.stem)
    except _Refused as error:
        raise DocumentError(f"{path}: {error}") from None
    except ValidationError as error:
        said = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise DocumentError(f"{path}: {said}") from None


def write(scenario: Scenario, path: Path) -> None:
    """A scenario as an SDF world with a ground; movers, fence and noise are left out."""
    root = Element("sdf", version=VERSION)
    world = SubElement(root, "world", name=scenario.name.replace(":", "_").replace(" ", "_"))
    for name, (north, east) in (("take_off", (0.0, 0.0)), ("goal", scenario.goal_ne_m)):
        frame = SubElement(world, "frame", name=name)
        SubElement(frame, "pose").text = _numbers(east, north, 0.0, 0.0, 0.0, 0.0)
    ground = _solid(world, "ground", Pose())
    SubElement(SubElement(ground, "plane"), "normal").text = "0 0 1"
    ceiling_m = scenario.ceiling_m or ENDLESS_M
    for index, obstacle in enumerate(scenario.obstacles):
        top_m = obstacle.height_m or max(ceiling_m, obstacle.base_m + 1.0)
        middle_m, height_m = 0.5 * (obstacle.base_m + top_m), top_m - obstacle.base_m
        name = (obstacle.label or f"{obstacle.kind} {index}").replace(" ", "_")
        if isinstance(obstacle, Disc):
            north, east = obstacle.centre_ne_m
            shape = SubElement(_solid(world, name, Pose(east, north, middle_m)), "cylinder")
            SubElement(shape, "radius").text = _numbers(obstacle.radius_m)
            SubElement(shape, "length").text = _numbers(height_m)
            continue
        outline = obstacle.footprint
        north, east = outline.centre_ne_m
        pose = Pose(east, north, middle_m, 0.5 * math.pi - outline.yaw_rad)
        size = (2.0 * outline.half_along_m, 2.0 * outline.half_across_m, height_m)
        shape = SubElement(_solid(world, name, pose), "box")
        SubElement(shape, "size").text = _numbers(*size)
    indent(root)
    path.write_bytes(tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")


def _solid(world: Element, name: str, pose: Pose) -> Element:
    """A static model with one collision; its geometry."""
    model = SubElement(world, "model", name=name)
    SubElement(model, "static").text = "true"
    SubElement(model, "pose").text = _numbers(
        pose.east_m, pose.north_m, pose.up_m, 0.0, 0.0, pose.yaw_rad
    )
    link = SubElement(model, "link", name="link")
    return SubElement(SubElement(link, "collision", name="collision"), "geometry")


def _numbers(*values: float) -> str:
    return " ".join(repr(round(value, 9)) for value in values)


# ---------------------------------------------------------------- reading


def _tree(text: bytes) -> Element:
    if len(text) > BYTES_MAX:
        raise _Refused(f"is larger than {BYTES_MAX:,} bytes; is it the right file?")
    builder = TreeBuilder()
    parser = xml.parsers.expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data

    def refused(*_: object) -> None:
        raise _Refused("has a document type, which can hide entities; take <!DOCTYPE ...> out")

    parser.StartDoctypeDeclHandler = refused
    try:
        parser.ParseFile(io.BytesIO(text))
    except xml.parsers.expat.ExpatError as error:
        raise _Refused(f"is no XML ({error}); export the world as SDF again") from None
    return builder.close()


def _scenario(root: Element, name: str) -> Scenario:
    world = root.find("world")
    if root.tag != "sdf" or world is None:
        raise _Refused("holds no <sdf> with a <world>; name the world's file, not a model's")
    if world.find("include") is not None:
        raise _Refused("includes models of other files; merge them into this one")
    start = _frame(world, "take_off") or (0.0, 0.0)
    goal = _frame(world, "goal")
    if goal is None:
        raise _Refused('has no goal; add <frame name="goal"><pose>X Y 0 0 0 0</pose></frame>')
    things: list[SimObstacle] = []
    for model in world.findall("model"):
        things.extend(_model(model, start))
    there = (goal[0] - start[0], goal[1] - start[1])
    return Scenario(
        name=name, obstacles=tuple(things), goal_ne_m=there, fence=_fence(things, there)
    )


def _frame(world: Element, name: str) -> Point | None:
    """(north, east) of a named frame; None when there is none."""
    for frame in world.findall("frame"):
        if frame.get("name") == name:
            pose = _pose(frame, f"frame {name}")
            return (pose.north_m, pose.east_m)
    return None


def _model(model: Element, start: Point) -> Iterator[SimObstacle]:
    called = f"model {model.get('name', '')!r}"
    if model.find("model") is not None or model.find("include") is not None:
        raise _Refused(f"{called} holds other models; flatten it")
    at = _pose(model, called)
    for link in model.findall("link"):
        in_link = at.then(_pose(link, called))
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            shape = geometry[0] if geometry is not None and len(geometry) else None
            if shape is None:
                raise _Refused(f"{called} has a collision without a geometry; give it a box")
            if shape.tag == "plane":
                continue
            yield _obstacle(shape, in_link.then(_pose(collision, called)), start, called)


def _obstacle(shape: Element, pose: Pose, start: Point, called: str) -> Box | Disc:
    centre = (pose.north_m - start[0], pose.east_m - start[1])
    if shape.tag == "cylinder":
        (radius_m,) = _values(shape, "radius", 1, called)
        (height_m,) = _values(shape, "length", 1, called)
        base_m, top_m = _reach(pose, height_m, called)
        return Disc(centre_ne_m=centre, radius_m=radius_m, base_m=base_m, height_m=top_m)
    if shape.tag == "box":
        x, y, height_m = _values(shape, "size", 3, called)
        base_m, top_m = _reach(pose, height_m, called)
        return Box(
            centre_ne_m=centre,
            size_m=(x, y),
            yaw_deg=90.0 - math.degrees(pose.yaw_rad),
            base_m=base_m,
            height_m=top_m,
        )
    raise _Refused(f"{called} is a {shape.tag}; replace it by boxes and upright cylinders")


def _reach(pose: Pose, height_m: float, called: str) -> tuple[float, float]:
    """Heights of underside and top above the ground; what is under the ground does not count."""
    base_m, top_m = pose.up_m - 0.5 * height_m, pose.up_m + 0.5 * height_m
    if top_m <= 0.0:
        raise _Refused(f"{called} lies under the ground (top at {top_m:g} m); raise its pose")
    return (max(0.0, base_m) if base_m > 1e-6 else 0.0), top_m


def _pose(element: Element, called: str) -> Pose:
    found = element.find("pose")
    if found is None:
        return Pose()
    if found.get("relative_to") not in (None, "", "world"):
        raise _Refused(f"{called} has a pose relative to something else; give it in its parent's")
    x, y, z, roll, pitch, yaw = _floats(found.text, 6, f"{called}: <pose>")
    if found.get("degrees") == "true":
        roll, pitch, yaw = (math.radians(angle) for angle in (roll, pitch, yaw))
    if max(abs(roll), abs(pitch)) > _LEVEL_RAD:
        raise _Refused(f"{called} leans or lies (roll or pitch); only upright ones can be flown")
    return Pose(x, y, z, yaw)


def _values(shape: Element, key: str, count: int, called: str) -> tuple[float, ...]:
    found = shape.find(key)
    values = _floats(found.text if found is not None else None, count, f"{called}: <{key}>")
    if min(values) <= 0.0:
        raise _Refused(f"{called}: <{key}> is {min(values):g}; make it greater than 0")
    return values


def _floats(text: str | None, count: int, called: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in (text or "").split())
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise _Refused(f"{called} is {text!r}; write {count} number{'s' if count > 1 else ''}")
    return values


def _fence(things: list[SimObstacle], goal: Point) -> Fence:
    """A rectangle about all there is."""
    points: list[Point] = [(0.0, 0.0), goal]
    for thing in things:
        if isinstance(thing, Disc):
            (north, east), r = thing.centre_ne_m, thing.radius_m
            points += [(north - r, east - r), (north + r, east + r)]
        else:
            points += list(thing.footprint.corners())
    norths, easts = zip(*points, strict=True)
    return Fence.rectangle(
        (min(norths) - MARGIN_M, max(norths) + MARGIN_M),
        (min(easts) - MARGIN_M, max(easts) + MARGIN_M),
    )
