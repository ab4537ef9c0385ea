"""What else PX4 streams: setpoints in use, actuators, estimator health, remote identification.

Nobody here steers by it, but a client meets it on every link. Rates and values: measured on PX4
main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from hal.frames import Vector3, geodetic_from_ned
from hal.sim.mock_px4_messages import (
    COMPONENT_INFORMATION,
    COMPONENT_METADATA,
    CURRENT_EVENT_SEQUENCE,
    ESC_INFO,
    ESC_STATUS,
    ESTIMATOR_SENSOR_FUSION_STATUS,
    EVENT,
    LINK_NODE_STATUS,
    PROTOCOL_VERSION,
    TIME_ESTIMATE_TO_TARGET,
    ExtraMessage,
)
from hal.sim.mock_px4_plant import Plant
from hal.sim.px4 import Mode
from hal.sim.px4_events import AutopilotEvent
from hal.sim.quadrotor import GRAVITY_M_S2

Message = Any  # pymavlink is untyped
Builder = Callable[[Plant], Message | None]

_HOVER_PWM, _IDLE_PWM, _STOPPED_PWM = 1490, 1050, 900
_HOVER_RPM = 7000
_PRESSURE_HPA, _HPA_PER_M = 955.8, 0.1134
_FIELDS_UPDATED = 0x1FF
_ESTIMATE_FLAGS = 0x3FF
_POSITION_IGNORED, _VELOCITY_IGNORED = (1, 2, 4), (8, 16, 32)
_LIBRARY_HASH = bytes((76, 224, 116, 205, 55, 198, 89, 187))
_METADATA_CRC = 276660753
_METADATA_URI = b"mftp://etc/extras/component_general.json.xz"


def _ms(plant: Plant) -> int:
    return round(plant.autopilot.uptime_s * 1e3) & 0xFFFFFFFF


def _us(plant: Plant) -> int:
    return round(plant.autopilot.uptime_s * 1e6)


def event_message(event: AutopilotEvent) -> ExtraMessage:
    """EVENT, to everybody."""
    return ExtraMessage(
        EVENT,
        id=event.kind.number,
        event_time_boot_ms=round(event.at_s * 1e3) & 0xFFFFFFFF,
        sequence=event.sequence,
        destination_component=0,
        destination_system=0,
        log_levels=event.log_levels,
        arguments=event.arguments,
    )


def _event_sequence(plant: Plant) -> Message:
    return ExtraMessage(CURRENT_EVENT_SEQUENCE, sequence=plant.autopilot.event_sequence, flags=0)


# ---------------------------------------------------------------- setpoints in use


def _attitude_target(plant: Plant) -> Message:
    pilot = plant.autopilot
    roll, pitch = pilot.quadrotor.tilt_rad
    half = 0.5 * pilot.estimated_yaw_rad
    q = [math.cos(half), 0.5 * roll, 0.5 * pitch, math.sin(half)]
    thrust = 0.49 if pilot.airborne else 0.001
    return mavlink.MAVLink_attitude_target_message(_ms(plant), 0, q, 0.0, 0.0, 0.0, thrust)


def _mask(position: Vector3, velocity: Vector3) -> int:
    bits = 0
    for vector, ignored in ((position, _POSITION_IGNORED), (velocity, _VELOCITY_IGNORED)):
        bits += sum(bit for bit, v in zip(ignored, vector, strict=True) if math.isnan(v))
    return bits


def _local_target(plant: Plant) -> Message:
    pilot = plant.autopilot
    flown = pilot.flown_command
    position, velocity = flown.position_ned_m, flown.velocity_ned_m_s
    yaw = pilot.estimated_yaw_rad if math.isnan(flown.yaw_rad) else flown.yaw_rad
    return mavlink.MAVLink_position_target_local_ned_message(
        _ms(plant),
        mavlink.MAV_FRAME_LOCAL_NED,
        _mask(position, velocity),
        *position,
        *velocity,
        *(0.0, 0.0, 0.0 if pilot.airborne else 100.0),
        yaw,
        0.0,
    )


def _global_target(plant: Plant) -> Message | None:
    """Only in flight modes of PX4's own, armed."""
    pilot = plant.autopilot
    if not pilot.armed or pilot.mode.main != Mode.HOLD.main:
        return None
    flown = pilot.flown_command
    here = pilot.estimated_position_ned_m
    n, e, d = (h if math.isnan(p) else p for p, h in zip(flown.position_ned_m, here, strict=True))
    lat, lon, amsl = geodetic_from_ned((n, e, d), pilot.origin)
    yaw = pilot.estimated_yaw_rad if math.isnan(flown.yaw_rad) else flown.yaw_rad
    return mavlink.MAVLink_position_target_global_int_message(
        _ms(plant),
        mavlink.MAV_FRAME_GLOBAL_INT,
        0,
        round(lat * 1e7),
        round(lon * 1e7),
        amsl,
        *flown.velocity_ned_m_s,
        *(0.0, 0.0, 0.0),
        yaw,
        0.0,
    )


