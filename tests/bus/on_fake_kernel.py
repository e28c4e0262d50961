"""Both implementations of the bus on the same datagrams; `test_frame_io.py` preloads `fake_kernel.c` for it."""

import ctypes
import errno
import struct
from collections.abc import Callable
from dataclasses import dataclass

from hypothesis import example, given
from hypothesis import strategies as st

from tests.wire_library import load_wire
from vehicle_iface.bus.base import MOST_AT_ONCE
from vehicle_iface.bus.frame_io import FrameReceiver, FrameSender, PythonReceiver, PythonSender
from vehicle_iface.bus.raw_socket import pack_frame
from vehicle_iface.bus.receive import BATCH
from vehicle_iface.frame import CanFrame, unchecked_frame

NO_SOCKET = -1
BUS = 3
SO_TIMESTAMPNS, SO_RXQ_OVFL, SOL_SOCKET = 35, 40, 1
CMSGHDR = struct.Struct("@Nii")

_wire = load_wire()


class _Datagram(ctypes.Structure):
    _fields_ = (
        ("bytes", ctypes.c_ubyte * 72),
        ("control", ctypes.c_ubyte * 64),
        ("size", ctypes.c_uint),
        ("control_size", ctypes.c_uint),
    )


_fake = ctypes.CDLL(None)
_received = (_Datagram * 64).in_dll(_fake, "fake_received")
_sent = (_Datagram * 64).in_dll(_fake, "fake_sent")
_count, _errno, _flags, _accepted = (
    ctypes.c_int.in_dll(_fake, f"fake_{name}") for name in ("count", "errno", "flags", "accepted")
)


@dataclass(frozen=True)
class Datagram:
    """What the kernel hands over for one frame."""

    raw: bytes
    control: bytes


@dataclass(frozen=True)
class Call:
    """One call of `receive`, and the `take` after it."""

    wait: bool
    error: int
    datagrams: list[Datagram]
    offset_ns: int
    now_ns: int


def control_message(level: int, kind: int, content: bytes) -> bytes:
    return CMSGHDR.pack(CMSGHDR.size + len(content), level, kind) + content


