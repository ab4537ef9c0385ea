"""The messages that the mock PX4 streams by itself, with PX4's rates and field values.

Rates, sources and constants: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from hal.frames import geodetic_from_ned
from hal.readings import FixType, GnssFix
from hal.sim.mock_px4_housekeeping import (
    HOUSEKEEPING,
    component_information,
    component_metadata,
    flight_information,
    protocol_version,
)
from hal.sim.mock_px4_messages import (
    COMPONENT_INFORMATION,
    COMPONENT_METADATA,
    CURRENT_EVENT_SEQUENCE,
    PROTOCOL_VERSION,
)
from hal.sim.mock_px4_plant import Plant
from hal.sim.px4 import Mode

Message = Any  # pymavlink is untyped
"""One pymavlink message."""

_SENSORS_PRESENT, _SENSORS_ENABLED, _SENSORS_HEALTH = 0x0300C02F, 0x0301C02F, 0x1320C83F
_PREARM_CHECK = 0x10000000
_POSE_VARIANCES = (0.041, 0.041, 5e-4, 1.5e-5, 1.4e-5, 3.6e-4)
_VELOCITY_VARIANCES = (8.4e-3, 8.5e-3, 9.4e-4, 0.0, 0.0, 0.0)
_FULL_MV, _HALF_MV = 16200, 15300
_EARLY_TICK_S = 1e-6
_NO_MISSION_TOTAL = 65535

_FIX_TYPES = {fix: number for number, fix in enumerate(FixType)}


def _diagonal(variances: tuple[float, ...]) -> list[float]:
    """The upper triangle of a diagonal covariance, row by row."""
    triangle: list[float] = []
    for row, variance in enumerate(variances):
        triangle += [variance] + [0.0] * (len(variances) - row - 1)
    return triangle


class Stream(NamedTuple):
    """One periodic message: its id, PX4's default rate and how it is made (None: not now)."""

    message_id: int
    rate_hz: float
    build: Callable[[Plant], Message | None]


def boot_ms(plant: Plant) -> int:
    """time_boot_ms."""
    return round(plant.autopilot.uptime_s * 1e3) & 0xFFFFFFFF


def boot_us(plant: Plant) -> int:
    """time_usec since boot."""
    return round(plant.autopilot.uptime_s * 1e6)


def heartbeat(plant: Plant) -> Message:
    """HEARTBEAT: type quadrotor, autopilot PX4."""
    pilot = plant.autopilot
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        pilot.base_mode,
        int(pilot.mode),
        int(pilot.system_status),
        3,
    )


def _millivolts(plant: Plant) -> int:
    remaining = plant.autopilot.battery_remaining
    return round(_HALF_MV + (_FULL_MV - _HALF_MV) * (remaining - 0.5) / 0.5)


def _percent(plant: Plant) -> int:
    return round(100.0 * plant.autopilot.battery_remaining)


def sys_status(plant: Plant) -> Message:
    """SYS_STATUS: the prearm check bit says whether it can be armed."""
    health = _SENSORS_HEALTH
    if plant.autopilot.not_armable_because and not plant.autopilot.armed:
        health &= ~_PREARM_CHECK
    return mavlink.MAVLink_sys_status_message(
        onboard_control_sensors_present=_SENSORS_PRESENT,
        onboard_control_sensors_enabled=_SENSORS_ENABLED,
        onboard_control_sensors_health=health,
        load=200,
        voltage_battery=_millivolts(plant),
        current_battery=-1,
        battery_remaining=_percent(plant),
        drop_rate_comm=0,
        errors_comm=0,
        errors_count1=0,
        errors_count2=0,
        errors_count3=0,
        errors_count4=0,
    )


def battery_status(plant: Plant) -> Message:
    """BATTERY_STATUS."""
    return mavlink.MAVLink_battery_status_message(
        id=0,
        battery_function=1,
        type=1,
        temperature=32767,
        voltages=[_millivolts(plant)] + [65535] * 9,
        current_battery=-1,
        current_consumed=0,
        energy_consumed=-1,
        battery_remaining=_percent(plant),
        time_remaining=0,
        charge_state=1,
    )


