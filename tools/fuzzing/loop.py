"""The whole loop in virtual time, on a line where somebody forges frames.

The first byte chooses whether the vehicle stands or rolls. Once it is engaged, the input tampers with its frames before
the loop hears them (what they say, with a checksum that fits or not), adds frames of its own, and stalls the loop.
Law: the loop raises nothing; what it sends is intact, in order, within the limits, and not too often.
"""

import json
from collections.abc import Iterator

import msgspec

from fuzzing.engine.input_bytes import Bytes
from fuzzing.engine.traffic import Traffic
from tests.harness import Drive, counters_step_by_one, reference
from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.frame import CanFrame
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_MS

LENGTH = 512
_MOST_PASSES = 200
_MOST = 31
"""Command frames in 250 ms."""
_LIMITS = reference().profile.limits
_MESSAGES = {message.can_id: message for message in reference().received}


class _Forger:
    """Between the vehicle and the loop: forges the next frames of a message."""

    def __init__(self, drive: Drive, source: Bytes) -> None:
        self._drive, self._source = drive, source
        self._traffic = Traffic(reference(), source)
        self._forgeries: dict[int, tuple[int, int, bytes, bool]] = {}
        self._heard = drive.line.drain
        drive.line.drain = self.drain  # type: ignore[method-assign]

    def act(self) -> int:
        """Do what comes next in the input; for how many passes then."""
        source, line = self._source, self._drive.line
        kind = source.number()
        if kind < 0xA0:
            message = [*_MESSAGES.values()][kind % len(_MESSAGES)]
            at, passes = 16 + source.number() % 48, 1 + source.number() % 16
            self._forgeries[message.can_id] = (passes, at, source.take(1 + kind // 16 % 4), bool(kind & 8))
            return passes if kind & 4 else 0
        if kind < 0xE0:
            line.inject(self._traffic.next_frame(line.clock.t_ns))
        elif kind < 0xF0:
            self._drive.stall(source.number() * 1e-3)
        elif kind == 0xF0:
            self._drive.loop.arming.request()
        elif kind == 0xF1:
            self._drive.loop.shutdown.request()
        elif kind == 0xF2:
            line.full = not line.full
        return kind % 8

    def drain(self) -> list[CanFrame]:
        return [self._forged(frame) for frame in self._heard()]

    def _forged(self, frame: CanFrame) -> CanFrame:
        forgery, message = self._forgeries.get(frame.can_id), _MESSAGES.get(frame.can_id)
        if forgery is None or message is None or len(frame.data) != message.length:
            return frame
        left, at, what, is_sealed = forgery
        self._forgeries[frame.can_id] = (left - 1, at, what, is_sealed)
        if left == 1:
            del self._forgeries[frame.can_id]
        return frame._replace(data=_with_bits(message, frame.data, at, what, is_sealed=is_sealed))


def _with_bits(message: BoundMessage, data: bytes, at: int, what: bytes, *, is_sealed: bool) -> bytes:
    mask = ((1 << 8 * len(what)) - 1) << at
    bits = int.from_bytes(data, "little") & ~mask | int.from_bytes(what, "little") << at
    forged = bytearray((bits & (1 << 8 * len(data)) - 1).to_bytes(len(data), "little"))
    if is_sealed and message.protection is not None:
        message.protection.protect(forged, max(0, message.protection.read_counter(data)))
    return bytes(forged)


def run(data: bytes) -> None:
    source = Bytes(data)
    is_rolling = source.number() & 1
    start = BicycleState(speed_mps=4.0) if is_rolling else None
    drive = Drive(start=start, gear=Gear.DRIVE if is_rolling else None).engage()
    forger = _Forger(drive, source)
    passes = 0
    while source and passes < _MOST_PASSES and not drive.loop.shutdown.is_done:
        for _ in range(forger.act()):
            if not drive.loop.shutdown.is_done:
                drive.step()
            passes += 1
    _judge(drive)


def _judge(drive: Drive) -> None:
    assert counters_step_by_one(drive.sent)
    sent_ns = [command.at_ns for command in drive.named("DRIVE_COMMAND")]
    assert all(after - before >= 250 * NS_PER_MS for before, after in zip(sent_ns, sent_ns[_MOST:], strict=False))
    for command in drive.named("DRIVE_COMMAND"):
        assert _LIMITS.accel_min_mps2 - 1e-9 <= command["ACCEL_REQUEST"] <= _LIMITS.accel_max_mps2 + 1e-9
    for command in drive.named("STEER_COMMAND"):
        assert abs(command["FRONT_WHEEL_ANGLE_REQUEST"]) <= _LIMITS.front_wheel_angle_rad + 1e-9
        assert abs(command["REAR_WHEEL_ANGLE_REQUEST"]) <= _LIMITS.rear_wheel_angle_rad + 1e-9
    builtins = msgspec.to_builtins([drive.loop.details(), drive.loop.summary()])
    json.dumps(builtins, allow_nan=False)


def seeds() -> Iterator[bytes]:
    yield b"\0\xe7\xe7\xe7\xe7"
    for kind in range(len(_MESSAGES)):
        yield bytes([1, 12 | kind, 24, 8, 16, 0xE7])
        for flags in (4, 12):
            yield b"\x01" + bytes([kind + 0x30 & 0xF0 | flags | kind % 4, 8, 3, 255, 255, 255, 127]) * 3
    yield bytes([1, 0xA7, 0, *range(16), 0xE5, 100, 0xF0, 0xE7, 50, 0xF1, 0xE7, 0xF2, 0xE7, 0xE7])
