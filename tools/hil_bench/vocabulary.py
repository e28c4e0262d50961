"""The words that cases, faults, expectations and judges share, whatever a DBC calls its signals."""

from enum import StrEnum

SIGNAL_NAMES = {
    "state": {
        "x_m": "POS_X",
        "y_m": "POS_Y",
        "heading_rad": "HEADING",
        "speed_mps": "SPEED",
        "accel_mps2": "ACCEL",
        "yaw_rate_radps": "YAW_RATE",
        "lateral_speed_mps": "LATERAL_SPEED",
        "front_wheel_angle_rad": "FRONT_WHEEL_ANGLE",
        "rear_wheel_angle_rad": "REAR_WHEEL_ANGLE",
        "pose_frame": "POSE_FRAME",
        "pose_valid": "POSE_VALID",
    },
    "status": {
        "mode": "MODE",
        "gear": "GEAR",
        "driver_brake": "DRIVER_BRAKE",
        "driver_throttle": "DRIVER_THROTTLE",
        "driver_steer_torque_nm": "DRIVER_STEER_TORQUE",
        "fault_code": "FAULT_CODE",
    },
    "command": {
        "enable": "ENABLE",
        "safe_stop": "SAFE_STOP",
        "accel_mps2": "ACCEL_REQUEST",
        "speed_mps": "SPEED_REQUEST",
        "front_wheel_angle_rad": "FRONT_WHEEL_ANGLE_REQUEST",
        "rear_wheel_angle_rad": "REAR_WHEEL_ANGLE_REQUEST",
        "reason": "REASON",
        "gear_request": "GEAR_REQUEST",
    },
    "body": {"hazard_lights": "HAZARD_LIGHTS"},
    "report": {
        "state": "STATE",
        "reason": "REASON",
        "ref_spatial_index": "REF_SPATIAL_INDEX",
        "ref_temporal_index": "REF_TEMPORAL_INDEX",
        "deadline_misses": "DEADLINE_MISSES",
    },
}
"""Table `[PART.signals]` of a profile: key → the reference vehicle's name of the signal."""

PERIOD_S = 0.010
"""Of the reference vehicle's samples."""


class Wait(StrEnum):
    """What a device must wait for before it can react."""

    NOTHING = "nothing"
    STATE = "a sample, or its absence"
    STATUS = "the vehicle's status"
    STATUS_LOST = "the absence of the vehicle's status"
    SILENCE = "the time after which it falls silent"
