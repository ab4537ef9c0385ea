"""Scenarios: one simulated world, the vehicle in it and what goes wrong, as one YAML document.

The frame is the vehicle's local NED frame with its origin at the take-off point; the floor is at
down = 0 and all heights are above the floor. configs/scenarios/README.md explains every key.
"""

import importlib.resources
import math
from collections import Counter
from collections.abc import Iterable
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, model_validator

from hal.config import Fence, Finite, NonNegative, PointNE, Positive
from hal.documents import Section, load_document
from hal.errors import DocumentError
from hal.frames import Vector3
from hal.sim.fault_kinds import Fault, parse_fault

BODY_HALF_HEIGHT_M = 0.08
"""From the centre of a small quadrotor to its skids, or to the top of its canopy."""

Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class Rectangle(NamedTuple):
    """A horizontal rectangle: `half_along_m` lies along bearing `yaw_rad`."""

    centre_ne_m: PointNE
    half_along_m: float
    half_across_m: float
    yaw_rad: float

    def corners(self) -> tuple[PointNE, PointNE, PointNE, PointNE]:
        """The four corners in order around the rectangle."""
        (north, east), a, b = self.centre_ne_m, self.half_along_m, self.half_across_m
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)

        def corner(along: float, across: float) -> PointNE:
            return (north + c * along - s * across, east + s * along + c * across)

        return (corner(a, b), corner(-a, b), corner(-a, -b), corner(a, -b))

    def distance_m(self, north_m: float, east_m: float) -> float:
        """Signed distance from a point to the outline: negative inside."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        dn, de = north_m - self.centre_ne_m[0], east_m - self.centre_ne_m[1]
        along = abs(c * dn + s * de) - self.half_along_m
        across = abs(c * de - s * dn) - self.half_across_m
        outside = math.hypot(max(along, 0.0), max(across, 0.0))
        return outside + min(max(along, across), 0.0)


class Solid(Section):
    """What every obstacle has: a name for people, and how far it reaches up and down.

    `base_m` and `height_m` are the heights of its underside and of its top above the floor;
    a `height_m` of None reaches the ceiling, or endlessly up where there is none.
    """

    label: str = ""
    base_m: NonNegative = 0.0
    height_m: Positive | None = None

    @model_validator(mode="after")
    def _top_is_above_base(self) -> "Solid":
        if self.height_m is not None and self.height_m <= self.base_m:
            raise ValueError(
                f"its top (height_m {self.height_m}) is not above its underside "
                f"(base_m {self.base_m}): both are heights above the floor, raise height_m"
            )
        return self


class Disc(Solid):
    """An upright cylinder: a pillar, a post, a person."""

    kind: Literal["disc"] = "disc"
    centre_ne_m: PointNE
    radius_m: Positive

    def distance_m(self, north_m: float, east_m: float) -> float:
        """Signed horizontal distance from a point to its surface: negative inside."""
        dn, de = north_m - self.centre_ne_m[0], east_m - self.centre_ne_m[1]
        return math.hypot(dn, de) - self.radius_m


class Box(Solid):
    """An upright block; `size_m` is (along, across), along points to bearing `yaw_deg`."""

    kind: Literal["box"] = "box"
    centre_ne_m: PointNE
    size_m: tuple[Positive, Positive]
    yaw_deg: Finite = 0.0

    @property
    def footprint(self) -> Rectangle:
        """Its horizontal outline."""
        along, across = self.size_m
        return Rectangle(self.centre_ne_m, along / 2.0, across / 2.0, math.radians(self.yaw_deg))

    def distance_m(self, north_m: float, east_m: float) -> float:
        """Signed horizontal distance from a point to its surface: negative inside."""
        return self.footprint.distance_m(north_m, east_m)


class Wall(Solid):
    """A straight wall: its middle line runs from one point to another."""

    kind: Literal["wall"] = "wall"
    from_ne_m: PointNE
    to_ne_m: PointNE
    thickness_m: Positive = 0.06

    @model_validator(mode="after")
    def _has_a_length(self) -> "Wall":
        if math.dist(self.from_ne_m, self.to_ne_m) < 0.01:
            raise ValueError(
                f"the wall begins and ends at {self.from_ne_m}: move from_ne_m and to_ne_m at "
                "least 0.01 m apart, or use a box"
            )
        return self

    @property
    def footprint(self) -> Rectangle:
        """Its horizontal outline."""
        (n0, e0), (n1, e1) = self.from_ne_m, self.to_ne_m
        return Rectangle(
            ((n0 + n1) / 2.0, (e0 + e1) / 2.0),
            math.hypot(n1 - n0, e1 - e0) / 2.0,
            self.thickness_m / 2.0,
            math.atan2(e1 - e0, n1 - n0),
        )

    def distance_m(self, north_m: float, east_m: float) -> float:
        """Signed horizontal distance from a point to its surface: negative inside."""
        return self.footprint.distance_m(north_m, east_m)


SimObstacle = Annotated[Disc | Box | Wall, Field(discriminator="kind")]


class Wander(Section):
    """Anywhere in a rectangle: one place after another, drawn with `seed`."""

    low_ne_m: PointNE
    high_ne_m: PointNE
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _has_an_area(self) -> "Wander":
        if not all(low < high for low, high in zip(self.low_ne_m, self.high_ne_m, strict=True)):
            raise ValueError(
                f"low_ne_m {self.low_ne_m} is not south-west of high_ne_m {self.high_ne_m}: "
                "both coordinates must be smaller"
            )
        return self


class Mover(Solid):
    """An upright cylinder that walks: a person, a cart. It sees nothing and gives way to nobody,
    unless `polite_m` says how far from its surface a vehicle makes it stand still.

    It begins at the first point of `path_ne_m`, waits `start_s`, and goes from point to point at
    `speed_m_s`, standing `pause_s` at each. `then` says what comes after the last; with `wander` it
    goes on to random places that can be reached in a straight line past the obstacles.
    """

    radius_m: Positive = 0.2
    speed_m_s: Positive = 0.4
    path_ne_m: Annotated[tuple[PointNE, ...], Field(min_length=1)]
    then: Literal["turn", "circle", "stay"] = "turn"
    wander: Wander | None = None
    start_s: NonNegative = 0.0
    pause_s: NonNegative = 0.0
    polite_m: NonNegative = 0.0

    @model_validator(mode="after")
    def _goes_somewhere(self) -> "Mover":
        if self.wander is None and len(set(self.path_ne_m)) < 2:
            raise ValueError(
                "a mover needs two points in path_ne_m to go between, or wander: give it one, or "
                "write it as an obstacle of kind disc"
            )
        return self


class BeamSimulation(Section):
    """How the simulated range beams measure; what they are mounted on is `hal.config.BeamsConfig`.

    One standard deviation is `sigma_m + sigma_fraction * range`.
    """

    half_angle_deg: Annotated[float, Field(ge=0.0, le=45.0)] = 0.0
    sigma_m: NonNegative = 0.005
    sigma_fraction: NonNegative = 0.01
    quantum_m: NonNegative = 0.01
    dropout_probability: Probability = 0.01
    rate_hz: Positive = 20.0
    delay_s: NonNegative = 0.0


class GnssSimulation(Section):
    """The simulated GNSS receiver, and where on Earth the take-off point is.

    Without one (`present: false`) the local position comes from elsewhere, as from optical flow or
    motion capture, and the vehicle knows no global position and no home.
    """

    present: bool = True
    latitude_deg: Annotated[float, Field(ge=-89.0, le=89.0)] = 47.3977
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 8.5456
    amsl_m: Finite = 488.0
    horizontal_sigma_m: Positive = 0.5
    vertical_sigma_m: Positive = 0.8
    satellites: Annotated[int, Field(ge=4)] = 12
    rate_hz: Positive = 8.0
    delay_s: NonNegative = 0.11

    @property
    def origin(self) -> Vector3:
        """(latitude_deg, longitude_deg, amsl_m) of the take-off point."""
        return (self.latitude_deg, self.longitude_deg, self.amsl_m)


class EstimatorSimulation(Section):
    """How wrong the autopilot's own estimate is: Ornstein-Uhlenbeck noise, per axis.

    It wanders with the standard deviations given and forgets with `correlation_s`.
    """

    position_sigma_m: NonNegative = 0.02
    height_sigma_m: NonNegative = 0.02
    velocity_sigma_m_s: NonNegative = 0.01
    yaw_sigma_deg: NonNegative = 1.0
    correlation_s: Positive = 5.0


class VehicleSimulation(Section):
    """The simulated vehicle: its body, its drag and its autopilot's parameters."""

    drag_per_mass_s: NonNegative = 0.2
    """Deceleration per speed, 1/s: 0.2 is a small real quadrotor, PX4's SIH has 1.0."""
    response: Literal["px4", "ideal"] = "px4"
    """How it follows setpoints: as measured on PX4, or at once."""
    body_radius_m: Positive = 0.15
    body_half_height_m: NonNegative = BODY_HALF_HEIGHT_M
    parameters: dict[str, Finite] = Field(default_factory=lambda: {"COM_OBL_RC_ACT": 5.0})