# ---------------------------------------------------------------- actuators


def _pwm(plant: Plant) -> int:
    pilot = plant.autopilot
    if not pilot.armed:
        return _STOPPED_PWM
    return _HOVER_PWM if pilot.airborne else _IDLE_PWM


def _servos(plant: Plant) -> Message:
    motors, rest = [_pwm(plant)] * 4, [_STOPPED_PWM] * 12
    return mavlink.MAVLink_servo_output_raw_message(_us(plant), 0, *motors, *rest[:4], *rest[4:])


def _esc_info(plant: Plant) -> Message:
    return ExtraMessage(
        ESC_INFO,
        time_usec=_us(plant),
        error_count=(0,) * 4,
        counter=0,
        failure_flags=(0,) * 4,
        temperature=(5000,) * 4,
        index=0,
        count=4,
        connection_type=0,
        info=15,
    )


def _esc_status(plant: Plant) -> Message:
    rpm = _HOVER_RPM if plant.autopilot.airborne else 0
    return ExtraMessage(
        ESC_STATUS,
        time_usec=_us(plant),
        rpm=(rpm,) * 4,
        voltage=(0.0,) * 4,
        current=(0.0,) * 4,
        index=0,
    )


# ---------------------------------------------------------------- sensors and estimator


def _pressure_hpa(plant: Plant) -> float:
    return _PRESSURE_HPA + _HPA_PER_M * plant.autopilot.quadrotor.position_ned_m[2]


def _imu(plant: Plant) -> Message:
    pilot = plant.autopilot
    return mavlink.MAVLink_highres_imu_message(
        _us(plant),
        *(0.0, 0.0, -GRAVITY_M_S2),
        *(0.0, 0.0, pilot.quadrotor.yaw_rate_rad_s),
        *(0.2, 0.0, 0.4),
        _pressure_hpa(plant),
        0.0,
        pilot.origin[2] - pilot.estimated_position_ned_m[2],
        15.0,
        _FIELDS_UPDATED,
        0,
    )


def _scaled_pressure(plant: Plant) -> Message:
    return mavlink.MAVLink_scaled_pressure_message(_ms(plant), _pressure_hpa(plant), 0.0, 1182)


def _estimator(plant: Plant) -> Message:
    return mavlink.MAVLink_estimator_status_message(
        _us(plant), _ESTIMATE_FLAGS, 0.01, 0.003, 0.003, 0.1, 0.004, math.nan, 0.29, 0.025
    )


def _fusion(_plant: Plant) -> Message:
    return ExtraMessage(
        ESTIMATOR_SENSOR_FUSION_STATUS,
        test_ratios=(math.nan,) * 9,
        states=bytes.fromhex("01010000010101000001000000010101"),
    )


def _vibration(plant: Plant) -> Message:
    level = 0.1 if plant.autopilot.airborne else 0.0
    return mavlink.MAVLink_vibration_message(_us(plant), 0.0, 0.01, level, 0, 0, 0)


def _gnss_integrity(_plant: Plant) -> Message:
    return mavlink.MAVLink_gnss_integrity_message(
        4, 0, 0, 0, 0, 0, 65535, 65535, 255, 255, 255, 255
    )


# ---------------------------------------------------------------- the link, the law, the time


def _link_node(plant: Plant) -> Message:
    return ExtraMessage(
        LINK_NODE_STATUS,
        timestamp=_ms(plant),
        tx_rate=24000,
        rx_rate=0,
        messages_sent=0,
        messages_received=0,
        messages_lost=0,
        rx_parse_err=0,
        tx_overflows=0,
        rx_overflows=0,
        tx_buf=127,
        rx_buf=1,
    )


