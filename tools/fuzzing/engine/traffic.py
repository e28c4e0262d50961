"""Inputs as traffic: frames that are damaged, and frames that are intact but say what they like."""

from fuzzing.engine.input_bytes import Bytes
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase
from vehicle_iface.frame import CanFrame

_STEP_NS = 250_000


class Traffic:
    """Makes one frame after the other from an input; counters and checksums fit unless the input says otherwise."""

    def __init__(self, database: VehicleDatabase, source: Bytes) -> None:
        self._messages = (*database.received, *database.sent)
        self._source = source
        self._counters = [0] * len(self._messages)

    def next_frame(self, now_ns: int) -> CanFrame:
        """Its stamp is up to 32 ms before `now_ns`."""
        kind, source = self._source.number(), self._source
        stamp_ns = now_ns - (source.number() >> 1) * _STEP_NS if kind & 0x80 else now_ns
        if kind & 0x70 == 0x70:
            return self._any_frame(stamp_ns)
        index = kind % 0x10 % len(self._messages)
        message = self._messages[index]
        payload = bytearray(source.take(message.length))
        if kind & 0x40 == 0 or kind & 0x20 == 0:
            self._seal(index, payload, skip=source.number() % 16 if kind & 0x40 else 0)
        return _framed(message, bytes(payload), stamp_ns, flags=source.number() if kind & 0x60 == 0x20 else 0)

    def _any_frame(self, stamp_ns: int) -> CanFrame:
        word, flags = self._source.number(4), self._source.number()
        is_extended, is_fd = bool(flags & 1), bool(flags & 2)
        can_id = word & (0x1FFFFFFF if is_extended else 0x7FF)
        data = self._source.take(self._source.number() % (65 if is_fd else 9))
        return CanFrame(can_id, data, stamp_ns, is_extended, bool(flags & 4), is_fd, bool(flags & 8))

    def _seal(self, index: int, payload: bytearray, *, skip: int) -> None:
        protection = self._messages[index].protection
        if protection is not None:
            counter = (self._counters[index] + 1 + skip) % protection.counter_states
            self._counters[index] = counter
            protection.protect(payload, counter)


def _framed(message: BoundMessage, payload: bytes, stamp_ns: int, *, flags: int) -> CanFrame:
    return CanFrame(
        message.can_id,
        payload,
        stamp_ns,
        message.is_extended or bool(flags & 1),
        bool(flags & 2),
        message.is_fd,
        bool(flags & 4),
    )
