"""Layout of a telemetry file. The header has its fingerprint, so that both sides can check that they agree."""

import struct
import sys
import zlib

import msgspec

from vehicle_iface import checks
from vehicle_iface.telemetry.snapshot import MAX_POINTS, RING_LENGTH, Snapshot


def compute_fingerprint() -> bytes:
    """Return a fingerprint of everything that both sides must agree on."""
    words = (
        sys.byteorder,
        RING_LENGTH,
        MAX_POINTS,
        JSON_BYTES,
        EVENT_SLOTS,
        EVENT_BYTES,
        *Snapshot.__annotations__.items(),
        CODES,
    )
    text = repr(words).encode()
    return struct.pack("=II", zlib.crc32(text), zlib.adler32(text))  # hashlib would bring OpenSSL: 3.5 MB


MAGIC = b"VEHIFTLM"
VERSION = 1
FRAME_BYTES = checks.FRAME_ID_BYTES
JSON_BYTES = 32768
EVENT_SLOTS = 256
"""Events kept for readers."""
EVENT_BYTES = 512
"""Room for one event, its JSON and what surrounds it; a longer text is shortened."""
COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps", "time_s")
CODES = {"int": "q", "float": "d", "bool": "?", "str": f"{FRAME_BYTES}s"}
FIELDS = tuple(CODES[str(getattr(a, "__forward_arg__", a))] for a in Snapshot.__annotations__.values())
CRC = struct.Struct("=I")
# Native alignment: both sides are on the same machine.
RECORD = struct.Struct("@" + "".join(FIELDS))
SLOT_BYTES = -(-(RECORD.size + CRC.size) // 64) * 64
HEADER = struct.Struct("@8sQ8sQQqQ")  # magic, version, layout, session, pid, start_ns, length of the info
TRAJECTORY = struct.Struct(f"@qqqq{FRAME_BYTES}s")  # version, stamp_ns, points here, points of the original, frame
TRAJECTORY_BYTES = TRAJECTORY.size + MAX_POINTS * len(COLUMNS) * 8
DETAILS = struct.Struct("@QQ")  # number, length
EVENT = struct.Struct("@QQ")  # number, length

HEAD_AT = 4096 - 64
ENDED_AT = 4096 - 8
INFO_AT = 4096
RING_AT = INFO_AT + JSON_BYTES
TRAJECTORY_AT = RING_AT + RING_LENGTH * SLOT_BYTES
TRAJECTORY_STRIDE = -(-(TRAJECTORY_BYTES + CRC.size) // 64) * 64
DETAILS_AT = TRAJECTORY_AT + 2 * TRAJECTORY_STRIDE
DETAILS_STRIDE = DETAILS.size + JSON_BYTES + 64
EVENTS_AT = -(-(DETAILS_AT + 2 * DETAILS_STRIDE) // 64) * 64
FILE_BYTES = -(-(EVENTS_AT + EVENT_SLOTS * EVENT_BYTES) // 4096) * 4096
LAYOUT = compute_fingerprint()

BAD_JSON = (msgspec.MsgspecError, ValueError, RecursionError)
"""Exceptions that decoding JSON may raise."""