def _drone_id_location(plant: Plant) -> Message:
    pilot = plant.autopilot
    lat, lon, amsl = geodetic_from_ned(pilot.estimated_position_ned_m, pilot.origin)
    north, east, down = pilot.estimated_velocity_ned_m_s
    return mavlink.MAVLink_open_drone_id_location_message(
        *(0, 0, [0] * 20),
        2 if pilot.airborne else 1,
        round(100.0 * math.degrees(math.atan2(east, north))) % 36000,
        round(100.0 * math.hypot(north, east)),
        round(-100.0 * down),
        *(round(lat * 1e7), round(lon * 1e7), amsl, amsl),
        0,
        pilot.home_ned_m[2] - pilot.estimated_position_ned_m[2],
        *(12, 5, 0, 3, 65535.0, 0),
    )


def _drone_id_system(plant: Plant) -> Message:
    pilot = plant.autopilot
    lat, lon, amsl = geodetic_from_ned(pilot.home_ned_m, pilot.origin)
    return mavlink.MAVLink_open_drone_id_system_message(
        *(0, 0, [0] * 20),
        *(0, 0, round(lat * 1e7), round(lon * 1e7)),
        *(1, 0, -1000.0, -1000.0, 0, 0, amsl, 0),
    )


def _time_estimate(_plant: Plant) -> Message:
    return ExtraMessage(
        TIME_ESTIMATE_TO_TARGET,
        safe_return=0,
        land=-1,
        mission_next_item=-1,
        mission_end=-1,
        commanded_action=-1,
    )


HOUSEKEEPING: tuple[tuple[int, float, Builder], ...] = (
    (mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET, 10.0, _attitude_target),
    (mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, 10.0, _local_target),
    (mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, 10.0, _global_target),
    (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 10.0, _servos),
    (ESC_INFO.message_id, 10.0, _esc_info),
    (ESC_STATUS.message_id, 10.0, _esc_status),
    (mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, 50.0, _imu),
    (mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE, 1.0, _scaled_pressure),
    (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, 1.0, _estimator),
    (ESTIMATOR_SENSOR_FUSION_STATUS.message_id, 1.0, _fusion),
    (mavlink.MAVLINK_MSG_ID_VIBRATION, 0.5, _vibration),
    (mavlink.MAVLINK_MSG_ID_GNSS_INTEGRITY, 1.0, _gnss_integrity),
    (LINK_NODE_STATUS.message_id, 1.0, _link_node),
    (mavlink.MAVLINK_MSG_ID_OPEN_DRONE_ID_LOCATION, 1.0, _drone_id_location),
    (mavlink.MAVLINK_MSG_ID_OPEN_DRONE_ID_SYSTEM, 1.0, _drone_id_system),
    (TIME_ESTIMATE_TO_TARGET.message_id, 0.5, _time_estimate),
    (CURRENT_EVENT_SEQUENCE.message_id, 0.34, _event_sequence),
)
"""(message, rate in Hz, how it is made) of every stream of this module."""


# ---------------------------------------------------------------- on request


def protocol_version(_plant: Plant) -> Message:
    """PROTOCOL_VERSION."""
    return ExtraMessage(
        PROTOCOL_VERSION,
        version=200,
        min_version=100,
        max_version=203,
        spec_version_hash=b"",
        library_version_hash=_LIBRARY_HASH,
    )


def component_metadata(plant: Plant) -> Message:
    """COMPONENT_METADATA: where PX4 keeps its descriptions; the mock has no file there."""
    return ExtraMessage(
        COMPONENT_METADATA, time_boot_ms=_ms(plant), file_crc=_METADATA_CRC, uri=_METADATA_URI
    )


def component_information(plant: Plant) -> Message:
    """COMPONENT_INFORMATION, the older way to say the same."""
    return ExtraMessage(
        COMPONENT_INFORMATION,
        time_boot_ms=_ms(plant),
        general_metadata_file_crc=_METADATA_CRC,
        peripherals_metadata_file_crc=0,
        general_metadata_uri=_METADATA_URI,
        peripherals_metadata_uri=b"",
    )


def flight_information(plant: Plant) -> Message:
    """FLIGHT_INFORMATION."""
    return mavlink.MAVLink_flight_information_message(_ms(plant), 0, 0, plant.autopilot.flights)