class Scenario(Section):
    """One world, the vehicle in it, where it should fly, and whether it can get there.

    `reachable` is the verdict that a flight to `goal_ne_m` is expected to end with.
    """

    name: str = Field(min_length=1)
    title: str = ""
    description: str = ""
    obstacles: tuple[SimObstacle, ...] = ()
    movers: tuple[Mover, ...] = ()
    ceiling_m: Positive | None = None
    start_yaw_deg: Finite = 0.0
    goal_ne_m: PointNE = (4.0, 3.0)
    fence: Fence = Field(default_factory=lambda: Fence.rectangle((-10.0, 10.0), (-10.0, 10.0)))
    reachable: bool = True
    beams: BeamSimulation = Field(default_factory=BeamSimulation)
    gnss: GnssSimulation = Field(default_factory=GnssSimulation)
    estimator: EstimatorSimulation = Field(default_factory=EstimatorSimulation)
    vehicle: VehicleSimulation = Field(default_factory=VehicleSimulation)
    faults: tuple[Fault, ...] = ()

    @model_validator(mode="after")
    def _labels_are_unique(self) -> "Scenario":
        labels = (o.label for o in (*self.obstacles, *self.movers) if o.label)
        for label, count in Counter(labels).items():
            if count > 1:
                raise ValueError(
                    f"{count} obstacles have the label {label!r}: give each its own, or none"
                )
        return self

    @model_validator(mode="after")
    def _fits_under_the_ceiling(self) -> "Scenario":
        for index, obstacle in enumerate(self.obstacles):
            top = obstacle.base_m if obstacle.height_m is None else obstacle.height_m
            if self.ceiling_m is not None and top > self.ceiling_m:
                raise ValueError(
                    f"{_called(index, obstacle)} reaches {top} m, above the ceiling at "
                    f"{self.ceiling_m} m: lower it, or raise ceiling_m"
                )
        return self

    @model_validator(mode="after")
    def _movers_begin_elsewhere(self) -> "Scenario":
        for index, mover in enumerate(self.movers):
            begins = mover.path_ne_m[0]
            called = f"mover {mover.label!r}" if mover.label else f"mover {index}"
            if math.hypot(*begins) < mover.radius_m + self.vehicle.body_radius_m:
                raise ValueError(
                    f"{called} begins at ({begins[0]:g}, {begins[1]:g}), on the vehicle at the "
                    "take-off point: begin its path_ne_m elsewhere"
                )
        return self

    @model_validator(mode="after")
    def _ends_are_free(self) -> "Scenario":
        for what, point, remedy in (
            ("the take-off point", (0.0, 0.0), "move the obstacle away"),
            ("the goal", self.goal_ne_m, "move the obstacle or goal_ne_m"),
        ):
            place = f"{what} ({point[0]:g}, {point[1]:g})"
            if self.fence.inside_distance_m(*point) <= 0.0:
                raise ValueError(f"{place} is outside the fence: widen its fence")
            for index, obstacle in enumerate(self.obstacles):
                distance_m = obstacle.distance_m(*point)
                if distance_m < self.vehicle.body_radius_m:
                    how = "inside" if distance_m < 0.0 else f"only {distance_m:.2f} m from"
                    raise ValueError(
                        f"{place} is {how} {_called(index, obstacle)} and the vehicle's body has a "
                        f"radius of {self.vehicle.body_radius_m:g} m: {remedy}"
                    )
        return self


