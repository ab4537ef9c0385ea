"""Configuration of the hardware layer, and the one way a YAML document becomes a model.

Angles are degrees in YAML (`_deg`) and radians in code; everything else is SI.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hal.errors import DocumentError

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
PointNE = tuple[Finite, Finite]


class Section(BaseModel):
    """A part of a document: unknown keys are refused, values never change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BeamMount(Section):
    """Where one range beam sits on the body and where it looks.

    Yaw is clockwise from the nose (right = 90), pitch is up from the horizon (up = 90).
    """

    name: str = Field(min_length=1)
    yaw_deg: Finite = 0.0
    pitch_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    forward_m: Finite = 0.0
    right_m: Finite = 0.0
    down_m: Finite = 0.0

    @property
    def horizontal(self) -> bool:
        """True for a beam that maps the plane of flight."""
        return abs(self.pitch_deg) < 30.0


def six_beams() -> tuple[BeamMount, ...]:
    """Front, back, left, right, up, down: the paper's set (section 3)."""
    return (
        BeamMount(name="front", yaw_deg=0.0),
        BeamMount(name="right", yaw_deg=90.0),
        BeamMount(name="back", yaw_deg=180.0),
        BeamMount(name="left", yaw_deg=270.0),
        BeamMount(name="up", pitch_deg=90.0),
        BeamMount(name="down", pitch_deg=-90.0),
    )


class BeamsConfig(Section):
    """The set of beams and what they have in common."""

    mounts: tuple[BeamMount, ...] = Field(default_factory=six_beams)
    min_m: NonNegative = 0.02
    max_m: Positive = 1.0
    latency_s: NonNegative = 0.02
    stale_after_s: Positive = 0.3

    @model_validator(mode="after")
    def _names_are_unique(self) -> "BeamsConfig":
        names = [mount.name for mount in self.mounts]
        if len(set(names)) != len(names):
            raise ValueError("two beams have the same name: give each its own")
        if self.min_m >= self.max_m:
            raise ValueError("min_m must be below max_m")
        return self


class Fence(Section):
    """A horizontal polygon in local NED (north, east) that the vehicle's centre stays inside."""

    polygon_ne_m: tuple[PointNE, ...] = Field(min_length=3)

    @classmethod
    def rectangle(cls, north: tuple[float, float], east: tuple[float, float]) -> "Fence":
        """The axis-parallel rectangle with the given (low, high) limits."""
        (n0, n1), (e0, e1) = north, east
        return cls(polygon_ne_m=((n0, e0), (n1, e0), (n1, e1), (n0, e1)))

    def bounds(self) -> tuple[float, float, float, float]:
        """(north_min, north_max, east_min, east_max)."""
        norths = [p[0] for p in self.polygon_ne_m]
        easts = [p[1] for p in self.polygon_ne_m]
        return min(norths), max(norths), min(easts), max(easts)

    def inside_distance_m(self, north_m: float, east_m: float) -> float:
        """Signed distance to the boundary: positive inside, negative outside."""
        inside = False
        nearest = math.inf
        points = self.polygon_ne_m
        for (n0, e0), (n1, e1) in zip(points, points[1:] + points[:1], strict=True):
            if (e0 > east_m) != (e1 > east_m) and north_m < (n1 - n0) * (east_m - e0) / (
                e1 - e0
            ) + n0:
                inside = not inside
            dn, de = n1 - n0, e1 - e0
            length2 = dn * dn + de * de
            along = ((north_m - n0) * dn + (east_m - e0) * de) / length2 if length2 else 0.0
            along = min(1.0, max(0.0, along))
            nearest = min(nearest, math.hypot(north_m - n0 - along * dn, east_m - e0 - along * de))
        return nearest if inside else -nearest


