"""The effective configuration: one immutable pydantic tree, written beside every result.

Defaults here are the project's; `configs/default.yaml` writes each one out. Paper constants name
their table. Nothing is corrected silently: a value out of bounds is refused with a sentence.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from hal.config import (
    AutopilotGnssConfig,
    BeamsConfig,
    DeadmanConfig,
    GnssConfig,
    GuardConfig,
    NonNegative,
    Positive,
    VehicleConfig,
)
from hal.documents import Section, load_document


class BodyConfig(Section):
    """The vehicle's body, as a vertical cylinder about its centre."""

    radius_m: Positive = 0.15
    """Propellers included."""
    half_height_m: Positive = 0.08
    """From the centre to the lowest skid, or to the highest part."""


class WallsConfig(Section):
    """Beams against walls that are known already: the drift of the autopilot's frame
    (autonomy/estimation/wall_fix.py).
    """

    use: bool = False
    """True: map, goal and fence stay where they are in the room while the autopilot drifts."""
    wander_sigma_m: Positive = 0.025
    """The autopilot's position is wrong by this (one sigma and axis) ..."""
    wander_s: Positive = 3.5
    """... for about so long at a time."""
    drift_m_per_sqrt_s: NonNegative = 0.003
    """What does not come back: its random walk, ..."""
    drift_rate_m_s: NonNegative = 0.0
    """... and the rate (one sigma) at which it runs away for a minute."""
    settle_s: Positive = 0.5
    """Hits older than this are a reference."""
    gate_sigma: Positive = 3.0
    """An innovation of more standard deviations moves nothing, ..."""
    gate_m: Positive = 0.07
    """An innovation beyond the one or the other moves nothing."""
    correction_max_m_s: Positive = 0.1
    """The mission frame is not moved faster than this ..."""
    correction_max_m: Positive = 1.0
    """... and in all no farther than this."""


class EstimationConfig(Section):
    """Kalman filter: process noise, measurement noise floors and gates."""

    acceleration_noise_m_s2: Positive = 0.5
    """One sigma: how unsteadily the vehicle is expected to fly."""
    local_position_sigma_m: Positive = 0.03
    """One sigma of the autopilot's position."""
    local_velocity_sigma_m_s: Positive = 0.05
    """One sigma of the autopilot's velocity."""
    gnss_sigma_floor_m: Positive = 0.5
    """GNSS is never believed more than this, whatever it claims."""
    gnss_interval_s: NonNegative = 0.35
    """After a fix was fused, others are left out for so long: their errors are alike."""
    gnss_bias_noise_m_per_sqrt_s: Positive = 0.1
    """How fast GNSS and the autopilot may walk apart: metres after one second, one sigma."""
    gnss_apart_m: Positive = 2.0
    """Further apart than this, and than 3 times the receiver's accuracy, is told."""
    drift_noise_m_per_sqrt_s: NonNegative = 0.022
    """How fast the autopilot's frame drifts against the room; for `room_sigma_m` alone."""
    height_sigma_m: Positive = 0.03
    """One sigma of a level that the down or the up beam measures."""
    gate_sigma: Positive = 5.0
    """An innovation larger than this many standard deviations is rejected."""
    reset_after_rejections: int = Field(default=10, ge=1)
    """So many rejections in a row, and the sensor is believed instead."""
    stale_after_s: Positive = 0.3
    """Without position or attitude for this long nothing is flown by the state."""
    sigma_max_m: Positive = 0.3
    """Above this horizontal uncertainty the state is not ok: nothing is flown by it."""
    walls: WallsConfig = Field(default_factory=WallsConfig)
    """Beams against walls that are known already: the drift of the autopilot's frame."""


