"""Foxglove's well-known messages, as far as a flight needs them, and those of this program.

Field names and meanings are Foxglove's (docs.foxglove.dev, message schemas); tests decode what is
written here with Foxglove's own protobuf definitions. Lengths in metres, angles in radians.
"""

import json
import math
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

_S_IN_NS = 1_000_000_000


class Time(msgspec.Struct, frozen=True, gc=False):
    """A moment, or a duration."""

    sec: int = 0
    nsec: int = 0


def time_of(at_s: float) -> Time:
    """The moment `at_s` on the log's clock."""
    return Time(*divmod(max(0, round(at_s * _S_IN_NS)), _S_IN_NS))


class Vector2(msgspec.Struct, frozen=True, gc=False):
    """Foxglove's Vector2."""

    x: float
    y: float


class Vector3(msgspec.Struct, frozen=True, gc=False):
    """Foxglove's Vector3 and Point3."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True, gc=False):
    """A rotation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


def quaternion_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """The rotation by Z-Y-X Euler angles."""
    cr, sr = math.cos(roll_rad / 2.0), math.sin(roll_rad / 2.0)
    cp, sp = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    cy, sy = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


class Pose(msgspec.Struct, frozen=True, gc=False):
    """A place and a rotation."""

    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


class Color(msgspec.Struct, frozen=True, gc=False):
    """Each of 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class KeyValuePair(msgspec.Struct, frozen=True, gc=False):
    """A word about an entity."""

    key: str
    value: str


class ArrowPrimitive(msgspec.Struct, frozen=True, gc=False):
    """An arrow along +x of its pose."""

    pose: Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


class CubePrimitive(msgspec.Struct, frozen=True, gc=False):
    """A box about its centre."""

    pose: Pose
    size: Vector3
    color: Color


class SpherePrimitive(msgspec.Struct, frozen=True, gc=False):
    """An ellipsoid about its centre; `size` are diameters."""

    pose: Pose
    size: Vector3
    color: Color


class CylinderPrimitive(msgspec.Struct, frozen=True, gc=False):
    """An upright cylinder about its centre."""

    pose: Pose
    size: Vector3
    bottom_scale: float
    top_scale: float
    color: Color


LINE_STRIP, LINE_LOOP, LINE_LIST = 0, 1, 2


class LinePrimitive(msgspec.Struct, frozen=True, gc=False):
    """A polyline; `type` is LINE_STRIP, LINE_LOOP or LINE_LIST."""

    type: int
    pose: Pose
    thickness: float
    points: tuple[Vector3, ...]
    color: Color
    scale_invariant: bool = False
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


class TriangleListPrimitive(msgspec.Struct, frozen=True, gc=False):
    """Triangles."""

    pose: Pose
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


class TextPrimitive(msgspec.Struct, frozen=True, gc=False):
    """A label."""

    pose: Pose
    billboard: bool
    font_size: float
    scale_invariant: bool
    color: Color
    text: str


class ModelPrimitive(msgspec.Struct, frozen=True, gc=False):
    """A mesh; never drawn here, and part of an entity all the same."""

    pose: Pose
    scale: Vector3
    color: Color
    override_color: bool
    url: str
    media_type: str
    data: bytes


class SceneEntity(msgspec.Struct, frozen=True, gc=False):
    """What is drawn under one name; it replaces what had that name before on its topic."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time = Time()
    frame_locked: bool = False
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[ArrowPrimitive, ...] = ()
    cubes: tuple[CubePrimitive, ...] = ()
    spheres: tuple[SpherePrimitive, ...] = ()
    cylinders: tuple[CylinderPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[TriangleListPrimitive, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[ModelPrimitive, ...] = ()


class SceneEntityDeletion(msgspec.Struct, frozen=True, gc=False):
    """Takes an entity away."""

    timestamp: Time
    type: int
    id: str


class SceneUpdate(msgspec.Struct, frozen=True, gc=False):
    """What is new in the scene."""

    deletions: tuple[SceneEntityDeletion, ...] = ()
    entities: tuple[SceneEntity, ...] = ()


class FrameTransform(msgspec.Struct, frozen=True, gc=False):
    """Where a frame lies in its parent."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class FrameTransforms(msgspec.Struct, frozen=True, gc=False):
    """Several of them."""

    transforms: tuple[FrameTransform, ...]


class PoseInFrame(msgspec.Struct, frozen=True, gc=False):
    """Where something is."""

    timestamp: Time
    frame_id: str
    pose: Pose


UINT8, FLOAT32 = 1, 7


class PackedElementField(msgspec.Struct, frozen=True, gc=False):
    """One field of packed data; `type` is UINT8 or FLOAT32."""

    name: str
    offset: int
    type: int


class Grid(msgspec.Struct, frozen=True, gc=False):
    """Cells in the x-y plane of `pose`, x first."""

    timestamp: Time
    frame_id: str
    pose: Pose
    column_count: int
    cell_size: Vector2
    row_stride: int
    cell_stride: int
    fields: tuple[PackedElementField, ...]
    data: bytes


class PointCloud(msgspec.Struct, frozen=True, gc=False):
    """Points."""

    timestamp: Time
    frame_id: str
    pose: Pose
    point_stride: int
    fields: tuple[PackedElementField, ...]
    data: bytes


INFO, WARNING, ERROR = 2, 3, 4


class Log(msgspec.Struct, frozen=True, gc=False):
    """A line for people; `level` is INFO, WARNING or ERROR."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


# ---------------------------------------------------------------- this program's own


class SetpointMessage(msgspec.Struct, frozen=True, gc=False):
    """A setpoint, in the mission frame."""

    timestamp: Time
    north_m: float
    east_m: float
    down_m: float
    velocity_north_m_s: float
    velocity_east_m_s: float
    velocity_down_m_s: float
    speed_m_s: float
    yaw_rad: float


class StateMessage(msgspec.Struct, frozen=True, gc=False, kw_only=True):
    """What the mission is at; several words are joined by commas."""

    timestamp: Time
    state: str
    speed_m_s: float | UnsetType = UNSET
    speed_limit_m_s: float | UnsetType = UNSET
    clearance_m: float | UnsetType = UNSET
    free_ahead_m: float | UnsetType = UNSET
    distance_to_go_m: float | UnsetType = UNSET
    altitude_m: float | UnsetType = UNSET
    stops: int
    replans: int
    guard: str
    faults: str
    doubted_beams: str
    step_ms: float


class EstimateMessage(msgspec.Struct, frozen=True, gc=False, kw_only=True):
    """How the position filter gets on; a source that was never heard is absent."""

    timestamp: Time
    ok: bool
    why_not_ok: str
    position_sigma_m: float | UnsetType = UNSET
    room_sigma_m: float | UnsetType = UNSET
    height_agl_m: float | UnsetType = UNSET
    test_ratio_position: float | UnsetType = UNSET
    test_ratio_velocity: float | UnsetType = UNSET
    test_ratio_gnss: float | UnsetType = UNSET
    test_ratio_floor: float | UnsetType = UNSET
    test_ratio_ceiling: float | UnsetType = UNSET
    frame_jumps: int = 0
    restarts: int = 0


class Px4Message(msgspec.Struct, frozen=True, gc=False, kw_only=True):
    """What the autopilot says of itself."""

    timestamp: Time
    mode: str
    armed: bool
    landed: str
    in_failsafe: bool
    link_age_s: float | UnsetType = UNSET
    battery_remaining: float | UnsetType = UNSET


class ConfigurationMessage(msgspec.Struct, frozen=True, gc=False):
    """What was flown with: `configuration` and `versions` are JSON."""

    timestamp: Time
    scenario: str
    started_utc: str
    configuration: str
    versions: str


OWN = (SetpointMessage, StateMessage, EstimateMessage, Px4Message, ConfigurationMessage)


def finite(value: float | None) -> float | UnsetType:
    """The number, or nothing where there is none: JSON has no infinity and no NaN."""
    return value if value is not None and math.isfinite(value) else UNSET


def schema_name(kind: type[msgspec.Struct]) -> str:
    """Foxglove's name of a well-known message, `autonomy.` and a word for our own."""
    if kind in OWN:
        return f"autonomy.{kind.__name__.removesuffix('Message')}"
    return f"foxglove.{kind.__name__}"


def json_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The schema of a message in one piece: Foxglove follows no references."""
    whole = msgspec.json.schema(kind)
    plain: dict[str, Any] = _in_one_piece(whole, whole.get("$defs", {}))
    return plain | {"title": schema_name(kind)}


def schema_bytes(kind: type[msgspec.Struct]) -> bytes:
    """`json_schema` as it stands in the file."""
    return json.dumps(json_schema(kind), separators=(",", ":")).encode()


def _in_one_piece(node: Any, definitions: dict[str, Any]) -> Any:
    if isinstance(node, list):
        return [_in_one_piece(each, definitions) for each in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        return _in_one_piece(definitions[node["$ref"].rsplit("/", 1)[1]], definitions)
    kept = {key: value for key, value in node.items() if key not in ("$defs", "default")}
    return {key: _in_one_piece(value, definitions) for key, value in kept.items()}
