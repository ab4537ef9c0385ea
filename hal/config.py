"""Configuration of the hardware layer: sections of a document (hal/documents.py).

Angles are degrees in YAML (`_deg`) and radians in code; everything else is SI.
"""

from functools import cached_property
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, model_validator

from hal import fence
from hal.documents import Section

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
PointNE = tuple[Finite, Finite]


class BeamMount(Section):
    """Where one range beam sits on the body and where it looks.

    Yaw is clockwise from the nose (right = 90), pitch is up from the horizon (up = 90).
    """

    name: str = Field(min_length=1)
    """By which drivers, faults and pages know it."""
    yaw_deg: Finite = 0.0
    """Bearing of the axis from the nose, clockwise: right is 90."""
    pitch_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    """Elevation of the axis above the horizon: up is 90, down -90."""
    forward_m: Finite = 0.0
    """Place of the sensor's face, ahead of the vehicle's centre ..."""
    right_m: Finite = 0.0
    """... to the right of it ..."""
    down_m: Finite = 0.0
    """... and below it."""
    half_angle_deg: Annotated[float, Field(ge=0.0, le=30.0)] | None = None
    """How far off its axis the beam still sees; 0 is a thin ray. null: what the data sheet says of
    the sensor that is listed for it under `drivers`, else 0 (`BeamsConfig.half_angle_deg`)."""
    offset_m: Finite = 0.0
    """How much the sensor reads too far; every driver takes it off (`autonomy calibrate`)."""
    sigma_m: NonNegative = 0.0
    """Measured noise, one sigma; no reading of this beam is told to be more certain."""
    latency_s: NonNegative | None = None
    """From the measurement to the time that the driver knows of; null: what the driver's kind has
    (`BeamsConfig.latency_of`)."""

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


class WiredBeam(NamedTuple):
    """A sensor on this computer, as its driver's section describes it."""

    name: str
    """Of the mount."""
    half_angle_deg: float = 0.0
    """How far off its axis it sees; 0 is a thin ray."""
    period_s: float = 0.0
    """From one measurement to the next, at least; 0: not known here."""


class DriverSection(Section):
    """What every entry of `beams.drivers` is asked; one that answers nothing has what comes over
    the vehicle's link.
    """

    def beams_of(self) -> tuple[WiredBeam, ...]:
        """The beams whose sensors this driver reads on this computer, one entry a sensor."""
        return ()

    def port(self) -> str | None:
        """What no two drivers may open; None: nothing."""
        return None


class MavlinkDriver(DriverSection):
    """Beams that come over the vehicle's link: all that nobody else drives."""

    driver: Literal["mavlink"] = "mavlink"
    """Which driver this is."""
    obstacle_distance: bool = True
    """Beside DISTANCE_SENSOR, listen to OBSTACLE_DISTANCE, too."""


I2cAddress = Annotated[int, Field(ge=0x08, le=0x77)]
"""Seven bits, without the ones that the bus reserves."""
GpioName = Annotated[str, Field(pattern=r"^(gpiochip[0-9]+|sysfs)/[0-9]+$")]
"""A line of a GPIO chip, `gpiochip0/17`, or one of /sys/class/gpio, `sysfs/529`."""

TOF_ADDRESS = 0x29
"""Where VL53L0X and VL53L1X answer after power-up (both data sheets: 0x52 with the R/W bit)."""


SHARP_REFRESH_S = 0.0383
"""Time between a Sharp sensor's own measurements (data sheets: 38.3 +- 9.6 ms)."""


class I2cPlace(Section):
    """Which beam a sensor is, and where its bus ends: directly, or behind a TCA9548A."""

    beam: str = Field(min_length=1)
    """Name of its mount."""
    mux_address: Annotated[int, Field(ge=0x70, le=0x77)] | None = None
    """Of the TCA9548A that it hangs behind; null: on the bus itself."""
    mux_channel: Annotated[int, Field(ge=0, le=7)] | None = None
    """Of that multiplexer; both are given, or none."""

    @model_validator(mode="after")
    def _a_channel_needs_its_multiplexer(self) -> "I2cPlace":
        if (self.mux_address is None) != (self.mux_channel is None):
            raise ValueError("mux_address and mux_channel belong together: give both or none")
        return self

    @property
    def segment(self) -> tuple[int, int] | None:
        """(multiplexer, channel), or None for the bus itself."""
        if self.mux_address is None or self.mux_channel is None:
            return None
        return self.mux_address, self.mux_channel

    @property
    def half_angle_deg(self) -> float:
        """Of the cone in which it sees; 0 is a thin ray."""
        return 0.0

    @property
    def period_s(self) -> float:
        """From one measurement to the next, at least; 0: not known here."""
        return 0.0