class MapConfig(Section):
    """Evidence grid of hits and seen-free space (t3drm-findings, section 3.4)."""

    cell_m: Positive = 0.025
    """Edge of a cell of the evidence grid."""
    hit_gain: int = Field(default=3, ge=1)
    """Evidence that one hit adds ..."""
    hit_cap: int = Field(default=12, ge=1)
    """... up to this; a beam that passes through takes 1 away."""
    occupied_from: int = Field(default=3, ge=1)
    """Evidence from which a cell is an obstacle."""
    clear_within_m: Positive = 0.02
    """A beam clears only cells this near to its axis."""
    hit_mean_weight: Annotated[float, Field(gt=0.0, le=1.0)] = 0.25
    """Share of a new hit in the cell's mean point."""
    edge_rule_deg: Positive = 7.0
    """Two consecutive rays of one beam nearer than this bound the edge between them."""
    free_shrink_m: NonNegative = 0.06
    """Space is seen free only up to this before the hit."""
    accounted_within_m: NonNegative = 0.05
    """A hit this near to a known one is no news."""
    start_disc_m: Positive = 0.23
    """The take-off disc, assumed free: the vehicle stands in it."""
    seen_max_age_s: Positive = 60.0
    """Space seen free stays so for this long (static world); lower it where things move."""
    corridor_hit_m: Positive = 0.185
    """Guard: the centre's corridor keeps this far from every mapped hit."""
    corridor_seen_m: Positive = 0.17
    """Guard: everything within this of the corridor's axis must have been seen."""


WIDE_READINGS, WIDE_READINGS_S = 256, 2.0
"""How many readings of wide beams the map remembers, and for how long it must
(autonomy/perception/kernels.py)."""


class MoversConfig(Section):
    """Moving obstacles: what is seen where it was free (autonomy/mission/making_way.py)."""

    watch: bool = True
    """False: everything is taken to stand still."""
    expected: bool = False
    """True: something may move from the start on, so the vehicle scans fast and trusts no old
    sight. False: only for `remember_s` after something moved."""
    remember_s: NonNegative = 60.0
    """For so long after something moved the keys below hold."""
    scan_deg_s: Positive = 120.0
    """How fast the vehicle turns then, and always beside what is nearer than 0.25 m. At 60 deg/s a
    mover comes 0.3 m nearer between two looks."""
    edge_rule_deg: Positive = 9.0
    """`map.edge_rule_deg` then: the rays of a faster scan lie farther apart."""
    seen_max_age_s: Positive = 8.0
    """`map.seen_max_age_s` then: what was free may not be any more."""
    hit_cap: int = Field(default=6, ge=1)
    """`map.hit_cap` then: fewer looks through a hit erase it."""
    retreat_below_m: Positive = 0.28
    """`guidance.push_below_m` then, where the vehicle has stopped: whatever is that near may be
    coming nearer."""
    retreat_speed_m_s: Positive = 0.12
    """How fast it leaves then."""
    clearance_m: Positive = 0.2
    """Beyond body and mover: nearer than this nothing may be predicted to come."""
    horizon_s: Annotated[float, Field(ge=1.0)] = 4.0
    """How far ahead it is predicted."""
    escape_s: Annotated[float, Field(ge=2.0, le=12.0)] = 5.0
    """How far ahead the way that may follow a first evasion is searched."""
    plan_ahead_s: NonNegative = 4.0
    """Plans keep clear of where movers will be within this; 0: of where they are only."""


class StoreysConfig(Section):
    """Over and under: the heights of flight in the altitude band (autonomy/t3drm/over_under.py)."""

    use: Literal["never", "closed", "cheapest"] = "closed"
    """never: fly at the goal's height only; closed: leave it when nothing leads on there; cheapest:
    whenever another height, with its climbs, costs less."""
    spacing_m: Positive = 0.22
    """From one storey to the next. A storey is flown at only past what was seen neither there nor
    at its neighbours, so this is also the least height between the vehicle and a top."""
    climb_m_s: Positive = 0.3
    """Up or down, in place."""
    change_s: NonNegative = 2.5
    """What a change of height costs besides the climb: to settle, and to look round."""
    gain_m: NonNegative = 0.5
    """Another storey must be cheaper than the present one by this: no dither."""
    proof_clearance_m: Positive = 0.12
    """Beyond the body: flights that only prove a height closed leave narrower passages alone; never
    less than `hard_clearance_m`."""
    changes_max: int = Field(default=40, ge=0)
    """After so many changes of height a flight stays where it is."""


