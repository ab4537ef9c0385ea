"""What Prometheus may read at /metrics. Counting costs the control loop a few microseconds."""

import math
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from autonomy import __version__
from autonomy.model import (
    SOURCES,
    Command,
    FilterHealth,
    FusedState,
    Inputs,
    MissionState,
    WallFixReport,
)
from autonomy.service.contract import MissionRecord, Phase
from autonomy.service.station import Station
from hal.readings import RangeStatus

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_LAG_BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5)
_STEP_BUCKETS = (0.0001, 0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
_PLAN_BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)


class Metrics:
    """One registry of its own. `tick` and `flown` belong to the control side, `text` to the web."""

    def __init__(self, station: Station) -> None:
        self._registry = CollectorRegistry()
        registry = self._registry
        self._period_s = 1.0 / station.config.control.rate_hz
        self._last_s: float | None = None
        self._lag = Histogram(
            "autonomy_loop_lag_seconds",
            "How late a tick of the control loop began.",
            buckets=_LAG_BUCKETS,
            registry=registry,
        )
        self._step = Histogram(
            "autonomy_step_seconds",
            "Computing time of one tick.",
            buckets=_STEP_BUCKETS,
            registry=registry,
        )
        self._plan = Histogram(
            "autonomy_plan_step_seconds",
            "Computing time of a tick that planned.",
            buckets=_PLAN_BUCKETS,
            registry=registry,
        )
        self._readings = Counter(
            "autonomy_beam_readings",
            "Readings of a beam by their status.",
            ["beam", "status"],
            registry=registry,
        )
        self._limits = Counter(
            "autonomy_guard_interventions",
            "Ticks in which a rule of the guard changed the setpoint.",
            ["limit"],
            registry=registry,
        )
        self._states = Counter(
            "autonomy_mission_states",
            "How often a mission entered a state.",
            ["state"],
            registry=registry,
        )
        self._missions = Counter(
            "autonomy_missions", "Missions by their ending.", ["ending"], registry=registry
        )
        self._clearance = Histogram(
            "autonomy_clearance_metres",
            "Distance from the vehicle's centre to the nearest known hit, at each tick in flight.",
            buckets=(0.15, 0.17, 0.185, 0.2, 0.25, 0.3, 0.4, 0.6, 0.8, 1.0),
            registry=registry,
        )
        self.streams = Gauge("autonomy_streams", "Open state streams.", registry=registry)
        registry.register(_Newest(station))

    def tick(self, inputs: Inputs, command: Command, step_s: float) -> None:
        """One tick of a flight."""
        decision = command.decision
        if self._last_s is not None:
            self._lag.observe(max(0.0, inputs.now_s - self._last_s - self._period_s))
        self._last_s = inputs.now_s
        self._step.observe(step_s)
        if decision.plan is not None:
            self._plan.observe(step_s)
        for reading in inputs.ranges:
            self._readings.labels(reading.beam, _STATUS_WORDS[reading.status]).inc()
        for limit in command.guard.limits:
            self._limits.labels(limit).inc()
        if command.setpoint is not None:
            self._clearance.observe(decision.clearance_m)
        for event in decision.events:
            if event.name in _STATE_NAMES:
                self._states.labels(event.name).inc()

    def flown(self, record: MissionRecord) -> None:
        """A mission is over; the next tick is not late for the last one."""
        self._last_s = None
        self._missions.labels(record.ending or record.status.value).inc()

    def text(self) -> bytes:
        """Everything in Prometheus' text format."""
        return generate_latest(self._registry)


_STATUS_WORDS = {status: status.value for status in RangeStatus}
_STATE_NAMES = frozenset(state.value for state in MissionState)


