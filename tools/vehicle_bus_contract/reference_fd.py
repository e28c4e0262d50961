"""The reference vehicle's layout on CAN FD, from the table in `dbc/README.md`."""

from vehicle_bus_contract.reference import Contract, Messages

_COUNTER = {"COUNTER": (16, 8, False, 1.0)}
LAYOUT: Messages = {
    "COMMAND": (
        0x080,
        16,
        _COUNTER
        | {
            "ENABLE": (24, 1, False, 1.0),
            "SAFE_STOP": (25, 1, False, 1.0),
            "GEAR_REQUEST": (26, 3, False, 1.0),
            "REASON": (32, 8, False, 1.0),
            "ACCEL_REQUEST": (48, 16, True, 0.001),
            "SPEED_REQUEST": (64, 16, True, 0.005),
            "FRONT_WHEEL_ANGLE_REQUEST": (80, 16, True, 0.0001),
            "REAR_WHEEL_ANGLE_REQUEST": (96, 16, True, 0.0001),
        },
    ),
    "BODY_COMMAND": (
        0x082,
        8,
        _COUNTER
        | {
            "HAZARD_LIGHTS": (24, 1, False, 1.0),
            "HEADLIGHTS": (32, 2, False, 1.0),
            "TURN_INDICATOR": (34, 2, False, 1.0),
            "HORN": (36, 1, False, 1.0),
        },
    ),
    "VEHICLE_STATUS": (
        0x100,
        12,
        _COUNTER
        | {
            "GEAR": (24, 3, False, 1.0),
            "DRIVER_BRAKE": (27, 1, False, 1.0),
            "DRIVER_THROTTLE": (28, 1, False, 1.0),
            "MODE": (32, 3, False, 1.0),
            "FAULT_CODE": (40, 8, False, 1.0),
            "DRIVER_STEER_TORQUE": (48, 16, True, 0.01),
        },
    ),
    "STATE": (
        0x110,
        32,
        _COUNTER
        | {
            "POSE_FRAME": (24, 2, False, 1.0),
            "POSE_VALID": (26, 1, False, 1.0),
            "POS_X": (32, 32, True, 0.005),
            "POS_Y": (64, 32, True, 0.005),
            "HEADING": (96, 16, True, 0.0001),
            "SPEED": (112, 16, True, 0.005),
            "YAW_RATE": (128, 16, True, 0.0002),
            "ACCEL": (144, 16, True, 0.001),
            "LATERAL_SPEED": (160, 16, True, 0.001),
            "FRONT_WHEEL_ANGLE": (176, 16, True, 0.0001),
            "REAR_WHEEL_ANGLE": (192, 16, True, 0.0001),
        },
    ),
    "CONTROLLER_STATUS": (
        0x180,
        12,
        _COUNTER
        | {
            "STATE": (24, 4, False, 1.0),
            "REASON": (32, 8, False, 1.0),
            "DEADLINE_MISSES": (40, 8, False, 1.0),
            "REF_SPATIAL_INDEX": (48, 16, False, 1.0),
            "REF_TEMPORAL_INDEX": (64, 16, False, 1.0),
        },
    ),
}


def _shifted_out(register: int) -> int:
    """Eight bits of long division by the polynomial 0x1021."""
    for _ in range(8):
        register = (register << 1) ^ 0x11021 if register & 0x8000 else register << 1
    return register


_TABLE = tuple(_shifted_out(byte << 8) for byte in range(256))


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, initial value 0xFFFF, most significant bit first."""
    register = 0xFFFF
    for byte in data:
        register = (register << 8) & 0xFF00 ^ _TABLE[register >> 8 ^ byte]
    return register


def checksum(can_id: int, data: bytes) -> int:
    """Over everything after the checksum, then the data id, low byte first."""
    return crc16(data[2:] + bytes((can_id & 0xFF, can_id >> 8)))


REFERENCE_FD = Contract(
    messages=LAYOUT,
    is_fd=True,
    crc_bytes=2,
    checksum=checksum,
    counters=256,
    sample=("STATE",),
    command=("COMMAND",),
)
NAMES, COUNTERS = REFERENCE_FD.names, REFERENCE_FD.counters
pack, intact = REFERENCE_FD.pack, REFERENCE_FD.intact
