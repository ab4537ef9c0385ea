"""The vehicle on the link, looked at before flying: who it is, how it is configured, what it
measures, and why it would not arm. Nothing is commanded, but parameters may be set on request.
"""

import asyncio
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import msgspec

from autonomy import px4_advice
from autonomy.config import Config
from autonomy.finding import Finding, Fix, bad, note, ok
from autonomy.mission.preflight import hold_keeps_down
from autonomy.px4_health import Event, SensorReport, failed_checks, unwell
from autonomy.virtual_world import warning
from hal import registry
from hal.clock import MonotonicClock
from hal.drops import Dropped, dropped_by
from hal.errors import HalError
from hal.interfaces import Clock, MessageSource, RangeSensor, WireMessage
from hal.readings import (
    Attitude,
    FlightMode,
    GnssFix,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleFacts,
    VehicleStatus,
)
from hal.troubles import troubles_of

LOOK_S = 3.0
"""How long sensors are watched."""
STARTS_S = 1.0
"""How long sensors on this computer may take to start before that."""

_POLL_S = 0.02
_HALF_RATE = 0.5
_LEAST_POSITION_HZ = 10.0
_STEADY_M, _STEADY_M_S = 0.10, 0.10
"""Standard deviations of a vehicle that stands still; measured: 4 cm and 3 cm/s with GNSS."""
_HEALTH_COMES_S = 1.0
_OLD_S = 0.5
_LINK_OLD_S = 2.0
"""Heartbeats come once a second: an older link may have missed that the vehicle was armed."""
_AUTOPILOT_COMPONENT = 1
_USUAL = frozenset({"another sender", "echo", "overruled"})
"""Reasons for dropping a message that a sound vehicle gives, too."""

Confirm = Callable[[Sequence[Fix]], bool]


@dataclass
class Look:
    """What was heard of the vehicle while it was watched."""

    seconds: float = LOOK_S
    positions: list[LocalPosition] = field(default_factory=list)
    attitudes: list[Attitude] = field(default_factory=list)
    readings: list[RangeReading] = field(default_factory=list)
    fix: GnssFix | None = None
    status: VehicleStatus | None = None
    ended_s: float = 0.0
    events: list[Event] = field(default_factory=list)
    sensors: SensorReport | None = None
    texts: list[str] = field(default_factory=list)
    dropped: Dropped = field(default_factory=dict)


class Listener:
    """Keeps what the autopilot says of its health; others on the link have none of its own."""

    def __init__(self, link: MessageSource) -> None:
        self.events: list[Event] = []
        self.sensors: SensorReport | None = None
        self._event = msgspec.json.Decoder(Event)
        self._report = msgspec.json.Decoder(SensorReport)
        link.listen("EVENT", self._take_event)
        link.listen("SYS_STATUS", self._take_report)

    def _take_event(self, message: WireMessage) -> None:
        if message.component_id != _AUTOPILOT_COMPONENT:
            return
        try:
            self.events.append(self._event.decode(message.fields_json))
        except msgspec.DecodeError:
            return  # of a form that this program does not know: it has no words for it

    def _take_report(self, message: WireMessage) -> None:
        if message.component_id != _AUTOPILOT_COMPONENT:
            return
        try:
            self.sensors = self._report.decode(message.fields_json)
        except msgspec.DecodeError:
            return


def check_vehicle(config: Config, connection: str) -> tuple[Finding, ...]:
    """Everything about the vehicle there; an error of the link is a finding, not an exception."""
    return asyncio.run(_check(config, connection, None))


def mend_vehicle(config: Config, connection: str, confirm: Confirm) -> tuple[Finding, ...]:
    """As `check_vehicle`, then sets what it would fix, if `confirm` agrees to the list.

    Refuses an armed or flying vehicle. Every value is read back.
    """
    return asyncio.run(_check(config, connection, confirm))


def set_parameters(
    config: Config, connection: str, wanted: Sequence[tuple[str, float]]
) -> tuple[Finding, ...]:
    """Set parameters by name and read them back; refuses an armed or flying vehicle."""
    return asyncio.run(_set(config, connection, wanted))


# ---------------------------------------------------------------- the link


async def _check(config: Config, connection: str, confirm: Confirm | None) -> tuple[Finding, ...]:
    clock = MonotonicClock()
    vehicle = _vehicle(config, connection, clock)
    listener = Listener(vehicle)
    try:
        facts = await vehicle.open(config.vehicle.connect_timeout_s)
        version = px4_advice.version_of(facts.version)
        parameters = await vehicle.read_parameters(px4_advice.kinds(version))
        look, trouble = await _watched(config, vehicle, listener, clock)
        found = [
            ok(f"{facts.autopilot} {facts.version}, system {facts.system_id}, on {connection}"),
            px4_advice.about_version(facts.version),
            *trouble,
            *judged(config, facts, parameters, look),
        ]
        if confirm is not None:
            found += await mend(vehicle, [f.fix for f in found if f.fix is not None], confirm)
    except HalError as error:
        return (bad(f"{connection}: {error}", "link"),)
    finally:
        await vehicle.close()
    return tuple(found)