class _Newest(Collector):
    """Gauges that are looked up when somebody asks."""

    def __init__(self, station: Station) -> None:
        self._station = station

    def collect(self) -> Iterator[Metric]:
        """The newest values; what is not known is left out, never written as zero."""
        yield InfoMetricFamily("autonomy", "This program.", value={"version": __version__})
        station = self._station
        phase = GaugeMetricFamily("autonomy_phase", "1 for what it is doing.", labels=["phase"])
        for one in Phase:
            phase.add_metric([one.value], float(one is station.phase))
        yield phase
        dropped = CounterMetricFamily(
            "autonomy_dropped",
            "What came in and was not believed, since the vehicle was connected.",
            labels=["source", "reason"],
        )
        for labels, count in station.dropped().items():
            dropped.add_metric(labels, count)
        yield dropped
        instant = station.instant
        if instant is None:
            return
        status = instant.status
        if math.isfinite(status.link_age_s):
            yield _gauge("autonomy_link_age_seconds", "Silence of the link.", status.link_age_s)
        if status.battery_remaining is not None:
            yield _gauge("autonomy_battery_ratio", "What is left.", status.battery_remaining)
        yield _gauge("autonomy_armed", "1 while armed.", float(status.armed))
        ages = GaugeMetricFamily(
            "autonomy_beam_age_seconds", "Age of the newest reading.", labels=["beam"]
        )
        for name, reading in instant.readings.items():
            ages.add_metric([name], max(0.0, instant.now_s - reading.stamp_s))
        yield ages
        command = instant.command
        if command is None:
            return
        decision = command.decision
        doubted = {doubt.beam: doubt.word.value for doubt in decision.doubts}
        believed = GaugeMetricFamily(
            "autonomy_beam_believed", "0 while a beam is doubted, and why.", labels=["beam", "word"]
        )
        for mount in station.config.beams.mounts:
            word = doubted.get(mount.name, "ok")
            believed.add_metric([mount.name, word], float(mount.name not in doubted))
        yield believed
        yield _gauge("autonomy_stops", "Stops of this flight.", decision.stops)
        yield _gauge("autonomy_replans", "Replans of this flight.", decision.replans)
        if decision.walls is not None:
            yield from _wall_gauges(decision.walls)
        if decision.fused is not None:
            yield from _of_estimate(decision.fused)


def _of_estimate(fused: FusedState) -> Iterator[Metric]:
    """Counts begin anew with every mission, as Prometheus expects of a restart."""
    if math.isfinite(fused.position_sigma_m):
        yield _gauge("autonomy_position_sigma_metres", "Of the estimate.", fused.position_sigma_m)
    yield _gauge("autonomy_position_ok", "1 when it may be flown by.", fused.ok)
    if fused.height_agl_m is not None:
        yield _gauge("autonomy_height_metres", "Over the surface below.", fused.height_agl_m)
    if fused.room_above_m is not None:
        yield _gauge("autonomy_room_above_metres", "Below the ceiling.", fused.room_above_m)
    yield from _of_filter(fused.health)


def _of_filter(health: FilterHealth) -> Iterator[Metric]:
    ratios = GaugeMetricFamily(
        "autonomy_filter_test_ratio",
        "Innovation against its gate, newest measurement; above 1 it is rejected.",
        labels=["source"],
    )
    ages = GaugeMetricFamily(
        "autonomy_filter_age_seconds", "Age of the newest one fused.", labels=["source"]
    )
    tested = CounterMetricFamily(
        "autonomy_filter_measurements", "Fused and rejected.", labels=["source", "verdict"]
    )
    for name in SOURCES:
        source = getattr(health, name)
        if not source.fused and not source.rejected:
            continue
        ratios.add_metric([name], source.test_ratio)
        if source.age_s is not None:
            ages.add_metric([name], source.age_s)
        tested.add_metric([name, "fused"], source.fused)
        tested.add_metric([name, "rejected"], source.rejected)
    yield from (ratios, ages, tested)
    if health.gnss_apart_m is not None:
        text = "How far GNSS and the autopilot have drifted apart."
        yield _gauge("autonomy_gnss_apart_metres", text, health.gnss_apart_m)
    steps = CounterMetricFamily("autonomy_surface_steps", "Steps found.", labels=["surface"])
    steps.add_metric(["floor"], health.floor_steps)
    steps.add_metric(["ceiling"], health.ceiling_steps)
    yield steps
    resets = CounterMetricFamily(
        "autonomy_filter_resets", "Jumps of the frame, restarts.", labels=["what"]
    )
    resets.add_metric(["frame_jump"], health.frame_jumps)
    resets.add_metric(["restart"], health.restarts)
    yield resets


def _wall_gauges(walls: WallFixReport) -> Iterator[Metric]:
    """What beams on known walls say of the autopilot's frame."""
    offset = GaugeMetricFamily(
        "autonomy_walls_offset_metres", "Drift taken from the position.", labels=["axis"]
    )
    sigma = GaugeMetricFamily(
        "autonomy_walls_offset_sigma_metres", "Of that, against walls in sight.", labels=["axis"]
    )
    for axis, offset_m, sigma_m in zip(
        ("north", "east"), walls.offset_ne_m, walls.sigma_ne_m, strict=True
    ):
        offset.add_metric([axis], offset_m)
        sigma.add_metric([axis], sigma_m)
    yield offset
    yield sigma
    yield _gauge("autonomy_walls_test_ratio", "The largest of a tick; 1 passes.", walls.test_ratio)
    yield _gauge("autonomy_walls_fused", "Rays fused in this flight.", walls.fused)
    yield _gauge("autonomy_walls_rejected", "Rays beyond the gate.", walls.rejected)
    yield _gauge("autonomy_walls_forgotten", "Cells of walls that were moved.", walls.forgotten)


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(name, text, value=float(value))