class PlannerConfig(Section):
    """T3DRM planning. Clearances are added to the body radius to give the keep-out radii."""

    comfortable_clearance_m: Positive = 0.15
    """r0 of Eq. 2: keep-out radius around a hit at comfort."""
    hard_clearance_m: Positive = 0.06
    """r_min: Eq. 2's flow is stopped here."""
    levels: int = Field(default=4, ge=1, le=8)
    """How many radii from r0 to r_min are solved and compared."""
    level_penalty: Annotated[float, Field(ge=1.0)] = 1.03
    """Factor on the length for each level below r0."""
    discrete_radius_m: Positive = 0.35
    """A component whose minimum enclosing circle is not larger is discrete (section 3)."""
    hyperbola: Literal["prefer", "cost", "never"] = "prefer"
    """Continuous obstacles: take the fly-by conic where it is free; only where it is not longer
    than its tangent-and-arc by `hyperbola_max_ratio`; or never."""
    hyperbola_max_ratio: Annotated[float, Field(ge=1.0)] = 1.05
    """For `hyperbola: cost`: at most this many times the length of tangent and arc."""
    grid_cell_m: Positive = 0.05
    """Cell of the local grid on which the fallback geodesic is found."""
    tangent_discs_max: int = Field(default=80, ge=1)
    """Above this many active discs the geodesic decides."""
    storeys: StoreysConfig = Field(default_factory=StoreysConfig)
    """Over and under: other heights of flight."""


class ReplanConfig(Section):
    """When the loop looks again."""

    mode: Literal["stop", "rolling"] = "stop"
    """stop: the paper's loop (stop, detect, replan, follow); rolling: replan in motion when the
    next stretch is already seen free."""
    min_interval_s: Positive = 0.2
    """Between two plans, at least."""
    hover_s: Positive = 2.0
    """How long to look around at rest before trying again when there is no way."""
    forget_radius_m: Positive = 1.1
    """Round the vehicle, what is looked at anew then."""
    side_hysteresis_m: NonNegative = 0.4
    """The other side of an obstacle is taken only when that saves more way than this; 0: always."""
    attempts: int = Field(default=9, ge=3)
    """Failures (never reset by a success) before the verdict 'unreachable'."""


_PROPORTIONAL = "Velocity per error."
_INTEGRAL = "Velocity per error and second."
_DERIVATIVE = "Velocity per rate of the error."


class PidGains(Section):
    """One PID loop; its bounds are those of the paper's Table 3 (set by the field using it)."""

    kp: NonNegative
    ki: NonNegative
    kd: NonNegative


class PositionGains(PidGains):
    """Table 3, position: kp 0-100, ki 0-1, kd 0-10; beside PX4's own position loop."""

    kp: Annotated[float, Field(ge=0.0, le=100.0, description=_PROPORTIONAL)] = 0.0
    ki: Annotated[float, Field(ge=0.0, le=1.0, description=_INTEGRAL)] = 0.0
    kd: Annotated[float, Field(ge=0.0, le=10.0, description=_DERIVATIVE)] = 0.0


class AltitudeGains(PidGains):
    """Table 3, altitude: kp 0-10, ki 0-1, kd 0-10."""

    kp: Annotated[float, Field(ge=0.0, le=10.0, description=_PROPORTIONAL)] = 1.0
    ki: Annotated[float, Field(ge=0.0, le=1.0, description=_INTEGRAL)] = 0.05
    kd: Annotated[float, Field(ge=0.0, le=10.0, description=_DERIVATIVE)] = 0.0


class VelocityGains(PidGains):
    """Table 3, velocity: kp 0-10, ki 0-1, kd 0-10; beside PX4's own velocity loop."""

    kp: Annotated[float, Field(ge=0.0, le=10.0, description=_PROPORTIONAL)] = 0.0
    ki: Annotated[float, Field(ge=0.0, le=1.0, description=_INTEGRAL)] = 0.0
    kd: Annotated[float, Field(ge=0.0, le=10.0, description=_DERIVATIVE)] = 0.0


