"""The bus contract once more, written from its page alone: an independent peer for the simulated vehicle."""

from dataclasses import dataclass

from vehicle_iface.frame import CanFrame

LAYOUT = {
    "DRIVE_COMMAND": (
        0x080,
        {
            "ENABLE": (12, 1, False, 1),
            "SAFE_STOP": (13, 1, False, 1),
            "ACCEL_REQUEST": (16, 16, True, 0.001),
            "SPEED_REQUEST": (32, 16, True, 0.005),
            "REASON": (48, 8, False, 1),
            "GEAR_REQUEST": (56, 3, False, 1),
        },
    ),
    "STEER_COMMAND": (
        0x081,
        {
            "ENABLE": (12, 1, False, 1),
            "FRONT_WHEEL_ANGLE_REQUEST": (16, 16, True, 0.0001),
            "REAR_WHEEL_ANGLE_REQUEST": (32, 16, True, 0.0001),
        },
    ),
    "VEHICLE_STATUS": (
        0x100,
        {
            "GEAR": (12, 3, False, 1),
            "DRIVER_BRAKE": (15, 1, False, 1),
            "MODE": (16, 3, False, 1),
            "DRIVER_THROTTLE": (19, 1, False, 1),
            "DRIVER_STEER_TORQUE": (24, 8, True, 0.1),
            "REAR_WHEEL_ANGLE": (32, 16, True, 0.0001),
            "FAULT_CODE": (48, 8, False, 1),
        },
    ),
    "POSE": (
        0x110,
        {
            "POSE_FRAME": (12, 2, False, 1),
            "POSE_VALID": (14, 1, False, 1),
            "POS_X": (16, 24, True, 0.005),
            "POS_Y": (40, 24, True, 0.005),
        },
    ),
    "MOTION": (
        0x111,
        {
            "HEADING": (16, 16, True, 0.0001),
            "SPEED": (32, 16, True, 0.005),
            "YAW_RATE": (48, 16, True, 0.0002),
        },
    ),
    "CHASSIS": (
        0x112,
        {
            "ACCEL": (16, 16, True, 0.001),
            "LATERAL_SPEED": (32, 16, True, 0.001),
            "FRONT_WHEEL_ANGLE": (48, 16, True, 0.0001),
        },
    ),
}
SAMPLE = ("POSE", "MOTION", "CHASSIS")
MANUAL, READY, AUTONOMOUS, FAULT, EMERGENCY_STOP = range(5)
PARK, REVERSE, NEUTRAL, DRIVE, NO_REQUEST = 0, 1, 2, 3, 7
_NAME_OF = {can_id: name for name, (can_id, _) in LAYOUT.items()}


@dataclass(frozen=True)
class Told:
    """One frame of the vehicle, taken apart."""

    name: str
    counter: int
    is_intact: bool
    signals: dict[str, float]

    def __getitem__(self, signal: str) -> float:
        return self.signals[signal]


def crc8(data: bytes) -> int:
    """Polynomial 0x1D, initial value 0, most significant bit first, one bit at a time."""
    register = 0
    for byte in data:
        for bit in range(7, -1, -1):
            top = (register >> 7) & 1
            register = (register << 1) & 0xFF
            if top ^ ((byte >> bit) & 1):
                register ^= 0x1D
    return register


def checksum(can_id: int, data: bytes) -> int:
    """Over the data id, low byte first, then bytes 1 to 7."""
    return crc8(bytes([can_id & 0xFF, can_id >> 8]) + data[1:8])


def pack(name: str, counter: int, **signals: float) -> CanFrame:
    """A frame as the contract's page describes it; signals that are not named are 0."""
    can_id, layout = LAYOUT[name]
    bits = counter << 8
    for signal, value in signals.items():
        start, length, _, factor = layout[signal]
        bits |= (round(value / factor) & ((1 << length) - 1)) << start
    data = bytes((bits >> (8 * i)) & 0xFF for i in range(8))
    return CanFrame(can_id, bytes([checksum(can_id, data)]) + data[1:])


def unpack(frame: CanFrame) -> Told:
    """The frame's signals, whether or not it is intact."""
    name = _NAME_OF[frame.can_id]
    bits = sum(byte << (8 * i) for i, byte in enumerate(frame.data))
    signals: dict[str, float] = {}
    for signal, (start, length, is_signed, factor) in LAYOUT[name][1].items():
        raw = (bits >> start) & ((1 << length) - 1)
        if is_signed and raw >> (length - 1):
            raw -= 1 << length
        signals[signal] = raw * factor
    is_intact = len(frame.data) == 8 and frame.data[0] == checksum(frame.can_id, frame.data)
    return Told(name, (bits >> 8) & 0xF, is_intact, signals)
