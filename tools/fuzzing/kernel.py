"""Records of the kernel: frames of a raw socket, error frames, and how long each is on the wire.

Law: each is a frame, its events are `ControllerEvent`s, and its length is one that a frame can have.
"""

from collections.abc import Iterator

from fuzzing.engine.input_bytes import Bytes
from vehicle_iface.bus.controller_events import ControllerEvent, parse_error_frame
from vehicle_iface.bus.frame_bits import wire_bits
from vehicle_iface.bus.raw_socket import pack_frame, unpack_frame

LENGTH = 80
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


def run(data: bytes) -> None:
    record = Bytes(data)
    word, is_fd = record.number(4), bool(record.number() & 1)
    payload = record.take(record.number() % (65 if is_fd else 9))
    frame = unpack_frame((word, payload, is_fd, 0, 0, False), stamp_ns=1)
    assert frame.data == payload
    assert 0 <= frame.can_id <= (0x1FFFFFFF if frame.is_extended else 0x7FF)
    assert all(isinstance(event, ControllerEvent) for event in parse_error_frame(frame.can_id, frame.data))
    if frame.is_error:
        return
    assert len(pack_frame(frame)) == (72 if frame.is_fd else 16)
    nominal, fast = wire_bits(frame)
    bits = 8 * (0 if frame.is_remote and not is_fd else len(payload))
    if is_fd:
        most = 8 * next(room for room in _FD_LENGTHS if room >= len(payload))
        assert 28 <= nominal <= 64
        assert 22 + bits <= fast <= 60 + 1.25 * most
    else:
        assert fast == 0
        assert 47 + bits <= nominal <= 68 + 1.25 * (54 + bits)


def seeds() -> Iterator[bytes]:
    for word in (0x110, 0x80000110, 0x40000110, 0x20000040, 0x20000004, 0x9FFFFFFF):
        yield word.to_bytes(4, "little") + b"\0\x08" + bytes(range(8))
        yield word.to_bytes(4, "little") + b"\x01\x40" + bytes(64)