class TofPlace(I2cPlace):
    """A time-of-flight sensor. With `xshut` it is held in reset until it is given `address`."""

    address: I2cAddress = TOF_ADDRESS
    """Where it answers; another than 0x29 is given to it at the start, and needs `xshut`."""
    xshut: GpioName | None = None
    """The line that holds it in reset, `gpiochip0/17` or `sysfs/529`; null: none."""
    ambient_max_kcps_per_spad: Positive = 5.0
    """Up to this ambient light "no return" means "nothing there"; above it, "cannot see"."""

    @model_validator(mode="after")
    def _an_address_is_given_through_xshut(self) -> "TofPlace":
        if self.xshut is None and self.address != TOF_ADDRESS:
            raise ValueError(
                f"without xshut the sensor stays at {TOF_ADDRESS:#04x}; remove address, or give "
                "the line"
            )
        return self


class Vl53l0xConfig(TofPlace):
    """One VL53L0X."""

    chip: Literal["vl53l0x"]
    """Which sensor this is."""
    budget_s: Annotated[float, Field(ge=0.02, le=0.2)] = 0.033
    """Time for one measurement: longer is less noisy and slower."""
    signal_min_mcps: Annotated[float, Field(gt=0.0, lt=512.0)] = 0.25
    """A weaker return is none."""
    sigma_max_m: Positive = 0.018
    """Above this estimated noise a reading is SUSPECT."""

    @property
    def half_angle_deg(self) -> float:
        """Of the cone in which it sees (data sheet: 25 degrees in all)."""
        return 12.5

    @property
    def period_s(self) -> float:
        """From one measurement to the next."""
        return self.budget_s


class Vl53l1xConfig(TofPlace):
    """One VL53L1X. The region of interest narrows the cone: 16 x 16 diodes see 27 degrees."""

    chip: Literal["vl53l1x"]
    """Which sensor this is."""
    budget_ms: Literal[15, 20, 33, 50, 100, 200, 500] = 33
    """Time for one measurement: longer is less noisy and slower."""
    mode: Literal["short", "long"] = "short"
    """Short: to 1.3 m, little disturbed by light. Long: to 4 m in the dark."""
    roi_width: Annotated[int, Field(ge=4, le=16)] = 16
    """Diodes across the region of interest ..."""
    roi_height: Annotated[int, Field(ge=4, le=16)] = 16
    """... and up it: fewer see a narrower cone, and less light."""
    roi_centre: Annotated[int, Field(ge=0, le=255)] = 199
    """Number of the diode above and right of the middle; 199 is the optical centre."""

    @model_validator(mode="after")
    def _the_region_fits(self) -> "Vl53l1xConfig":
        if self.budget_ms == 15 and self.mode == "long":
            raise ValueError("budget_ms 15 is for mode short only; use 20 or more")
        if max(self.roi_width, self.roi_height) > 10 and self.roi_centre != 199:
            raise ValueError("a region wider than 10 can only be centred at 199")
        return self

    @property
    def half_angle_deg(self) -> float:
        """Of the cone in which it sees: 15 degrees in all with 4 x 4 diodes, 20 with 8 x 8, 27
        with 16 x 16 (data sheet), along a straight line in between; a region that is not square
        sees as far as its longer side.
        """
        side = max(self.roi_width, self.roi_height)
        return 7.5 + 0.625 * (side - 4) if side <= 8 else 10.0 + 0.4375 * (side - 8)

    @property
    def period_s(self) -> float:
        """From one measurement to the next, at least."""
        return self.budget_ms * 1e-3


class PowerCurve(Section):
    """Range = scale_m * volts ** -exponent - offset_m."""

    kind: Literal["power"]
    """Which curve this is."""
    scale_m: Positive
    """Range at one volt, where `exponent` is 1 and `offset_m` 0."""
    exponent: Positive = 1.0
    """How steeply the range falls with the voltage."""
    offset_m: Finite = 0.0
    """What is taken off the range."""