class GuidanceConfig(Section):
    """Plan to setpoint: speed rule (Table 2), yaw scan, outer loops (Table 3)."""

    speed_max_m_s: Positive = 0.2
    """The paper's limit (section 3.1)."""
    speed_min_m_s: Positive = 0.08
    """The minimum of Table 2."""
    slow_below_m: Positive = 0.30
    """Clearance at which the speed begins to fall ..."""
    slowest_at_m: Positive = 0.18
    """... and at which it has fallen to the minimum."""
    volume_rate_dead_band: NonNegative = 0.02
    """Table 2: |dV/dt| below this fraction of the full volume per second counts as 0."""
    carrot_m: Positive = 0.10
    """How far ahead on the path is flown to."""
    lead_s: NonNegative = 0.15
    """How far in time the setpoint leads the vehicle."""
    push_below_m: Positive = 0.20
    """With less clearance the vehicle is pushed away ..."""
    push_speed_m_s: Positive = 0.05
    """... this fast."""
    yaw_rate_deg_s: Positive = 60.0
    """How fast it turns to look around."""
    position: PositionGains = Field(default_factory=PositionGains)
    """Outer loop of the position; 0 leaves it to PX4."""
    altitude: AltitudeGains = Field(default_factory=AltitudeGains)
    """Outer loop of the altitude."""
    velocity: VelocityGains = Field(default_factory=VelocityGains)
    """Outer loop of the velocity; 0 leaves it to PX4."""

    @model_validator(mode="after")
    def _speeds_are_ordered(self) -> "GuidanceConfig":
        if self.speed_min_m_s > self.speed_max_m_s:
            raise ValueError("speed_min_m_s must not be above speed_max_m_s")
        if self.slowest_at_m >= self.slow_below_m:
            raise ValueError("slowest_at_m must be below slow_below_m")
        return self


class MissionConfig(Section):
    """One flight."""

    altitude_m: Positive = 1.0
    """Of flight, above the take-off point."""
    goal_tolerance_m: Positive = 0.15
    """This near is there."""
    detection_range_m: Positive = 0.6
    """A hit nearer than this and in the way stops the straight flight (paper: the IR range)."""
    time_limit_s: Positive = 600.0
    """From arming; then the time is used up."""
    path_limit_m: Positive | None = None
    """Of way flown; None: as far as the time allows."""
    preflight_timeout_s: Positive = 20.0
    """A vehicle that is not ready after this is refused."""
    takeoff_timeout_s: Positive = 30.0
    """A take-off that takes longer is given up."""
    land_timeout_s: Positive = 60.0
    """A landing that takes longer is told."""
    land_at_end: bool = True
    """False: hold at the goal."""
    replan: ReplanConfig = Field(default_factory=ReplanConfig)
    """When the loop looks again."""


Ending = Literal["land", "return"]
"""How a mission ends that cannot go on: here, or back along what was flown."""


class FailsafeConfig(Section):
    """Limits that end or interrupt a mission."""

    battery_warn: Annotated[float, Field(ge=0.0, le=1.0)] = 0.25
    """Fraction left: nothing takes off below it."""
    battery_return: Annotated[float, Field(ge=0.0, le=1.0)] = 0.20
    """Fraction left: what `battery_low` says."""
    battery_land: Annotated[float, Field(ge=0.0, le=1.0)] = 0.15
    """Fraction left: land."""
    sensor_loss_hold_s: Positive = 0.5
    """A horizontal beam silent for this long is lost: the others cover for one ..."""
    sensor_loss_land_s: Positive = 5.0
    """... with two lost: hold, and after this long land."""
    doubt_beams: bool = True
    """Doubt beams that measure, too (stuck, jumping, contradicting the others ...)."""
    state_loss_land_s: Positive = 2.0
    """Without a usable position for this long: land."""
    flapping_holds: int = Field(default=10, ge=2)
    """The same fault, gone and back this often ..."""
    flapping_window_s: Positive = 60.0
    """... within this: the next step of the escalation."""
    jump_stop_m: Positive = 0.3
    """A jump of PX4's frame by this much: stop, look round, plan anew."""
    drift_m: Positive = 0.25
    """Flown this far elsewhere than asked for within seconds: hold ..."""
    drift_land_s: Positive = 0.4
    """... and for this long: land."""
    fence_return_m: Positive = 0.15
    """This far outside the geofence: return ..."""
    fence_land_m: Positive = 0.6
    """... and this far: land."""
    battery_low: Ending = "return"
    """At `battery_return`: return, where the rate of discharge leaves the time for it, or land."""
    sensor_loss: Ending = "land"
    """Two beams lost for `sensor_loss_land_s`, or gone and back too often."""
    unreachable: Ending = "land"
    """When the goal cannot be reached; `land`, in a narrow place, is at the last open one flown
    past."""
    budget: Ending = "land"
    """`mission.time_limit_s` or `mission.path_limit_m` used up."""
    return_to: Literal["takeoff", "open"] = "takeoff"
    """How far back: to where the flight began, or to the last place with room around it."""
    return_timeout_s: Positive = 180.0
    """A return that takes longer lands where it is."""

    @model_validator(mode="after")
    def _steps_are_ordered(self) -> "FailsafeConfig":
        if not self.battery_land <= self.battery_return <= self.battery_warn:
            raise ValueError(
                "battery_land, battery_return and battery_warn must not fall: the first lands, the "
                "second returns, and below the third nothing takes off"
            )
        if self.fence_land_m < self.fence_return_m:
            raise ValueError("fence_land_m must not be below fence_return_m")
        return self


