"""PX4's own health report in words: its sensor bits, and the events of its arming checks. Pure.

PX4 tells in EVENT (410) which check failed and which modes that forbids; ground stations look the
words up in metadata of the exact build. Here is a small table of the checks of a multicopter, by
their names; an event's id is the component over 24 bits of its name's FNV-1a hash (verified with
ids measured on PX4 main bb59c637cd, 2026-11). Sources: PX4's src/modules/commander/
HealthAndArmingChecks/checks of 1.15.4, 1.18.0-rc1 and main, 2026.
"""

import struct
from collections.abc import Iterable

import msgspec

_COMPONENT = 1
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193
_ERROR = 3  # log levels up to this forbid arming; 4 warns, 5 to 7 only tell

NAV_STATES = {"manual": 0, "mission": 3, "hold": 4, "return": 5, "offboard": 14, "takeoff": 17}
"""PX4's navigation states by this project's names for modes; LAND prevents arming anyway."""

CHECKS: dict[str, str] = {
    "check_modes_global_pos": "no valid global position, which the selected mode needs (Hold, "
    "Return and Mission do, Takeoff does not)",
    "check_modes_local_pos": "no valid local position: no position source is good enough",
    "check_modes_local_alt": "no valid height estimate",
    "check_modes_attitude": "no valid attitude: wait until the estimator has begun, keep it still",
    "check_modes_angular_velocity": "no valid rates: check the gyroscope",
    "check_modes_offboard_signal_lost": "Offboard is selected and no setpoints come",
    "check_modes_manual_control": "the selected mode needs a transmitter, and none is heard",
    "check_modes_cannot_takeoff": "the selected mode is none to take off in: select another",
    "check_modes_mission": "the selected mode needs a mission: select another",
    "check_modes_home_position": "no home position, which the selected mode needs",
    "check_estimator_missing_data": "the estimator has not begun yet",
    "check_estimator_heading_no_source": "no heading: calibrate the compass, or give a heading by "
    "vision",
    "check_estimator_heading_not_stable": "the heading is not plausible: calibrate the compass "
    "away from steel",
    "check_estimator_hor_vel_not_stable": "the horizontal velocity is unsteady: keep the vehicle "
    "still",
    "check_estimator_vert_vel_not_stable": "the vertical velocity is unsteady: keep the vehicle "
    "still",
    "check_estimator_hor_pos_not_stable": "the horizontal position is unsteady: check its source",
    "check_estimator_hgt_not_stable": "the height is unsteady: check its source (EKF2_HGT_REF)",
    "check_estimator_mag_interference": "strong magnetic interference: move away from steel and "
    "currents (COM_ARM_MAG_STR)",
    "check_estimator_mag_fault": "the estimator has stopped using the compass: calibrate it",
    "check_estimator_gps_fix_too_low": "no GNSS fix (indoors without GNSS: SYS_HAS_GPS 0)",
    "check_estimator_gps_num_sats_too_low": "too few GNSS satellites",
    "check_estimator_gps_hor_pos_err_too_high": "GNSS is too inaccurate",
    "check_estimator_gps_not_fusing": "the estimator does not use GNSS",
    "check_estimator_high_accel_bias": "the accelerometer is off: calibrate it",
    "check_estimator_high_gyro_bias": "the gyroscope is off: calibrate it",
    "check_system_no_global_pos": "a global position is required (COM_ARM_WO_GPS 0)",
    "check_system_no_home_pos": "a home position is required (COM_ARM_WO_GPS 0)",
    "check_system_usb_connected": "USB is connected: pull it",
    "check_system_safety_button": "the safety button has not been pressed",
    "check_system_flight_term_active": "flight was terminated: restart the vehicle",
    "check_rc_dl_no_dllink": "no ground station is heard (NAV_DLL_ACT)",
    "check_battery_low": "the battery is low",
    "check_battery_critical": "the battery is critical",
    "check_battery_emergency": "the battery is empty",
    "check_battery_unhealthy": "the battery is not heard of, or reports a fault",
    "check_battery_missing": "a required battery is missing",
    "check_avionics_power_missing": "no power module is connected (CBRK_SUPPLY_CHK)",
    "check_avionics_power_low": "the supply of the autopilot is below 4.8 V",
    "check_avionics_power_high": "the supply of the autopilot is above 5.4 V",
    "check_missing_system_power": "the autopilot's supply is not measured (CBRK_SUPPLY_CHK)",
    "check_mag_missing": "a compass is missing",
    "check_mag_no_data": "a compass sends nothing",
    "check_mag_not_calibrated": "a compass is not calibrated",
    "check_mag_consistency": "the compasses disagree: check how they are mounted, calibrate",
    "check_mag_sys_has_mag_missing": "fewer compasses than SYS_HAS_MAG asks for",
    "check_mag_fault": "the estimator finds a compass at fault: calibrate it",
    "check_gyro_missing": "a gyroscope is missing",
    "check_gyro_no_data": "a gyroscope sends nothing",
    "check_gyro_not_calibrated": "a gyroscope is not calibrated",
    "check_baro_missing": "a barometer is missing (SYS_HAS_BARO)",
    "check_baro_no_data": "a barometer sends nothing",
    "check_imu_accel_inconsistent": "the accelerometers disagree: calibrate them",
    "check_imu_gyro_inconsistent": "the gyroscopes disagree: calibrate them",
    "check_optical_flow_sensor_invalid": "the optical flow sensor sends nothing usable",
    "check_optical_sensor_missing": "the optical flow sensor is missing (SYS_HAS_NUM_OF)",
    "check_distance_sensor_missing": "a range sensor of the autopilot is missing "
    "(SYS_HAS_NUM_DIST)",
    "check_distance_sensor_invalid": "a range sensor of the autopilot measures nothing",
    "check_cpuload_too_high": "the autopilot's processor is overloaded",
    "check_ram_usage_too_high": "the autopilot's memory is full",
    "check_missing_fmu_sdcard": "the autopilot has no memory card",
    "check_hardfault_present": "the autopilot crashed before: read its crash log",
    "check_man_control_kill_engaged": "the kill switch of the transmitter is engaged",
    "check_man_control_rtl_engaged": "the return switch of the transmitter is engaged",
    "check_escs_offline": "a motor controller does not answer",
    "check_escs_fault": "a motor controller reports a fault",
    "check_failure_detector_motor": "a motor is found to have failed",
    "check_failure_detector_roll": "it rolled beyond the failure detector's limit",
    "check_failure_detector_pitch": "it pitched beyond the failure detector's limit",
    "check_gf_violation_custom_gf": "it is outside PX4's own fence",
    "check_gf_violation_max_alt": "it is above PX4's own height limit (GF_MAX_VER_DIST)",
    "check_gf_violation_max_hor_dist": "it is beyond PX4's own radius (GF_MAX_HOR_DIST)",
    "check_gf_no_home": "PX4's own fence needs a home position, which there is none of",
    "check_modes_offboard_signal": "Offboard is selected and no setpoints come",
    "check_estimator_pos_est_err": "the position is too uncertain",
    "check_estimator_vel_est_err": "the velocity is too uncertain",
    "check_estimator_hgt_est_err": "the height is too uncertain",
    "check_estimator_yaw_est_err": "the heading is too uncertain",
    "check_battery_preflight_low": "the battery is too low to take off",
    "check_battery_fault": "the battery reports a fault",
    "check_open_drone_id_missing": "no remote identification is heard (COM_ARM_ODID)",
    "check_system_arm_auth_failed": "arming was not authorized (COM_ARM_AUTH_REQ)",
    "check_accel_missing": "an accelerometer is missing",
    "check_accel_no_data": "an accelerometer sends nothing",
    "check_accel_not_calibrated": "an accelerometer is not calibrated",
}