class TableCurve(Section):
    """Measured (range in metres, volts), the nearest first; between them 1/range is linear."""

    kind: Literal["table"]
    """Which curve this is."""
    points: tuple[tuple[Positive, Positive], ...] = Field(min_length=2)
    """Pairs of range and volts; ranges rise, volts fall."""

    @model_validator(mode="after")
    def _falls(self) -> "TableCurve":
        pairs = zip(self.points, self.points[1:], strict=False)
        if any(near[0] >= far[0] or near[1] <= far[1] for near, far in pairs):
            raise ValueError("points must be sorted: ranges rise, volts fall")
        return self


class SharpIrConfig(I2cPlace):
    """One Sharp triangulation sensor on an input of an ADS1115."""

    chip: Literal["gp2y0a21", "gp2y0a02"]
    """Which sensor this is: 10 to 80 cm, or 20 to 150 cm."""
    address: Annotated[int, Field(ge=0x48, le=0x4B)] = 0x48
    """Of the ADS1115."""
    input: Annotated[int, Field(ge=0, le=3)] = 0
    """Of the ADS1115 that its output is wired to."""
    curve: Annotated[PowerCurve | TableCurve, Field(discriminator="kind")] | None = None
    """null: the typical curve of the data sheet; calibrate each sensor."""
    noise_v: Positive = 0.02
    """One sigma of the voltage."""
    dead_v: NonNegative = 0.03
    """Below this the sensor has no supply: that is not the same as nothing in view."""
    fold_max_m: Positive | None = None
    """How far an object inside the minimum distance can seem; null: by the chip."""
    closing_max_m_s: Positive = 1.0
    """Nothing moves faster towards or from the sensor than this."""

    @property
    def period_s(self) -> float:
        """From one measurement to the next."""
        return SHARP_REFRESH_S


I2cSensorConfig = Annotated[
    Vl53l0xConfig | Vl53l1xConfig | SharpIrConfig, Field(discriminator="chip")
]


class I2cDriver(DriverSection):
    """Sensors on one Linux I2C bus."""

    driver: Literal["i2c"]
    """Which driver this is."""
    bus: str = "/dev/i2c-1"
    """The device of the bus."""
    sensors: tuple[I2cSensorConfig, ...] = Field(min_length=1)
    """What hangs on it, one entry a sensor."""
    mux_reset: GpioName | None = None
    """Reset line of the multiplexers, low is reset: frees a bus that a chip holds low."""

    @model_validator(mode="after")
    def _nobody_answers_for_another(self) -> "I2cDriver":
        for sensor in self.sensors:
            here = self._answering_with(sensor)
            if here is not None:
                raise ValueError(
                    f"beams {sensor.beam} and {here} answer to the same address at the same place; "
                    "use a multiplexer channel or an xshut line and an address for each"
                )
        switches = {s.mux_address for s in self.sensors}
        if any(sensor.address in switches for sensor in self.sensors):
            raise ValueError("a sensor has the address of a multiplexer; give it another")
        lines = [s.xshut for s in self.sensors if isinstance(s, TofPlace) and s.xshut is not None]
        if len(set(lines)) != len(lines):
            raise ValueError("two sensors have the same xshut line")
        return self

    def beams_of(self) -> tuple[WiredBeam, ...]:
        """The beams whose sensors hang on this bus."""
        return tuple(WiredBeam(s.beam, s.half_angle_deg, s.period_s) for s in self.sensors)

    def port(self) -> str | None:
        """The bus."""
        return self.bus

    def _answering_with(self, sensor: I2cSensorConfig) -> str | None:
        """Another sensor that hears what is meant for this one."""
        for other in self.sensors:
            visible = other.segment in (None, sensor.segment) or sensor.segment is None
            if other is sensor or not visible:
                continue
            if isinstance(sensor, SharpIrConfig) and isinstance(other, SharpIrConfig):
                same_chip = (sensor.segment, sensor.address) == (other.segment, other.address)
                if same_chip and sensor.input != other.input:
                    continue
            if other.address == sensor.address:
                return other.beam
            if _wakes_at_the_others_address(sensor, other):
                return other.beam
        return None


def _wakes_at_the_others_address(sensor: I2cSensorConfig, other: I2cSensorConfig) -> bool:
    """True when `sensor` is first heard where `other` stays."""
    return (
        isinstance(sensor, TofPlace) and sensor.xshut is not None and other.address == TOF_ADDRESS
    )


class VirtualDriver(DriverSection):
    """All beams, cast from the vehicle's reported pose into a scenario: obstacles that are not
    there. The scenario's origin is where the vehicle is first armed (hal/ranging/README.md).
    """

    driver: Literal["virtual"]
    """Which driver this is."""
    scenario: str = Field(min_length=1)
    """A shipped name or the path of a YAML file; its beams' noise and faults count too."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the noise."""
    send: bool = False
    """Also send them to the vehicle, so that a ground station shows them; not what looks down."""