def _stamp(seconds: int, nanoseconds: int) -> bytes:
    return control_message(SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", seconds, nanoseconds))


def _drops(count: int) -> bytes:
    return control_message(SOL_SOCKET, SO_RXQ_OVFL, struct.pack("@I", count))


STAMPS = st.builds(_stamp, st.integers(0, 2**33) | st.just(0), st.integers(0, 999_999_999) | st.just(0))
DROPS = st.builds(_drops, st.integers(0, 2**32 - 1) | st.integers(0, 9))
OTHERS = st.builds(
    control_message, st.sampled_from([1, 0, 41]), st.sampled_from([35, 40, 2, 37]), st.binary(max_size=24)
)


@st.composite
def controls(draw: st.DrawFn) -> bytes:
    """Messages as the kernel puts them, aligned; the last may be cut off, with its length corrected or not."""
    control, last = b"", 0
    for message in draw(st.lists(STAMPS | DROPS | OTHERS, max_size=4)):
        last = len(control)
        control += message + bytes(-len(message) % 8)
    size = min(len(control), draw(st.sampled_from([64, 64, 64, draw(st.integers(0, 64))])))
    if size >= last + CMSGHDR.size and draw(st.booleans()):
        _, level, kind = CMSGHDR.unpack_from(control, last)
        control = control[:last] + CMSGHDR.pack(size - last, level, kind) + control[last + CMSGHDR.size :]
    return control[:size]


@st.composite
def datagrams(draw: st.DrawFn) -> Datagram:
    word = draw(st.integers(0, 0x7FF) | st.integers(0, 2**32 - 1))
    length = draw(st.integers(0, 8) | st.integers(0, 64) | st.integers(0, 255))
    raw = struct.pack("=IB3s", word, length, draw(st.binary(min_size=3, max_size=3))) + draw(
        st.binary(min_size=64, max_size=64)
    )
    size = draw(st.sampled_from([16, 16, 16, 72, 72, draw(st.integers(0, 72))]))
    return Datagram(raw[:size], draw(STAMPS | controls() | st.binary(max_size=64)))


CALLS = st.builds(
    Call,
    st.booleans(),
    st.sampled_from([0] * 8 + [errno.EAGAIN, errno.EINTR, errno.ENETDOWN, errno.ENODEV]),
    st.lists(datagrams(), max_size=5),
    st.integers(-(2**61), 2**61),
    st.integers(0, 2**62),
)


def _deliver(call: Call) -> None:
    _errno.value, _count.value = call.error, len(call.datagrams)
    for place, datagram in zip(_received, call.datagrams, strict=False):
        place.bytes[: len(datagram.raw)] = datagram.raw
        place.control[: len(datagram.control)] = datagram.control
        place.size, place.control_size = len(datagram.raw), len(datagram.control)


def outcome(run: Callable[[], object]) -> object:
    """The result, or the exception's kind and text."""
    try:
        return run()
    except (ArithmeticError, OSError, TypeError, ValueError, struct.error) as error:
        return type(error), str(error)


def _receive(receiver: FrameReceiver, call: Call) -> list[object]:
    """Everything that can be seen of one call."""
    _deliver(call)
    inbox: list[CanFrame] = []
    seen: list[object] = [outcome(lambda: receiver.receive(call.wait)), _flags.value]
    for _ in range(2):  # the second time there is nothing left
        seen.append(outcome(lambda: receiver.take(inbox, call.offset_ns, call.now_ns)))
    return [*seen, [(type(frame), tuple(frame), [type(value) for value in frame]) for frame in inbox]]


@given(st.lists(CALLS, max_size=6))
def test_both_receive_the_same(calls: list[Call]) -> None:
    python: FrameReceiver = PythonReceiver(NO_SOCKET, BUS)
    c: FrameReceiver = _wire.FrameReceiver(NO_SOCKET, CanFrame, BUS)
    for call in calls:
        assert _receive(c, call) == _receive(python, call)


def test_both_receive_a_full_batch() -> None:
    python, c = PythonReceiver(NO_SOCKET, BUS), _wire.FrameReceiver(NO_SOCKET, CanFrame, BUS)
    full = [Datagram(struct.pack("=IB3x8s", i, 8, bytes([i] * 8)), _drops(i) + bytes(4)) for i in range(BATCH)]
    for _ in range(3):
        call = Call(wait=False, error=0, datagrams=full, offset_ns=0, now_ns=1)
        assert _receive(c, call) == _receive(python, call)
        assert _receive(c, call)[0] == BATCH


FLAGS = st.booleans() | st.booleans() | st.integers(0, 2)
ODD_FRAMES = st.builds(
    lambda *fields: unchecked_frame(fields),
    st.integers(0, 0x7FF) | st.integers(-1, 2**33) | st.booleans() | st.just("1"),
    st.binary(max_size=8) | st.binary(max_size=64) | st.binary(max_size=100) | st.builds(bytearray) | st.just("data"),
    st.just(0),
    FLAGS,
    FLAGS,
    FLAGS,
    FLAGS,
    st.integers(0, 2),
)


@st.composite
def frames(draw: st.DrawFn) -> CanFrame:
    is_extended, is_fd = draw(st.booleans()), draw(st.booleans())
    return CanFrame(
        draw(st.integers(0, 0x1FFFFFFF if is_extended else 0x7FF)),
        draw(st.binary(max_size=64 if is_fd else 8)),
        is_extended=is_extended,
        is_remote=draw(st.booleans()),
        is_fd=is_fd,
    )


def _send(sender: FrameSender, batch: tuple[CanFrame, ...], error: int, accepted: int) -> list[object]:
    _errno.value, _accepted.value, _count.value = error, accepted, 0
    result = outcome(lambda: sender.send(batch))
    return [result, [bytes(place.bytes[: place.size]) for place in _sent[: _count.value]], _flags.value]


@given(
    st.lists(
        st.tuples(
            st.lists(frames() | frames() | ODD_FRAMES, max_size=MOST_AT_ONCE).map(tuple),
            st.sampled_from([0] * 6 + [errno.EAGAIN, errno.ENOBUFS, errno.EINTR, errno.ENETDOWN, errno.EINVAL]),
            st.integers(0, MOST_AT_ONCE),
        ),
        max_size=4,
    )
)
@example([((tuple.__new__(tuple, (1, b"")),), 0, 1)])
def test_both_send_the_same(batches: list[tuple[tuple[CanFrame, ...], int, int]]) -> None:
    python, c = PythonSender(NO_SOCKET), _wire.FrameSender(NO_SOCKET, pack_frame)
    for batch, error, accepted in batches:
        assert _send(c, batch, error, accepted) == _send(python, batch, error, accepted)
