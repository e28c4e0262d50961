"""A telemetry file with bytes changed, and checksums that fit them again where the input says so."""

import struct
import zlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from fuzzing.engine.input_bytes import Bytes, scratch
from vehicle_iface import Trajectory
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter, layout
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails

_CRC = struct.Struct("=I")
_MOST_CHANGES = 16


@cache
def _good() -> bytes:
    path = scratch() / "good"
    path.unlink(missing_ok=True)
    with TelemetryWriter(str(path), SessionInfo(channel="vcan0", bus="SocketCAN vcan0", profile="reference")) as writer:
        number = np.arange(5, dtype=np.float64)
        trajectory = Trajectory(
            stamp_ns=7,
            time_from_start_ns=np.arange(5),
            x_m=number,
            y_m=number,
            heading_rad=number,
            speed_mps=number,
        )
        version = writer.publish_trajectory(trajectory)
        writer.publish_details(LiveDetails(link=LinkDetails(state="UP"), drops={"bad CRC POSE": 3}))
        for at in range(1, 4):
            writer.publish(
                Snapshot(
                    published_ns=at * 10**7,
                    controller_state=3,
                    reason=0,
                    has_state=True,
                    stamp_ns=at * 10**7,
                    has_status=True,
                    trajectory_version=version,
                    has_reference=True,
                    has_lookahead=True,
                    has_requested=True,
                    sent=True,
                )
            )
    return path.read_bytes()


def tampered(data: bytes) -> Path:
    """First byte 0: the rest is the file. Otherwise changes: place, offset, what, and whether its checksum fits."""
    path, change = scratch() / "telemetry", Bytes(data)
    if change.number() == 0:
        path.write_bytes(change.rest())
        return path
    content = bytearray(_good())
    for _ in range(_MOST_CHANGES):
        if not change:
            break
        kind = change.number()
        begin, size = _places()[kind % len(_places())]
        at, new = begin + change.number(2) % size, change.take(change.number() % 64)
        content[at : at + len(new)] = new
        if kind & 0x80:
            _seal(content, begin, size)
    path.write_bytes(content[: len(_good()) - (change.number(2) if change else 0)])
    return path


@cache
def _places() -> list[tuple[int, int]]:
    """Begin and size of each part that a checksum follows; then those without one."""
    slots = [(layout.RING_AT + k * layout.SLOT_BYTES, layout.RECORD.size) for k in (1, 2, 3, 4)]
    drawn = [(layout.TRAJECTORY_AT + k * layout.TRAJECTORY_STRIDE, layout.TRAJECTORY_BYTES) for k in (0, 1)]
    told = [(layout.DETAILS_AT + k * layout.DETAILS_STRIDE, layout.DETAILS.size) for k in (0, 1)]
    return [*slots, *drawn, *told, (0, layout.HEADER.size), (layout.HEAD_AT, 64)]


def _seal(content: bytearray, begin: int, size: int) -> None:
    if begin == layout.HEAD_AT:
        return
    end = begin + size
    checksum = zlib.crc32(content[begin:end])
    if begin == 0:
        length = min(layout.HEADER.unpack_from(content)[-1], layout.JSON_BYTES)
        checksum = zlib.crc32(content[layout.INFO_AT : layout.INFO_AT + length], checksum)
    elif begin >= layout.DETAILS_AT:
        end += min(layout.DETAILS.unpack_from(content, begin)[1], layout.JSON_BYTES)
        checksum = zlib.crc32(content[begin:end])
    content[end : end + _CRC.size] = _CRC.pack(checksum)


def seeds() -> Iterator[bytes]:
    yield b"\0"
    yield b"\0" + _good()[:200]
    yield b"\x01"
    for kind in range(len(_places())):
        yield bytes([1, kind, 0, 0, 4, 1, 2, 3, 4])
        yield bytes([1, kind | 0x80, 8, 0, 8]) + struct.pack("<d", float("nan"))
        yield bytes([1, kind | 0x80, 16, 0, 8]) + b"<b>&\"'\0\xff"