def extended_sys_state(plant: Plant) -> Message:
    """EXTENDED_SYS_STATE."""
    return mavlink.MAVLink_extended_sys_state_message(0, int(plant.autopilot.landed))


def current_mode(plant: Plant) -> Message:
    """CURRENT_MODE: keeps the mode that was asked for during a failsafe."""
    pilot = plant.autopilot
    return mavlink.MAVLink_current_mode_message(0, int(pilot.mode), int(pilot.intended_mode))


def local_position(plant: Plant) -> Message | None:
    """LOCAL_POSITION_NED."""
    heard = plant.position
    if heard is None:
        return None
    return mavlink.MAVLink_local_position_ned_message(
        boot_ms(plant), *heard.position_ned_m, *heard.velocity_ned_m_s
    )


def _angles(plant: Plant) -> tuple[float, float, float]:
    roll, pitch = plant.autopilot.quadrotor.tilt_rad
    return roll, pitch, plant.autopilot.estimated_yaw_rad


def attitude(plant: Plant) -> Message:
    """ATTITUDE."""
    rate = plant.autopilot.quadrotor.yaw_rate_rad_s
    return mavlink.MAVLink_attitude_message(boot_ms(plant), *_angles(plant), 0.0, 0.0, rate)


def quaternion(plant: Plant) -> list[float]:
    """Attitude NED -> FRD as (w, x, y, z)."""
    roll, pitch, yaw = (0.5 * angle for angle in _angles(plant))
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def attitude_quaternion(plant: Plant) -> Message:
    """ATTITUDE_QUATERNION."""
    rate = plant.autopilot.quadrotor.yaw_rate_rad_s
    return mavlink.MAVLink_attitude_quaternion_message(
        boot_ms(plant), *quaternion(plant), 0.0, 0.0, rate
    )


def odometry(plant: Plant) -> Message | None:
    """ODOMETRY in local NED with the estimator's reset counter."""
    heard = plant.position
    if heard is None:
        return None
    rate = plant.autopilot.quadrotor.yaw_rate_rad_s
    return mavlink.MAVLink_odometry_message(
        boot_us(plant),
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,
        *heard.position_ned_m,
        quaternion(plant),
        *heard.velocity_ned_m_s,
        0.0,
        0.0,
        rate,
        _diagonal(_POSE_VARIANCES),
        _diagonal(_VELOCITY_VARIANCES),
        reset_counter=heard.reset_counter,
        estimator_type=mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        quality=0,
    )


def global_position(plant: Plant) -> Message | None:
    """GLOBAL_POSITION_INT; heading in centidegrees. Silent without a global position."""
    heard = plant.position
    if heard is None or not plant.autopilot.global_position:
        return None
    pilot = plant.autopilot
    lat, lon, amsl = geodetic_from_ned(heard.position_ned_m, pilot.origin)
    return mavlink.MAVLink_global_position_int_message(
        boot_ms(plant),
        round(lat * 1e7),
        round(lon * 1e7),
        round(amsl * 1e3),
        round((pilot.home_ned_m[2] - heard.position_ned_m[2]) * 1e3),
        *(round(v * 100.0) for v in heard.velocity_ned_m_s),
        hdg=round(math.degrees(pilot.estimated_yaw_rad) * 100.0) % 36000,
    )


def gps_raw(plant: Plant, fix: GnssFix) -> Message:
    """GPS_RAW_INT of one solution, stamped with the time it was measured at."""
    velocity = plant.autopilot.quadrotor.velocity_ned_m_s
    return mavlink.MAVLink_gps_raw_int_message(
        time_usec=max(round(plant.autopilot.on_its_clock_s(fix.stamp_s) * 1e6), 0),
        fix_type=_FIX_TYPES[fix.fix_type],
        lat=round(fix.latitude_deg * 1e7),
        lon=round(fix.longitude_deg * 1e7),
        alt=round(fix.amsl_m * 1e3),
        eph=70,
        epv=110,
        vel=round(100.0 * math.hypot(velocity[0], velocity[1])),
        cog=round(100.0 * math.degrees(math.atan2(velocity[1], velocity[0]))) % 36000,
        satellites_visible=fix.satellites,
        alt_ellipsoid=round(fix.amsl_m * 1e3),
        h_acc=round(fix.horizontal_accuracy_m * 1e3),
        v_acc=round(fix.vertical_accuracy_m * 1e3),
        vel_acc=400,
    )