_SENSORS = {
    0x0000_0001: "gyroscope",
    0x0000_0002: "accelerometer",
    0x0000_0004: "compass",
    0x0000_0008: "barometer",
    0x0000_0020: "GNSS receiver",
    0x0000_0040: "optical flow",
    0x0000_0080: "vision position",
    0x0000_8000: "motor outputs",
    0x0001_0000: "transmitter",
    0x0200_0000: "battery",
}
"""MAV_SYS_STATUS_SENSOR, as far as PX4 fills it."""


def event_id(name: str) -> int:
    """The number of PX4's event of that name."""
    value = _FNV_OFFSET
    for letter in name.encode():
        value = ((value ^ letter) * _FNV_PRIME) & 0xFFFFFFFF
    return _COMPONENT << 24 | value & 0xFFFFFF


_WORDS = {event_id(name): words for name, words in CHECKS.items()}


class Event(msgspec.Struct, frozen=True):
    """EVENT (410). `log_levels`: internal in the upper four bits, external in the lower."""

    id: int
    log_levels: int
    arguments: tuple[int, ...] = ()

    @property
    def level(self) -> int:
        """MAV_SEVERITY for people."""
        return self.log_levels & 0x0F

    def forbids(self, mode: str) -> bool:
        """True for a failed check that keeps the vehicle from arming in `mode`."""
        if self.id not in _WORDS or self.level > _ERROR or len(self.arguments) < 4:
            return False
        (modes,) = struct.unpack("<I", bytes(self.arguments[:4]))
        state = NAV_STATES.get(mode)
        return state is None or bool(modes >> state & 1)


class SensorReport(msgspec.Struct, frozen=True):
    """SYS_STATUS: which sensors there are, which are used, and which are well."""

    onboard_control_sensors_present: int
    onboard_control_sensors_enabled: int
    onboard_control_sensors_health: int


def failed_checks(events: Iterable[Event], mode: str) -> tuple[str, ...]:
    """What keeps the vehicle from arming in `mode`, in words, without repeating any."""
    words = (_WORDS[event.id] for event in events if event.forbids(mode))
    return tuple(dict.fromkeys(words))


def unwell(report: SensorReport) -> tuple[str, ...]:
    """The sensors that are present and used, and that PX4 does not find well."""
    bits = (
        report.onboard_control_sensors_present
        & report.onboard_control_sensors_enabled
        & ~report.onboard_control_sensors_health
    )
    return tuple(name for bit, name in _SENSORS.items() if bits & bit)