class GuardConfig(Section):
    """Limits that every setpoint obeys, whoever planned it (hal/vehicle/guard.py)."""

    speed_max_m_s: Positive = 0.25
    climb_max_m_s: Positive = 0.5
    altitude_min_m: NonNegative = 0.3
    altitude_max_m: Positive = 2.0
    fence: Fence = Field(default_factory=lambda: Fence.rectangle((-10.0, 10.0), (-10.0, 10.0)))
    setpoint_max_age_s: Positive = 0.2
    position_max_age_s: Positive = 0.3
    leash_m: Positive = 0.6
    """How far the setpoint's position may lie from the vehicle's."""
    reaction_s: NonNegative = 0.6
    """How long the vehicle flies on before it brakes: one tick, the link, PX4's own lag."""
    braking_m_s2: Positive = 0.5
    """With `reaction_s`: bounds the measured stop of a held position (hal/vehicle/guard.py)."""
    position_gain_per_s: NonNegative = 0.95
    """PX4's MPC_XY_P: what a position error adds to the velocity command."""
    beam_stop_m: Positive = 0.185
    """No approach along a beam that reads nearer than this from the vehicle's centre."""

    @model_validator(mode="after")
    def _band_is_a_band(self) -> "GuardConfig":
        if self.altitude_min_m >= self.altitude_max_m:
            raise ValueError("altitude_min_m must be below altitude_max_m")
        return self


class DeadmanConfig(Section):
    """The thread that stops the vehicle when the control loop does not feed it."""

    timeout_s: Positive = 0.25
    hold_after_s: Positive = 1.0


CONNECTION_SCHEMES = (
    *("udpin", "udpout", "tcpin", "tcpout", "serial", "serial_flowcontrol"),
    *("udp", "tcp", "raw"),
)
"""How a connection URL may begin, before `://`; the last three are older spellings."""


class VehicleConfig(Section):
    """How the autopilot is reached."""

    driver: Literal["mavsdk"] = "mavsdk"
    connection: str = "udpin://0.0.0.0:14540"
    connect_timeout_s: Positive = 10.0
    request_timeout_s: Positive = 3.0
    link_timeout_s: Positive = 1.5


Model = TypeVar("Model", bound=BaseModel)


def load_document(path: Path, model: type[Model]) -> Model:
    """The YAML file at `path` as a validated `model`.

    Raises DocumentError: one sentence with file, line, key and what to do.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise DocumentError(f"{path}: there is no such file; check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DocumentError(f"{path}: cannot be read ({error})") from None
    try:
        data = yaml.safe_load(text)
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"{mark.line + 1}" if mark is not None else "?"
        problem = getattr(error, "problem", None) or "it is not YAML"
        raise DocumentError(f"{path}:{line}: not valid YAML: {problem}") from None
    return validate_document(data if data is not None else {}, model, str(path), tree)


def validate_document(
    data: Any, model: type[Model], name: str, tree: yaml.Node | None = None
) -> Model:
    """`data` as a validated `model`; `name` and `tree` place the error sentence."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        errors = error.errors()
        # A misspelt key is both missing and unknown: the unknown one is what was typed.
        first = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
        location = tuple(part for part in first["loc"] if not str(part).startswith("function-"))
        line = _line_of(tree, location)
        words = [f"{name}:{line}" if line is not None else name]
        if location:
            words.append(".".join(str(part) for part in location))
        more = len(errors) - 1
        tail = f" (and {more} more)" if more else ""
        words.append(f"{_advice(first['type'], first['msg'], first['input'])}{tail}")
        raise DocumentError(": ".join(words)) from None


def _advice(kind: str, message: str, given: Any) -> str:
    if kind == "extra_forbidden":
        return "is not a known key; remove it or correct its spelling"
    if kind == "missing":
        return "is missing; add it"
    text = message.removeprefix("Value error, ")
    said = text[:1].lower() + text[1:]
    return f"{said}, not {given!r}" if isinstance(given, str | int | float) else said


def _line_of(tree: yaml.Node | None, location: tuple[int | str, ...]) -> int | None:
    """Line (1-based) of the deepest node that `location` leads to."""
    node = tree
    line = None
    for part in location:
        if isinstance(node, yaml.MappingNode):
            for key_node, value_node in node.value:
                if key_node.value == str(part):
                    line, node = key_node.start_mark.line + 1, value_node
                    break
        elif (
            isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value)
        ):
            node = node.value[part]
            line = node.start_mark.line + 1
    return line