RangeDriver = Annotated[MavlinkDriver | I2cDriver | VirtualDriver, Field(discriminator="driver")]


class BeamsConfig(Section):
    """The set of beams, who drives them, and what they have in common."""

    mounts: tuple[BeamMount, ...] = Field(default_factory=six_beams)
    """Where each beam sits and looks; the default is the paper's set of six."""
    drivers: tuple[RangeDriver, ...] = Field(default=(MavlinkDriver(),), min_length=1)
    """Who reads the beams: `mavlink` has all that no `i2c` sensor has, `virtual` has all."""
    min_m: NonNegative = 0.02
    """Nearest that the sensors measure (paper, section 3: 2 to 100 cm) ..."""
    max_m: Positive = 1.0
    """... and farthest."""
    latency_s: NonNegative = 0.02
    """From a measurement to the time that a MAVLink sender stamps; the pose of that moment is
    used."""
    stale_after_s: Positive = 0.3
    """An older reading is not believed."""

    @model_validator(mode="after")
    def _names_are_unique(self) -> "BeamsConfig":
        names = [mount.name for mount in self.mounts]
        if len(set(names)) != len(names):
            raise ValueError("two beams have the same name: give each its own")
        if self.min_m >= self.max_m:
            raise ValueError("min_m must be below max_m")
        return self

    @model_validator(mode="after")
    def _every_beam_has_one_driver(self) -> "BeamsConfig":
        if self.virtual() is not None:
            if len(self.drivers) > 1:
                others = ", ".join(d.driver for d in self.drivers if d.driver != "virtual")
                raise ValueError(
                    "drivers: virtual beams look into a room that is not there, and others "
                    f"({others or 'a second virtual'}) into another; a map of both would be of "
                    "neither: list virtual alone, or remove it"
                )
            return self
        names = {mount.name for mount in self.mounts}
        driven = [wired.name for wired in self._wired()]
        for beam in driven:
            if beam not in names:
                raise ValueError(f"drivers: there is no mount called {beam}")
            if driven.count(beam) > 1:
                raise ValueError(f"drivers: beam {beam} has two sensors; give each its own mount")
        ports = [driver.port() for driver in self.drivers if driver.port() is not None]
        if len(set(ports)) != len(ports):
            raise ValueError("drivers: a bus is listed twice; list all its sensors under one")
        over_mavlink = [d for d in self.drivers if isinstance(d, MavlinkDriver)]
        if len(over_mavlink) > 1:
            raise ValueError("drivers: mavlink is listed twice")
        if not over_mavlink and names - set(driven):
            raise ValueError(
                f"drivers: nobody reads {', '.join(sorted(names - set(driven)))}; add a sensor, "
                "or {driver: mavlink}"
            )
        return self

    @model_validator(mode="after")
    def _nothing_is_stale_between_two_measurements(self) -> "BeamsConfig":
        for beam in self._wired():
            if beam.period_s > self.stale_after_s / 2.0:
                raise ValueError(
                    f"drivers: beam {beam.name} is measured every {beam.period_s:g} s and stale "
                    f"after {self.stale_after_s:g} s, so that one lost measurement blinds it; "
                    "shorten its budget, or raise stale_after_s to twice that"
                )
        return self

    def half_angle_deg(self, name: str) -> float:
        """Of the cone in which the beam called `name` sees: as its mount says, else as its sensor
        does, else 0, a thin ray. Raises KeyError when there is no such mount.
        """
        told = self.mount(name).half_angle_deg
        if told is not None:
            return told
        return next((b.half_angle_deg for b in self._wired() if b.name == name), 0.0)

    def virtual(self) -> VirtualDriver | None:
        """The driver of virtual beams, where there is one; it has all beams then."""
        return next((d for d in self.drivers if isinstance(d, VirtualDriver)), None)

    def only(self, name: str) -> "BeamsConfig":
        """What it takes to read the beam called `name`: its driver, and that driver's beams.

        Raises KeyError when there is no such mount.
        """
        name = self.mount(name).name
        for driver in self.drivers:
            names = {beam.name for beam in driver.beams_of()}
            if name in names:
                mounts = tuple(mount for mount in self.mounts if mount.name in names)
                return self.model_copy(update={"drivers": (driver,), "mounts": mounts})
        return self.afar()

    def afar(self) -> "BeamsConfig":
        """What comes over the vehicle's link alone."""
        drivers = tuple(driver for driver in self.drivers if not driver.beams_of())
        return self.model_copy(update={"drivers": drivers, "mounts": self.over_mavlink()})

    def wired(self) -> tuple[BeamMount, ...]:
        """The mounts whose sensors are read on this computer."""
        names = {beam.name for beam in self._wired()}
        return tuple(mount for mount in self.mounts if mount.name in names)

    def _wired(self) -> tuple[WiredBeam, ...]:
        return tuple(beam for driver in self.drivers for beam in driver.beams_of())

    def over_mavlink(self) -> tuple[BeamMount, ...]:
        """The mounts whose readings come over the vehicle's link: all that no sensor here has.

        Virtual beams count: they need the vehicle's pose.
        """
        names = {beam.name for beam in self._wired()}
        return tuple(mount for mount in self.mounts if mount.name not in names)

    def latency_of(self, mount: BeamMount) -> float:
        """From the middle of a measurement of `mount` to the time that its driver gets to know.

        The mount's own; else `latency_s` over MAVLink, whose senders stamp when they send, and 0
        for sensors on this computer, whose drivers know the middle of the measurement. Drivers
        take it off: a reading's stamp is when the range was true.
        """
        if mount.latency_s is not None:
            return mount.latency_s
        wired = any(beam.name == mount.name for beam in self._wired())
        return 0.0 if wired or self.virtual() is not None else self.latency_s

    def mount(self, name: str) -> BeamMount:
        """The mount called `name`; raises KeyError when there is none."""
        return {mount.name: mount for mount in self.mounts}[name]