# Standard mode, custom mode, properties, name of AVAILABLE_MODES, in the order of their indices.
_AVAILABLE_MODES: tuple[tuple[int, int, int, str], ...] = (
    (0, 0x00010000, 1, "Manual"),
    (4, 0x00020000, 0, ""),
    (1, 0x00030000, 0, ""),
    (6, 0x04040000, 1, ""),
    (0, 0x03040000, 1, "Hold"),
    (5, 0x05040000, 1, ""),
    (0, 0x02030000, 1, "Position Slow"),
    (0, 0x13040000, 1, "Guided Course"),
    (0, 0x000B0000, 1, "Altitude Cruise"),
    (0, 0x00050000, 1, "Acro"),
    (0, 0x14040000, 3, "Descend"),
    (0, 0x000A0000, 3, "Termination"),
    (0, 0x00060000, 1, "Offboard"),
    (0, 0x00070000, 1, "Stabilized"),
    (8, 0x02040000, 1, ""),
    (7, 0x06040000, 1, ""),
    (0, 0x08040000, 1, "Follow Target"),
    (0, 0x09040000, 1, "Precision Landing"),
    (2, 0x01030000, 1, ""),
    (0, 0x0A040000, 1, "VTOL Takeoff"),
    (0, 0x0B040000, 2, "(Mode not available)"),
    (0, 0x0C040000, 2, "(Mode not available)"),
    (0, 0x0D040000, 2, "(Mode not available)"),
    (0, 0x0E040000, 2, "(Mode not available)"),
    (0, 0x0F040000, 2, "(Mode not available)"),
    (0, 0x10040000, 2, "(Mode not available)"),
    (0, 0x11040000, 2, "(Mode not available)"),
    (0, 0x12040000, 2, "(Mode not available)"),
)


def available_modes(wanted: float) -> list[Message]:
    """AVAILABLE_MODES: all with 0, else the one with that index (from 1), or none."""
    count = len(_AVAILABLE_MODES)
    chosen = range(1, count + 1) if wanted == 0 else [int(wanted)]
    return [
        mavlink.MAVLink_available_modes_message(
            count, index, standard, custom, properties, name.encode()
        )
        for index in chosen
        if 1 <= index <= count
        for standard, custom, properties, name in (_AVAILABLE_MODES[index - 1],)
    ]


# ---------------------------------------------------------------- the gimbal manager


class GimbalManager:
    """PX4's gimbal manager asks around for a gimbal whenever LAND or RETURN begins."""

    _FIRST_S = 0.26
    _AGAIN_S = (1.27, 1.79, 2.3)

    def __init__(self, system_id: int) -> None:
        self._system_id = system_id
        self._mode: Mode | None = None
        self._due: list[tuple[float, int, int, tuple[float, ...]]] = []

    def step(self, plant: Plant) -> list[Message]:
        """The COMMAND_LONGs that are due, for its own system, any component."""
        pilot = plant.autopilot
        mode, now_s = (pilot.mode if pilot.armed else None), pilot.now_s
        if mode is not self._mode and mode in (Mode.LAND, Mode.RETURN):
            self._due = self._asked(now_s)
        self._mode = mode
        messages = []
        while self._due and self._due[0][0] <= now_s:
            _, command, confirmation, parameters = self._due.pop(0)
            messages.append(
                mavlink.MAVLink_command_long_message(
                    self._system_id, 0, command, confirmation, *parameters
                )
            )
        return messages

    def _asked(self, now_s: float) -> list[tuple[float, int, int, tuple[float, ...]]]:
        configure = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
        point = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW
        take = (1.0, 1.0, -1.0, -1.0, 0.0, 0.0, 0.0)
        first_s = now_s + self._FIRST_S
        asked: list[tuple[float, int, int, tuple[float, ...]]] = [
            (first_s, configure, 0, take),
            (first_s, point, 0, (math.nan,) * 4 + (2.0, 0.0, 0.0)),
            (first_s, configure, 0, (-3.0, -3.0, -1.0, -1.0, 0.0, 0.0, 0.0)),
        ]
        for confirmation, later_s in enumerate(self._AGAIN_S, start=1):
            asked.append((now_s + later_s, configure, confirmation, take))
        return asked
