"""The kernel's struct can_frame and canfd_frame (linux/can.h), there and back."""

import socket
import struct
import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.bus.raw_socket import pack_frame, unpack_frame
from vehicle_iface.bus.receive import BATCH, CANFD_MTU, BatchReceiver
from vehicle_iface.bus.transmit import BatchSender
from vehicle_iface.frame import CanFrame


class Wire:
    """Two sockets of another family that carry the kernel's structures as a CAN socket does."""

    def __init__(self) -> None:
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.receiver = BatchReceiver(self.near.fileno())

    def comes_as(self, raw: bytes, stamp_ns: int = 0) -> CanFrame:
        self.far.send(raw)
        [packet] = self.receiver.receive(wait=False)
        return unpack_frame(packet, stamp_ns)


@pytest.fixture(scope="module")
def wire() -> Iterator[Wire]:
    made = Wire()
    yield made
    made.near.close()
    made.far.close()


@st.composite
def frames(draw: st.DrawFn) -> CanFrame:
    is_extended, is_fd = draw(st.booleans()), draw(st.booleans())
    return CanFrame(
        draw(st.integers(0, 0x1FFFFFFF if is_extended else 0x7FF)),
        draw(st.binary(max_size=64 if is_fd else 8)),
        stamp_ns=draw(st.integers(0, 2**62)),
        is_extended=is_extended,
        is_remote=not is_fd and draw(st.booleans()),
        is_fd=is_fd,
    )


@given(frames())
def test_every_frame_comes_back_as_it_went(wire: Wire, frame: CanFrame) -> None:
    assert wire.comes_as(pack_frame(frame), frame.stamp_ns) == frame


def test_a_batch_keeps_the_order_and_leaves_the_rest_for_the_next_call(wire: Wire) -> None:
    sent = [CanFrame(number, bytes([number])) for number in range(BATCH + 3)]
    for frame in sent:
        wire.far.send(pack_frame(frame))
    batches = [wire.receiver.receive(wait=False) for _ in range(3)]
    assert [len(batch) for batch in batches] == [BATCH, 3, 0]
    assert [unpack_frame(packet, 0) for batch in batches for packet in batch] == sent


def test_the_stamp_is_the_kernels_wall_clock_time(wire: Wire) -> None:
    wire.near.setsockopt(socket.SOL_SOCKET, 35, 1)  # SO_TIMESTAMPNS
    before_ns = time.time_ns()
    wire.far.send(pack_frame(CanFrame(1, b"")))
    after_ns = time.time_ns()
    [packet] = wire.receiver.receive(wait=False)
    assert before_ns - 50_000_000 <= packet[3] <= after_ns + 50_000_000
    wire.near.setsockopt(socket.SOL_SOCKET, 35, 0)
    wire.far.send(pack_frame(CanFrame(1, b"")))
    [packet] = wire.receiver.receive(wait=False)
    assert packet[3:5] == (0, 0)


@given(frames())
def test_the_length_distinguishes_classic_and_fd_frames(frame: CanFrame) -> None:
    assert len(pack_frame(frame)) == (CANFD_MTU if frame.is_fd else 16)


def test_a_frame_has_the_layout_of_the_header_file() -> None:
    assert pack_frame(CanFrame(0x123, b"\x01\x02")) == struct.pack("=IB3x8s", 0x123, 2, b"\x01\x02")
    assert pack_frame(CanFrame(0x123, b"", is_extended=True))[:4] == struct.pack("=I", 0x80000123)
    assert pack_frame(CanFrame(0x123, b"", is_remote=True))[:4] == struct.pack("=I", 0x40000123)
    assert pack_frame(CanFrame(0x1, bytes(12), is_fd=True))[:8] == struct.pack("=IBBxx", 1, 12, 1)


@pytest.mark.parametrize("can_class", [0x001, 0x040, 0x080, 0x100])
def test_an_error_frame_is_distinguished_from_a_data_frame_of_the_same_number(wire: Wire, can_class: int) -> None:
    frame = wire.comes_as(struct.pack("=IB3x8s", 0x20000000 | can_class, 8, bytes(8)), 5)
    assert (frame.can_id, frame.is_error, frame.is_extended, frame.is_remote) == (can_class, True, False, False)


def test_bytes_beyond_the_length_are_not_part_of_the_frame(wire: Wire) -> None:
    raw = struct.pack("=IB3x8s", 0x123, 3, b"\x01\x02\x03\xff\xff\xff\xff\xff")
    assert wire.comes_as(raw) == CanFrame(0x123, b"\x01\x02\x03")


def test_frames_handed_over_together_come_one_by_one_and_in_order(wire: Wire) -> None:
    sender = BatchSender(wire.far.fileno())
    sent = [CanFrame(1, b"\x01\x02"), CanFrame(2, bytes(64), is_fd=True), CanFrame(3, b"")]
    assert sender.send([pack_frame(frame) for frame in sent]) == 3
    assert [unpack_frame(packet, 0) for packet in wire.receiver.receive(wait=False)] == sent


def test_a_frame_without_room_is_refused_and_does_not_block(wire: Wire) -> None:
    sender = BatchSender(wire.far.fileno())
    frame = pack_frame(CanFrame(1, bytes(8)))
    taken = [sender.send([frame] * 8) for _ in range(1000)]
    assert taken[-1] == 0
    came = 0
    while batch := wire.receiver.receive(wait=False):
        came += len(batch)
    assert came == sum(taken)


def test_a_socket_that_is_gone_is_an_error_and_not_a_refusal() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    far.close()
    with pytest.raises(ConnectionRefusedError):
        BatchSender(near.fileno()).send([pack_frame(CanFrame(1, b""))])
    near.close()