def _last_gps(plant: Plant) -> Message | None:
    return gps_raw(plant, plant.fix) if plant.fix is not None else None


def mission_current(plant: Plant) -> Message:
    """MISSION_CURRENT: without a mission the total is 65535, as PX4 says it."""
    mission, flying = plant.autopilot.mission, plant.autopilot.mode is Mode.MISSION
    state = mavlink.MISSION_STATE_PAUSED
    if not mission.items:
        state = mavlink.MISSION_STATE_NO_MISSION
    elif mission.finished:
        state = mavlink.MISSION_STATE_COMPLETE
    elif flying:
        state = mavlink.MISSION_STATE_ACTIVE
    elif mission.current == 0:
        state = mavlink.MISSION_STATE_NOT_STARTED
    return mavlink.MAVLink_mission_current_message(
        mission.current, len(mission.items) or _NO_MISSION_TOTAL, state, 1 if flying else 2
    )


def home_position(plant: Plant) -> Message | None:
    """HOME_POSITION: set anew at each arming and take-off; none without a global position."""
    pilot = plant.autopilot
    if not pilot.global_position:
        return None
    lat, lon, amsl = geodetic_from_ned(pilot.home_ned_m, pilot.origin)
    return mavlink.MAVLink_home_position_message(
        round(lat * 1e7),
        round(lon * 1e7),
        round(amsl * 1e3),
        *pilot.home_ned_m,
        [1.0, 0.0, 0.0, 0.0],
        0.0,
        0.0,
        0.0,
        round(pilot.home_set_s * 1e6),
    )


def gps_global_origin(plant: Plant) -> Message | None:
    """GPS_GLOBAL_ORIGIN of the local frame, where it is known."""
    if not plant.autopilot.global_position:
        return None
    lat, lon, amsl = plant.autopilot.origin
    return mavlink.MAVLink_gps_global_origin_message(
        round(lat * 1e7), round(lon * 1e7), round(amsl * 1e3), boot_us(plant)
    )


def altitude(plant: Plant) -> Message:
    """ALTITUDE."""
    pilot = plant.autopilot
    down = pilot.estimated_position_ned_m[2]
    return mavlink.MAVLink_altitude_message(
        boot_us(plant),
        pilot.origin[2] - down,
        pilot.origin[2] - down,
        -down,
        pilot.home_ned_m[2] - down,
        0.0,
        pilot.quadrotor.height_m,
    )


def vfr_hud(plant: Plant) -> Message:
    """VFR_HUD."""
    pilot = plant.autopilot
    velocity = pilot.estimated_velocity_ned_m_s
    return mavlink.MAVLink_vfr_hud_message(
        math.nan,
        math.hypot(velocity[0], velocity[1]),
        round(math.degrees(pilot.estimated_yaw_rad)) % 360,
        50 if pilot.armed else 0,
        pilot.origin[2] - pilot.estimated_position_ned_m[2],
        -velocity[2],
    )