def _vehicle(config: Config, connection: str, clock: Clock) -> registry.LinkedVehicle:
    vehicle_config = config.vehicle.model_copy(update={"connection": connection})
    return registry.vehicle(vehicle_config, config.beams, clock)


async def _watched(
    config: Config, vehicle: registry.LinkedVehicle, listener: Listener, clock: Clock
) -> tuple[Look, list[Finding]]:
    """What was heard in `LOOK_S`, and what could not be opened."""
    look, trouble = Look(), []
    # None is waited for: one that is missing is told, and hides no other.
    sensors = registry.range_sensors(config.beams, vehicle, clock, frozenset())
    gnss = registry.gnss(config.gnss, vehicle, clock)
    deadline_s = min(LOOK_S, config.vehicle.connect_timeout_s)
    opened: list[RangeSensor] = []
    try:
        for sensor in sensors:
            try:
                await sensor.open(deadline_s)
                opened.append(sensor)
            except HalError as error:
                trouble.append(bad(str(error), "beams"))
        if gnss is not None:
            try:
                await gnss.open(min(deadline_s, 2.0))
            except HalError:
                gnss = None  # said by the judgement: there is none
        if config.beams.wired():
            await asyncio.sleep(STARTS_S)
        for sensor in opened:
            sensor.take()
        await _listen(look, vehicle, opened)
        trouble += troubles(opened)
        look.ended_s = clock.now_s()
        look.fix = gnss.fix() if gnss is not None else None
        await _health(look, vehicle, listener)
        look.dropped = dropped_by((vehicle, *opened, gnss))
    finally:
        for sensor in opened:
            await sensor.close()
        if gnss is not None:
            await gnss.close()
    look.status = vehicle.status()
    return look, trouble


async def _listen(
    look: Look, vehicle: registry.LinkedVehicle, sensors: Sequence[RangeSensor]
) -> None:
    ends_s = time.monotonic() + LOOK_S
    while time.monotonic() < ends_s:
        await asyncio.sleep(_POLL_S)
        look.readings += [reading for sensor in sensors for reading in sensor.take()]
        position, attitude = vehicle.local_position(), vehicle.attitude()
        if position is not None and position not in look.positions[-1:]:
            look.positions.append(position)
        if attitude is not None and attitude not in look.attitudes[-1:]:
            look.attitudes.append(attitude)


def troubles(sensors: Sequence[RangeSensor]) -> list[Finding]:
    """What is wrong with single ones of them."""
    told = troubles_of(sensors)
    return [bad(f"beam {name}: {trouble}", "beams") for name, trouble in told.items()]


async def _health(look: Look, vehicle: registry.LinkedVehicle, listener: Listener) -> None:
    """What stands against arming, told anew: what was told before this program came is unknown."""
    vehicle.take_texts()
    if not vehicle.status().armed:
        listener.events.clear()
        await vehicle.report_health()
        await asyncio.sleep(_HEALTH_COMES_S)
    look.events, look.sensors = list(listener.events), listener.sensors
    look.texts = [text.text for text in vehicle.take_texts() if "reflight" in text.text]


# ---------------------------------------------------------------- the judgement


def judged(
    config: Config, facts: VehicleFacts, parameters: dict[str, float], look: Look
) -> tuple[Finding, ...]:
    """What was heard, as findings. Pure."""
    status = look.status
    if status is None:
        raise ValueError("the vehicle was not watched: look at it first")
    situation = px4_advice.Situation(
        config, global_position=status.global_position, has_gnss=look.fix is not None
    )
    version = px4_advice.version_of(facts.version)
    virtual = config.beams.virtual()
    return (
        *px4_advice.parameter_findings(version, parameters, situation),
        *_arming(status, look),
        *_position(status, look),
        *about_gnss(look.fix),
        *_battery(config, status),
        *((note(warning(virtual), "beams"),) if virtual is not None else ()),
        *check_beams(config, look.readings, look.seconds, look.ended_s),
        *_drops(look.dropped),
    )