class ControlConfig(Section):
    """The loop itself."""

    rate_hz: Annotated[float, Field(ge=5.0, le=100.0)] = 20.0
    """Ticks a second."""


class LogConfig(Section):
    """Where flights are recorded, and for how long they are kept."""

    directory: str = "flights"
    """Where flight logs go; made when it is not there."""
    enabled: bool = True
    """False: nothing is recorded."""
    keep_mb: NonNegative = 2000.0
    """Before a flight the oldest ones are deleted until all take no more than this; 0: never.
    A minute takes about 0.6 MB, so that these are some 50 hours in the air."""
    keep_days: Positive | None = None
    """Flights older than this are deleted before the next one; null: age alone is no reason, since
    nobody knows beforehand which flight will be asked about."""


class ServiceConfig(Section):
    """`autonomy serve`: where it listens and what it shows."""

    host: str = "127.0.0.1"
    """Loopback needs no token; any other address does."""
    port: int = Field(default=8042, ge=0, le=65535)
    """0: any free port; it is told when the service starts."""
    token_file: str | None = None
    """A file that holds the token; without one, AUTONOMY_TOKEN in the environment."""
    allowed_hosts: tuple[str, ...] = ()
    """Further names under which a browser may reach the service on loopback."""
    stream_hz: Annotated[float, Field(ge=1.0, le=30.0)] = 20.0
    """How often the page is told where the vehicle is."""
    reconnect_after_s: Positive = 4.0
    """On the ground, a vehicle silent for this long is given up and waited for anew."""
    on_restart_in_flight: Literal["hold", "land", "resume"] = "hold"
    """The service was killed in flight and finds its vehicle in PX4's Hold: leave it there, land
    it, or go on with the mission from its log."""


