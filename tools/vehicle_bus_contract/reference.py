"""Frames, signals and checksums of a bus, and the reference vehicle's layout on classical CAN."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

Layout = Mapping[str, tuple[int, int, bool, float]]
"""Signal → start bit, length, whether it is signed, factor."""
Messages = Mapping[str, tuple[int, int, Layout]]
"""Message → identifier, bytes, signals."""

MANUAL, READY, AUTONOMOUS, FAULT, EMERGENCY_STOP = range(5)
PARK, REVERSE, NEUTRAL, DRIVE, NO_REQUEST = 0, 1, 2, 3, 7
ODOM, MAP = 0, 1
STARTING, STANDBY, ENGAGING, ENGAGED, STOPPING, FAULTED, SHADOW = range(7)
REASONS = (
    "NOMINAL",
    "NO_TRAJECTORY",
    "EMPTY_TRAJECTORY",
    "PAST_END_SPACE",
    "PAST_END_TIME",
    "FRAME_MISMATCH",
    "STATE_STALE",
    "STATE_INVALID",
    "CONTROLLER_ERROR",
    "DEVIATION",
    "DRIVER_OVERRIDE",
    "VEHICLE_NOT_AUTONOMOUS",
    "VEHICLE_FAULT",
    "LINK_DOWN",
    "DUPLICATE_COMMANDER",
    "SHUTDOWN",
    "DEADLINE_MISSED",
    "NOT_ENGAGED",
)

GREATEST_STEP = 3
MS = 1_000_000
S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame as it was on the bus."""

    stamp_ns: int
    can_id: int
    data: bytes
    is_extended: bool = False
    is_remote: bool = False
    is_fd: bool = False
    is_error: bool = False
    bus: int = 0
    """Of a vehicle on several buses, which of them."""


@dataclass(frozen=True, slots=True)
class DecodedFrame:
    """The signals of one intact frame."""

    stamp_ns: int
    name: str
    signals: Mapping[str, float]

    def __getitem__(self, signal: str) -> float:
        return self.signals[signal]

    @property
    def counter(self) -> int:
        """Of the end-to-end protection."""
        return int(self.signals["COUNTER"])

    @property
    def reason(self) -> str:
        """REASON in words."""
        number = int(self.signals["REASON"])
        return REASONS[number] if number < len(REASONS) else f"REASON {number}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What may be commanded to a vehicle."""

    steer_rad: float = 0.6
    """To either side."""
    steer_rate_radps: float = 0.8
    accel_range_mps2: tuple[float, float] = (-6.0, 3.0)
    """Driving forward; the other way round in reverse."""
    gear_change_mps: float = 0.5


@dataclass(frozen=True)
class Contract:
    """One layout of the bus."""

    messages: Messages
    is_fd: bool
    crc_bytes: int
    """At the beginning of every payload, low byte first."""
    checksum: Callable[[int, bytes], int]
    """Of an identifier and a payload."""
    counters: int
    """0 follows the greatest one, which is one less."""
    sample: tuple[str, ...]
    """The messages that are one state sample, with one counter."""
    command: tuple[str, ...]
    """The messages that are one command, the one with the acceleration first."""
    limits: Limits = Limits()

    @cached_property
    def names(self) -> Mapping[int, str]:
        """Messages by their identifier."""
        return {can_id: name for name, (can_id, _, _) in self.messages.items()}

    def pack(self, name: str, counter: int, **signals: float) -> tuple[int, bytes]:
        """Identifier and payload of a message; signals that are not named are 0."""
        can_id, size, layout = self.messages[name]
        bits = 0
        for signal, value in ({"COUNTER": counter} | signals).items():
            start, length, _, factor = layout[signal]
            bits |= (round(value / factor) & ((1 << length) - 1)) << start
        data = bits.to_bytes(size, "little")
        return can_id, self._check(can_id, data) + data[self.crc_bytes :]

    def unpack(self, stamp_ns: int, name: str, data: bytes) -> DecodedFrame:
        """The signals of a payload of the right length, intact or not."""
        bits = int.from_bytes(data, "little")
        signals = {}
        for signal, (start, length, is_signed, factor) in self.messages[name][2].items():
            raw = bits >> start & (1 << length) - 1
            if is_signed and raw >> length - 1:
                raw -= 1 << length
            signals[signal] = raw * factor
        return DecodedFrame(stamp_ns, name, signals)

    def is_well_formed(self, frame: Frame) -> bool:
        """Whether a frame that carries an identifier of the contract is of its kind and length."""
        special = frame.is_extended or frame.is_remote or frame.is_error or frame.is_fd is not self.is_fd
        return not special and len(frame.data) == self.messages[self.names[frame.can_id]][1]

    def intact(self, frame: Frame) -> DecodedFrame | None:
        """The frame's content, if it is one of the contract's messages and whole."""
        name = self.names.get(frame.can_id)
        if name is None or not self.is_well_formed(frame):
            return None
        if not frame.data.startswith(self._check(frame.can_id, frame.data)):
            return None
        return self.unpack(frame.stamp_ns, name, frame.data)

    def _check(self, can_id: int, data: bytes) -> bytes:
        return self.checksum(can_id, data).to_bytes(self.crc_bytes, "little")