class Fence(Section):
    """What the vehicle's centre stays inside, in local NED: a horizontal polygon (north, east), a
    cylinder about the take-off point, or what both have in common. The altitude band is its height.
    """

    polygon_ne_m: tuple[PointNE, ...] | None = Field(default=None, min_length=3)
    """Corners in order, round the outside; null: no polygon, the cylinder alone."""
    radius_m: Positive | None = None
    """How far from the take-off point, at most."""

    @model_validator(mode="after")
    def _encloses_something(self) -> "Fence":
        if self.polygon_ne_m is None and self.radius_m is None:
            raise ValueError("a fence needs polygon_ne_m or radius_m; give one, or both")
        if self.polygon_ne_m is not None and fence.crosses_itself(self.polygon_ne_m):
            raise ValueError(
                "polygon_ne_m crosses itself; give its corners in order, round the outside"
            )
        if len(self.outline_ne_m) < 3:
            raise ValueError(
                "nothing of polygon_ne_m lies within radius_m of the take-off point; widen one"
            )
        return self

    @cached_property
    def outline_ne_m(self) -> fence.Ring:
        """The corners (north, east) of what is inside: the one fence that everything goes by.

        A cylinder's is a polygon of 64 corners inside it.
        """
        if self.polygon_ne_m is None:
            return fence.circle(self.radius_m or 0.0)
        if self.radius_m is None:
            return self.polygon_ne_m
        return fence.within_circle(self.polygon_ne_m, self.radius_m)

    @classmethod
    def rectangle(cls, north: tuple[float, float], east: tuple[float, float]) -> "Fence":
        """The axis-parallel rectangle with the given (low, high) limits."""
        (n0, n1), (e0, e1) = north, east
        return cls(polygon_ne_m=((n0, e0), (n1, e0), (n1, e1), (n0, e1)))

    def bounds(self) -> tuple[float, float, float, float]:
        """(north_min, north_max, east_min, east_max)."""
        norths = [p[0] for p in self.outline_ne_m]
        easts = [p[1] for p in self.outline_ne_m]
        return min(norths), max(norths), min(easts), max(easts)

    def inside_distance_m(self, north_m: float, east_m: float) -> float:
        """Signed distance to the boundary: positive inside, negative outside."""
        return fence.inside_distance_m(self.outline_ne_m, north_m, east_m)