class Config(Section):
    """The whole configuration."""

    vehicle: VehicleConfig = Field(default_factory=VehicleConfig)
    body: BodyConfig = Field(default_factory=BodyConfig)
    beams: BeamsConfig = Field(default_factory=BeamsConfig)
    gnss: GnssConfig = Field(default_factory=AutopilotGnssConfig)
    estimation: EstimationConfig = Field(default_factory=EstimationConfig)
    map: MapConfig = Field(default_factory=MapConfig)
    movers: MoversConfig = Field(default_factory=MoversConfig)
    planner: PlannerConfig = Field(default_factory=PlannerConfig)
    guidance: GuidanceConfig = Field(default_factory=GuidanceConfig)
    guard: GuardConfig = Field(default_factory=GuardConfig)
    deadman: DeadmanConfig = Field(default_factory=DeadmanConfig)
    mission: MissionConfig = Field(default_factory=MissionConfig)
    failsafe: FailsafeConfig = Field(default_factory=FailsafeConfig)
    control: ControlConfig = Field(default_factory=ControlConfig)
    log: LogConfig = Field(default_factory=LogConfig)
    service: ServiceConfig = Field(default_factory=ServiceConfig)

    @model_validator(mode="after")
    def _margins_are_ordered(self) -> "Config":
        body = self.body.radius_m
        for name, value_m in (
            ("map.corridor_hit_m", self.map.corridor_hit_m),
            ("map.corridor_seen_m", self.map.corridor_seen_m),
            ("guard.beam_stop_m", self.guard.beam_stop_m),
            ("guidance.slowest_at_m", self.guidance.slowest_at_m),
        ):
            if value_m <= body:
                raise ValueError(
                    f"{name} ({value_m:g} m) must be larger than body.radius_m ({body:g} m)"
                )
        if self.guidance.push_below_m < self.map.corridor_hit_m:
            raise ValueError(
                "guidance.push_below_m must not be below map.corridor_hit_m, "
                "or the vehicle would not leave places where the guard holds it"
            )
        if body + self.planner.hard_clearance_m <= self.map.corridor_hit_m:
            raise ValueError(
                "body.radius_m + planner.hard_clearance_m must be above map.corridor_hit_m, "
                "or the planner proposes what the guard forbids"
            )
        if self.planner.hard_clearance_m > self.planner.comfortable_clearance_m:
            raise ValueError(
                "planner.hard_clearance_m must not be above planner.comfortable_clearance_m"
            )
        if not self.guard.altitude_min_m <= self.mission.altitude_m <= self.guard.altitude_max_m:
            raise ValueError(
                f"mission.altitude_m (--altitude) is {self.mission.altitude_m:g}, outside the band "
                f"{self.guard.altitude_min_m:g}..{self.guard.altitude_max_m:g} m of "
                "guard.altitude_min_m and altitude_max_m: change one of them"
            )
        if self.guidance.speed_max_m_s > self.guard.speed_max_m_s:
            raise ValueError("guidance.speed_max_m_s must not be above guard.speed_max_m_s")
        for key, rate_deg_s in (
            ("guidance.yaw_rate_deg_s", self.guidance.yaw_rate_deg_s),
            ("movers.scan_deg_s", self.movers.scan_deg_s),
        ):
            if rate_deg_s > self.guard.yaw_rate_max_deg_s:
                raise ValueError(
                    f"{key} must not be above guard.yaw_rate_max_deg_s, "
                    "or the vehicle turns more slowly than it looks round"
                )
        return self

    @model_validator(mode="after")
    def _the_map_remembers_its_wide_beams(self) -> "Config":
        periods_s = [
            beam.period_s
            for driver in self.beams.drivers
            for beam in driver.beams_of()
            if beam.period_s > 0.0
            and self.beams.mount(beam.name).horizontal
            and self.beams.half_angle_deg(beam.name) > 0.0
        ]
        rate_hz = sum(1.0 / period_s for period_s in periods_s)
        most_hz = WIDE_READINGS / WIDE_READINGS_S
        if rate_hz > most_hz:
            raise ValueError(
                f"beams: the wide level beams measure {rate_hz:.0f} times a second together, and "
                f"the map takes in {most_hz:.0f} at most; lengthen their budgets"
            )
        return self

    @model_validator(mode="after")
    def _something_looks_ahead(self) -> "Config":
        if not any(mount.horizontal for mount in self.beams.mounts):
            raise ValueError(
                "beams.mounts: none of them looks level, and nothing is flown without seeing what "
                "is ahead; set pitch_deg of at least one (better three) to 0"
            )
        return self

    @model_validator(mode="after")
    def _storeys_leave_room(self) -> "Config":
        least_m = max(
            self.body.half_height_m + self.planner.hard_clearance_m, self.guard.beam_stop_m
        )
        if self.planner.storeys.use != "never" and self.planner.storeys.spacing_m < least_m:
            raise ValueError(
                f"planner.storeys.spacing_m must be at least {least_m:g} (body.half_height_m + "
                "planner.hard_clearance_m, and guard.beam_stop_m), or the vehicle would pass too "
                "near above or below something; or set planner.storeys.use to never"
            )
        return self


def load_config(path: Path | None) -> Config:
    """The configuration in `path`, or the defaults for None; raises hal.errors.DocumentError."""
    return Config() if path is None else load_document(path, Config)