_COUNTER = {"COUNTER": (8, 4, False, 1.0)}
LAYOUT: Messages = {
    "DRIVE_COMMAND": (
        0x080,
        8,
        _COUNTER
        | {
            "ENABLE": (12, 1, False, 1.0),
            "SAFE_STOP": (13, 1, False, 1.0),
            "ACCEL_REQUEST": (16, 16, True, 0.001),
            "SPEED_REQUEST": (32, 16, True, 0.005),
            "REASON": (48, 8, False, 1.0),
            "GEAR_REQUEST": (56, 3, False, 1.0),
        },
    ),
    "STEER_COMMAND": (
        0x081,
        8,
        _COUNTER
        | {
            "ENABLE": (12, 1, False, 1.0),
            "FRONT_WHEEL_ANGLE_REQUEST": (16, 16, True, 0.0001),
            "REAR_WHEEL_ANGLE_REQUEST": (32, 16, True, 0.0001),
        },
    ),
    "BODY_COMMAND": (
        0x082,
        8,
        _COUNTER
        | {
            "HAZARD_LIGHTS": (12, 1, False, 1.0),
            "HEADLIGHTS": (16, 2, False, 1.0),
            "TURN_INDICATOR": (18, 2, False, 1.0),
            "HORN": (20, 1, False, 1.0),
        },
    ),
    "VEHICLE_STATUS": (
        0x100,
        8,
        _COUNTER
        | {
            "GEAR": (12, 3, False, 1.0),
            "DRIVER_BRAKE": (15, 1, False, 1.0),
            "MODE": (16, 3, False, 1.0),
            "DRIVER_THROTTLE": (19, 1, False, 1.0),
            "DRIVER_STEER_TORQUE": (24, 8, True, 0.1),
            "REAR_WHEEL_ANGLE": (32, 16, True, 0.0001),
            "FAULT_CODE": (48, 8, False, 1.0),
        },
    ),
    "POSE": (
        0x110,
        8,
        _COUNTER
        | {
            "POSE_FRAME": (12, 2, False, 1.0),
            "POSE_VALID": (14, 1, False, 1.0),
            "POS_X": (16, 24, True, 0.005),
            "POS_Y": (40, 24, True, 0.005),
        },
    ),
    "MOTION": (
        0x111,
        8,
        _COUNTER
        | {
            "HEADING": (16, 16, True, 0.0001),
            "SPEED": (32, 16, True, 0.005),
            "YAW_RATE": (48, 16, True, 0.0002),
        },
    ),
    "CHASSIS": (
        0x112,
        8,
        _COUNTER
        | {
            "ACCEL": (16, 16, True, 0.001),
            "LATERAL_SPEED": (32, 16, True, 0.001),
            "FRONT_WHEEL_ANGLE": (48, 16, True, 0.0001),
        },
    ),
    "CONTROLLER_STATUS": (
        0x180,
        8,
        _COUNTER
        | {
            "STATE": (12, 4, False, 1.0),
            "REASON": (16, 8, False, 1.0),
            "REF_SPATIAL_INDEX": (24, 16, False, 1.0),
            "REF_TEMPORAL_INDEX": (40, 16, False, 1.0),
            "DEADLINE_MISSES": (56, 8, False, 1.0),
        },
    ),
}


def _divide(rest: int) -> int:
    """The remainder of a byte: long division by the polynomial, one bit at a time."""
    for _ in range(8):
        rest = (rest << 1) ^ 0x11D if rest & 0x80 else rest << 1
    return rest


_REMAINDERS = bytes(_divide(byte) for byte in range(256))


def crc8(data: bytes) -> int:
    """Polynomial 0x1D, initial value 0, no final XOR."""
    rest = 0
    for byte in data:
        rest = _REMAINDERS[rest ^ byte]
    return rest


def checksum(can_id: int, data: bytes) -> int:
    """Over the data id, low byte first, then bytes 1 to 7."""
    return crc8(bytes((can_id & 0xFF, can_id >> 8)) + data[1:8])


REFERENCE = Contract(
    messages=LAYOUT,
    is_fd=False,
    crc_bytes=1,
    checksum=checksum,
    counters=15,
    sample=("POSE", "MOTION", "CHASSIS"),
    command=("DRIVE_COMMAND", "STEER_COMMAND"),
)
NAMES, COUNTERS, SAMPLE, PAIR = REFERENCE.names, REFERENCE.counters, REFERENCE.sample, REFERENCE.command
CONTROLLER_SENDS = (*PAIR, "BODY_COMMAND", "CONTROLLER_STATUS")
pack, intact = REFERENCE.pack, REFERENCE.intact