class GuardConfig(Section):
    """Limits that every setpoint obeys, whoever planned it (hal/vehicle/guard)."""

    speed_max_m_s: Positive = 0.25
    """No setpoint is faster."""
    climb_max_m_s: Positive = 0.5
    """No setpoint climbs or sinks faster."""
    altitude_min_m: NonNegative = 0.3
    """Above the take-off point: no setpoint leads lower ..."""
    altitude_max_m: Positive = 2.0
    """... and none higher; stay under the ceiling."""
    fence: Fence = Field(default_factory=lambda: Fence.rectangle((-10.0, 10.0), (-10.0, 10.0)))
    """What the vehicle's centre stays inside."""
    setpoint_max_age_s: Positive = 0.2
    """An older setpoint is not sent."""
    position_max_age_s: Positive = 0.3
    """With an older position only holding is allowed."""
    leash_m: Positive = 0.6
    """How far the setpoint's position may lie from the vehicle's."""
    reaction_s: NonNegative = 0.6
    """How long the vehicle flies on before it brakes: one tick, the link, PX4's own lag."""
    braking_m_s2: Positive = 0.5
    """With `reaction_s`: bounds the measured stop of a held position (hal/vehicle/guard)."""
    blind_s: NonNegative = 1.6
    """How many seconds of its speed a vehicle travels on when this program dies: PX4 flies on by
    the last setpoint until COM_OF_LOSS_T, then it stops (hal/vehicle/guard)."""
    acceleration_max_m_s2: Positive = 2.0
    """How much faster, or otherwise directed, one setpoint may be than the one before; slower
    always."""
    yaw_rate_max_deg_s: Positive = 120.0
    """No setpoint turns faster than this from the one before."""
    corridor_sigma_m: NonNegative = 0.02
    """The uncertainty of the position that the map's corridor has room for to both sides; where it
    is larger the corridor is checked that much wider."""
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
    """Without a tick of the control loop for this long: zero velocity ..."""
    hold_after_s: Positive = 1.0
    """... and this long after that PX4 is put in Hold."""


CONNECTION_SCHEMES = (
    *("udpin", "udpout", "tcpin", "tcpout", "serial", "serial_flowcontrol"),
    *("udp", "tcp", "raw"),
)
"""How a connection URL may begin, before `://`; the last three are older spellings."""


DEVICE_SCHEMES = ("serial", "serial_flowcontrol")
"""Those of them that name a device of this computer, `///device:baud`, instead of an address."""


class VehicleConfig(Section):
    """How the autopilot is reached."""

    driver: Literal["mavsdk"] = "mavsdk"
    """The only one there is."""
    connection: str = "udpin://0.0.0.0:14540"
    """MAVSDK's URL: `udpin://`, `udpout://`, `tcpout://`, `serial:///dev/ttyAMA0:921600`."""
    connect_timeout_s: Positive = 10.0
    """Until it is said that no vehicle answered."""
    request_timeout_s: Positive = 3.0
    """Until a request counts as not answered."""
    link_timeout_s: Positive = 1.5
    """Silence for this long is a lost link."""


class AutopilotGnssConfig(Section):
    """The receiver at the autopilot, heard over the vehicle's link."""

    driver: Literal["autopilot"] = "autopilot"
    """`autopilot`: its own receiver; `serial`: one on a port of this computer, with more keys."""


class SerialGnssConfig(Section):
    """A receiver on a serial port of the companion computer; see hal/gnss/README.md."""

    driver: Literal["serial"] = "serial"
    """Which receiver this is."""
    port: str = Field(min_length=1)
    """Device; a link under /dev/serial/by-id stays the same when it is plugged in again."""
    baud: Literal["auto"] | Annotated[int, Field(ge=4_800, le=4_000_000)] = "auto"
    """Rate of the port; auto: the one at which whole frames come."""
    latency_s: NonNegative = 0.1
    """From the moment that a solution is for, to its first byte on the wire."""
    range_error_m: Positive = 4.0
    """User range error, one sigma: what a dilution multiplies where no accuracy is sent."""
    confirm_fixes: int = Field(default=3, ge=1, le=50)
    """A better type of fix is told after so many solutions that claim it; a worse one at once."""
    frozen_after_s: Positive = 5.0
    """A position that does not move by its last digit for so long is not believed."""
    silent_after_s: Positive = 3.0
    """Without a whole frame for so long, the rate is searched anew."""
    reopen_after_s: Positive = 0.2
    """A device that is gone is tried again after this, then after twice as long ..."""
    reopen_max_s: Positive = 3.0
    """... up to this."""

    @model_validator(mode="after")
    def _pauses_are_ordered(self) -> "SerialGnssConfig":
        if self.reopen_after_s > self.reopen_max_s:
            raise ValueError("reopen_after_s must not be above reopen_max_s")
        return self


GnssConfig = Annotated[AutopilotGnssConfig | SerialGnssConfig, Field(discriminator="driver")]