def _called(index: int, obstacle: Disc | Box | Wall) -> str:
    """What to call an obstacle in a sentence."""
    return f"{obstacle.kind} {obstacle.label!r}" if obstacle.label else f"obstacle {index}"


def _folder() -> Traversable:
    """Where the shipped scenarios are: a link to configs/scenarios in a checkout."""
    return importlib.resources.files("hal.sim") / "scenarios"


def shipped_scenarios() -> tuple[str, ...]:
    """The names that `load_scenario` knows, sorted."""
    folder = _folder()
    if not folder.is_dir():
        return ()
    names = (Path(entry.name) for entry in folder.iterdir())
    return tuple(sorted(name.stem for name in names if name.suffix == ".yaml"))


def load_scenario(name_or_path: str) -> Scenario:
    """The shipped scenario of that name, or the one in the YAML file at that path.

    Raises DocumentError when there is none (it lists the names that exist) or when the document
    is not a scenario (it names file, line and key).
    """
    names = shipped_scenarios()
    if name_or_path in names:
        with importlib.resources.as_file(_folder() / f"{name_or_path}.yaml") as path:
            return load_document(path, Scenario)
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1 or path.is_file():
        return load_document(path, Scenario)
    raise DocumentError(
        f"there is no scenario {name_or_path!r}: use one of {', '.join(names)}, "
        "or the path of a YAML file"
    )


def with_faults(scenario: Scenario, lines: Iterable[str]) -> Scenario:
    """The scenario with more faults, each one line as `fault_kinds.parse_fault` reads it.

    Raises DocumentError for a line that is no fault.
    """
    more = tuple(parse_fault(line) for line in lines)
    return scenario.model_copy(update={"faults": (*scenario.faults, *more)})