def system_time(plant: Plant) -> Message:
    """SYSTEM_TIME: the host's calendar beside the autopilot's own time."""
    return mavlink.MAVLink_system_time_message(time.time_ns() // 1000, boot_ms(plant))


def timesync(plant: Plant) -> Message:
    """TIMESYNC as PX4 asks it."""
    return mavlink.MAVLink_timesync_message(0, round(plant.autopilot.uptime_s * 1e9))


def ping(plant: Plant) -> Message:
    """PING as PX4 asks it."""
    return mavlink.MAVLink_ping_message(boot_us(plant), int(plant.autopilot.uptime_s), 0, 0)


def autopilot_version(_plant: Plant) -> Message:
    """AUTOPILOT_VERSION, only sent on request."""
    return mavlink.MAVLink_autopilot_version_message(
        capabilities=0xE8FF,
        flight_sw_version=0x01130040,
        middleware_sw_version=0x01130040,
        os_sw_version=101854463,
        board_version=1,
        flight_custom_version=[0] * 8,
        middleware_custom_version=[0] * 8,
        os_custom_version=[0] * 8,
        vendor_id=0,
        product_id=0,
        uid=0x4954414C44494E4F,
    )


STREAMS: tuple[Stream, ...] = (
    Stream(mavlink.MAVLINK_MSG_ID_HEARTBEAT, 1.0, heartbeat),
    Stream(mavlink.MAVLINK_MSG_ID_SYS_STATUS, 5.0, sys_status),
    Stream(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 5.0, extended_sys_state),
    Stream(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 0.5, battery_status),
    Stream(mavlink.MAVLINK_MSG_ID_CURRENT_MODE, 0.5, current_mode),
    Stream(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 30.0, local_position),
    Stream(mavlink.MAVLINK_MSG_ID_ODOMETRY, 30.0, odometry),
    Stream(mavlink.MAVLINK_MSG_ID_ATTITUDE, 100.0, attitude),
    Stream(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, 50.0, attitude_quaternion),
    Stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 50.0, global_position),
    Stream(mavlink.MAVLINK_MSG_ID_HOME_POSITION, 0.5, home_position),
    Stream(mavlink.MAVLINK_MSG_ID_ALTITUDE, 10.0, altitude),
    Stream(mavlink.MAVLINK_MSG_ID_VFR_HUD, 10.0, vfr_hud),
    Stream(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0, mission_current),
    Stream(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 1.0, system_time),
    Stream(mavlink.MAVLINK_MSG_ID_PING, 1.0, ping),
    Stream(mavlink.MAVLINK_MSG_ID_TIMESYNC, 10.0, timesync),
    *(Stream(*entry) for entry in HOUSEKEEPING),
)

SAMPLED = (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR)
"""Messages that are sent when their sensor measured, not by a timer."""

ON_REQUEST: dict[int, Callable[[Plant], Message | None]] = {
    **{s.message_id: s.build for s in STREAMS if s.message_id != CURRENT_EVENT_SEQUENCE.message_id},
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _last_gps,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    PROTOCOL_VERSION.message_id: protocol_version,
    mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION: flight_information,
    COMPONENT_METADATA.message_id: component_metadata,
    COMPONENT_INFORMATION.message_id: component_information,
}
"""What MAV_CMD_REQUEST_MESSAGE can ask for."""


class Schedule:
    """When each stream of one link is due; intervals can be changed by the other side."""

    def __init__(self) -> None:
        self._interval_s: dict[int, float] = {}
        self._due_s: dict[int, float] = {}
        self._default_s = {stream.message_id: 1.0 / stream.rate_hz for stream in STREAMS}

    def known(self, message_id: int) -> bool:
        """True for a message whose interval can be set (PX4 refuses HEARTBEAT)."""
        if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return False
        return message_id in self._default_s or message_id in SAMPLED

    def set_interval(self, message_id: int, interval_us: float) -> None:
        """-1 stops the stream, 0 restores the default rate."""
        if interval_us == 0.0:
            self._interval_s.pop(message_id, None)
        else:
            self._interval_s[message_id] = interval_us * 1e-6 if interval_us > 0 else math.inf
        self._due_s.pop(message_id, None)

    def interval_us(self, message_id: int) -> int:
        """As MESSAGE_INTERVAL tells it: -1 stopped, 0 not available."""
        default = self._default_s.get(message_id, 0.0)
        interval_s = self._interval_s.get(message_id, default)
        return -1 if math.isinf(interval_s) else round(interval_s * 1e6)

    def allows(self, message_id: int) -> bool:
        """False for a sampled message that was stopped."""
        return not math.isinf(self._interval_s.get(message_id, 0.0))

    def take_due(self, now_s: float) -> list[Stream]:
        """The streams that are due, and their next time; keeps phase, never bursts."""
        due = []
        for stream in STREAMS:
            key = stream.message_id
            at_s = self._due_s.setdefault(key, now_s)
            if now_s < at_s - _EARLY_TICK_S:
                continue
            interval_s = self._interval_s.get(key, self._default_s[key])
            next_s = at_s + interval_s
            self._due_s[key] = next_s if next_s > now_s else now_s + interval_s
            if not math.isinf(interval_s):
                due.append(stream)
        return due