def _arming(status: VehicleStatus, look: Look) -> tuple[Finding, ...]:
    """Whether it would arm now, and why not: by its events, else by its texts."""
    if status.armed:
        return (bad("it is armed; disarm it before anybody comes near", "arming"),)
    sick = unwell(look.sensors) if look.sensors is not None else ()
    found = [bad(f"PX4 does not find its {name} well", "sensors") for name in sick]
    if status.armable:
        return (*found, ok(f"it is ready to arm in {status.mode.value}", "arming"))
    if hold_keeps_down(status) and not failed_checks(look.events, FlightMode.TAKEOFF.value):
        sentence = (
            "it will not arm in hold, which needs a global position; this service arms it in "
            "Takeoff, which PX4's report does not forbid"
        )
        return (*found, note(sentence, "arming"))
    reasons = failed_checks(look.events, status.mode.value) or tuple(dict.fromkeys(look.texts))
    if not reasons:
        reasons = (status.not_armable_because,)
    return (
        *found,
        *(bad(f"it will not arm in {status.mode.value}: {reason}", "arming") for reason in reasons),
    )


def _position(status: VehicleStatus, look: Look) -> tuple[Finding, ...]:
    """Rate, age and steadiness of the local position."""
    if not look.positions:
        sentence = (
            "it has no local position: give PX4 a source (GNSS, optical flow with a range sensor "
            "below, or motion capture or visual odometry with EKF2_EV_CTRL)"
        )
        return (bad(sentence, "position"),)
    rate_hz = len(look.positions) / look.seconds
    age_s = max(0.0, look.ended_s - look.positions[-1].stamp_s)
    spread_m = _spread([p.position_ned_m[:2] for p in look.positions])
    spread_m_s = _spread([p.velocity_ned_m_s[:2] for p in look.positions])
    figures = f"{rate_hz:.0f} Hz, {spread_m * 100:.1f} cm and {spread_m_s * 100:.1f} cm/s of noise"
    found = [
        bad(f"the local position comes at {rate_hz:.1f} Hz only: raise its stream", "position")
        if rate_hz < _LEAST_POSITION_HZ
        else ok(f"local position: {figures}", "position")
    ]
    if spread_m > _STEADY_M or spread_m_s > _STEADY_M_S:
        sentence = f"the local position wanders ({figures}); on the ground it should stand still"
        found.append(note(sentence, "position"))
    if len({p.reset_counter for p in look.positions}) > 1:
        found.append(note("the local position jumped (estimator reset): wait", "position"))
    if age_s > _OLD_S:
        found.append(bad(f"the local position is {age_s:.1f} s old", "position"))
    if not status.global_position:
        found.append(
            note(
                "it has no global position: PX4 does not hold or return (Hold is refused, a "
                "failsafe Hold becomes Land)",
                "position",
            )
        )
    return tuple(found)


def _spread(places: Sequence[tuple[float, ...]]) -> float:
    """The larger standard deviation of the two axes."""
    if len(places) < 2:
        return 0.0
    return max(float(statistics.pstdev(axis)) for axis in zip(*places, strict=True))


def about_gnss(fix: GnssFix | None) -> tuple[Finding, ...]:
    """What the receiver says; None: there is none, or it is silent."""
    if fix is None:
        return (ok("no GNSS receiver is heard of; the local position is flown by", "gnss"),)
    if not fix.fix_type.has_position:
        sentence = f"GNSS has no position ({fix.fix_type.value}); the local position is flown by"
        return (note(sentence, "gnss"),)
    figures = f"{fix.satellites} satellites, {fix.horizontal_accuracy_m:.1f} m"
    return (ok(f"GNSS: {fix.fix_type.value}, {figures}", "gnss"),)


def _battery(config: Config, status: VehicleStatus) -> tuple[Finding, ...]:
    remaining = status.battery_remaining
    if remaining is None:
        return (note("it does not tell its battery", "battery"),)
    if remaining <= config.failsafe.battery_warn:
        sentence = f"the battery is at {remaining:.0%}: charge it"
        return (bad(sentence, "battery"),)
    return (ok(f"the battery is at {remaining:.0%}", "battery"),)


def _drops(dropped: Dropped) -> tuple[Finding, ...]:
    """What came in and was not believed; what others on the link say is none of it."""
    counted = sorted((what, count) for what, count in dropped.items() if what[1] not in _USUAL)
    if not counted:
        return ()
    words = ", ".join(f"{source} {count} times ({why})" for (source, why), count in counted)
    return (note(f"not believed: {words}", "link"),)


def check_beams(
    config: Config, readings: Sequence[RangeReading], seconds: float, now_s: float | None = None
) -> tuple[Finding, ...]:
    """One finding a configured beam, from what was read of all of them in `seconds`."""
    by_beam: defaultdict[str, list[RangeReading]] = defaultdict(list)
    for reading in readings:
        by_beam[reading.beam].append(reading)
    return tuple(
        _beam(config, mount.name, by_beam[mount.name], seconds, now_s)
        for mount in config.beams.mounts
    )


def _beam(
    config: Config, name: str, own: Sequence[RangeReading], seconds: float, now_s: float | None
) -> Finding:
    rate_hz = len(own) / seconds
    age_s = max(0.0, now_s - own[-1].stamp_s) if own and now_s is not None else 0.0
    if all(reading.status is RangeStatus.NO_SIGNAL for reading in own):
        what = "measures nothing" if own else "sends nothing"
        sentence = f"beam {name} {what}; check the sensor, its wiring and beams.mounts"
        return bad(sentence, "beams")
    if rate_hz < _HALF_RATE * config.control.rate_hz:
        sentence = (
            f"beam {name} comes at {rate_hz:.1f} Hz only; the loop runs at "
            f"{config.control.rate_hz:g} Hz: raise the sensor's rate"
        )
        return bad(sentence, "beams")
    if age_s > _OLD_S:
        return bad(f"beam {name} was last heard {age_s:.1f} s ago", "beams")
    words = [f"{rate_hz:.1f} Hz, {age_s * 1000:.0f} ms old"]
    ranges = [reading.range_m for reading in own if reading.status is RangeStatus.VALID]
    if len(ranges) > 2:
        noise_mm = statistics.stdev(ranges) * 1000
        words.append(f"{statistics.mean(ranges):.2f} m with {noise_mm:.0f} mm of noise")
    else:
        words.append(own[-1].status.value.replace("_", " "))
    lost = sum(reading.status is RangeStatus.NO_SIGNAL for reading in own)
    if lost:
        words.append(f"{lost / len(own):.0%} without a measurement")
    return ok(f"beam {name}: {', '.join(words)}", "beams")


# ---------------------------------------------------------------- setting parameters


async def mend(
    vehicle: registry.LinkedVehicle, fixes: Sequence[Fix], confirm: Confirm
) -> list[Finding]:
    """Set the parameters if `confirm` agrees; one finding each, read back.

    A vehicle that is armed or flies is left as it is, also when it is armed meanwhile or is not
    heard any more.
    """
    if not fixes:
        return [ok("no parameter has to be set", "fix")]
    refusal = _in_use(vehicle.status())
    if refusal is not None:
        return [refusal]
    if not confirm(fixes):
        return [note("no parameter was set", "fix")]
    return [await _write(vehicle, fix) for fix in fixes]


def _in_use(status: VehicleStatus) -> Finding | None:
    if status.armed or status.landed not in (LandedState.ON_GROUND, LandedState.UNKNOWN):
        sentence = "parameters are set on the ground and disarmed only; nothing was set"
        return bad(sentence, "fix")
    if status.link_age_s > _LINK_OLD_S:
        sentence = (
            f"the vehicle was last heard {status.link_age_s:.0f} s ago and may be armed by now; "
            "nothing was set"
        )
        return bad(sentence, "fix")
    return None


async def _write(vehicle: registry.LinkedVehicle, fix: Fix) -> Finding:
    if fix.integer and not float(fix.new).is_integer():
        return bad(f"{fix.name} was not set: it takes whole numbers, not {fix.new:g}", "fix")
    if _in_use(vehicle.status()) is not None:  # somebody may arm it meanwhile
        return bad(f"{fix.name} was not set: the vehicle is armed, flies, or is not heard", "fix")
    held = await vehicle.write_parameter(fix.name, fix.value(fix.new))
    if held is None or abs(held - fix.new) > 1e-4 * max(1.0, abs(fix.new)):
        got = "nothing" if held is None else f"{held:g}"
        sentence = f"{fix.name} was not set: asked for {fix.new:g}, the vehicle holds {got}"
        return bad(sentence, "fix")
    sentence = f"{fix.name}: {fix.old:g} -> {fix.new:g}, read back"
    return Finding(good=True, sentence=sentence, subject="fix", fix=fix)


async def _set(
    config: Config, connection: str, wanted: Sequence[tuple[str, float]]
) -> tuple[Finding, ...]:
    vehicle = _vehicle(config, connection, MonotonicClock())
    kinds = {advice.name: advice.kind for advice in px4_advice.ADVICE}
    found = []
    try:
        await vehicle.open(config.vehicle.connect_timeout_s)
        refusal = _in_use(vehicle.status())
        if refusal is not None:
            return (refusal,)
        for name, value in wanted:
            kind = kinds.get(name)
            old = await vehicle.read_parameters({name: kind}) if kind is not None else {}
            if kind is None or name not in old:
                found.append(bad(f"{name} is not one of this program's parameters", "fix"))
                continue
            fix = Fix(name, old[name], value, integer=kind is int)
            found.append(await _write(vehicle, fix))
    except HalError as error:
        return (*found, bad(f"{connection}: {error}", "link"))
    finally:
        await vehicle.close()
    return tuple(found)


def undo(connection: str, fixes: Sequence[Fix]) -> str:
    """The command that sets the old values again."""
    settings = " ".join(f"--set {fix.name}={fix.old:g}" for fix in fixes)
    return f"autonomy check --connection {connection} {settings}"
