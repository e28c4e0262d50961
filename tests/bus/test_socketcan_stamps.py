"""The stamps of received frames: the kernel's wall-clock time on the monotonic clock, and never later than now."""

import socket
from collections.abc import Iterator

import pytest

from vehicle_iface import clock
from vehicle_iface.bus import socketcan, traffic_monitor
from vehicle_iface.bus.raw_socket import pack_frame
from vehicle_iface.bus.receive import SO_TIMESTAMPNS, SOL_SOCKET
from vehicle_iface.bus.socketcan import SocketCanBus
from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_MS, NS_PER_S

FRAMES = [CanFrame(0x100, b"\x01"), CanFrame(0x18FF0001, b"\x02", is_extended=True), CanFrame(0x100, b"", is_fd=True)]


class Pair:
    """A bus on socket pairs in the place of CAN sockets, and the far end of the receiving one."""

    def __init__(self) -> None:
        self.ends: list[socket.socket] = []
        self.bus: SocketCanBus

    def open(self, *_: object, **__: object) -> socket.socket:
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        near.setsockopt(SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.ends.append(far)
        return near

    def carry(self, frame: CanFrame) -> CanFrame:
        self.ends[0].send(pack_frame(frame))
        [received] = self.bus.drain()
        return received


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pair]:
    made = Pair()
    for module in (socketcan, traffic_monitor):
        monkeypatch.setattr(module, "open_socket", made.open)
    made.bus = SocketCanBus("pair", [0x100], bitrate=500_000, data_bitrate=2_000_000, number=3)
    yield made
    made.bus.close()
    for end in made.ends:
        end.close()


@pytest.mark.parametrize("frame", FRAMES)
def test_a_received_frame_has_the_time_of_its_receipt_and_the_number_of_its_bus(pair: Pair, frame: CanFrame) -> None:
    before_ns = clock.monotonic_ns()
    received = pair.carry(frame)
    assert before_ns - NS_PER_MS <= received.stamp_ns <= clock.monotonic_ns()
    assert received == frame._replace(stamp_ns=received.stamp_ns, bus=3)


@pytest.mark.parametrize("frame", FRAMES)
def test_a_wall_clock_that_is_set_back_after_the_stamp_gives_no_stamp_later_than_now(
    pair: Pair, frame: CanFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall_ns = clock.wall_ns
    monkeypatch.setattr(clock, "wall_ns", lambda: wall_ns() - 3600 * NS_PER_S)
    before_ns = clock.monotonic_ns()
    assert before_ns <= pair.carry(frame).stamp_ns <= clock.monotonic_ns()
    assert pair.bus.counters()["wall_clock_steps"] == 1


def test_frames_after_a_step_of_the_wall_clock_have_right_stamps_again(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall_ns = clock.wall_ns
    monkeypatch.setattr(clock, "wall_ns", lambda: wall_ns() - 3600 * NS_PER_S)
    pair.carry(FRAMES[0])
    monkeypatch.setattr(clock, "wall_ns", wall_ns)
    before_ns = clock.monotonic_ns()
    assert before_ns - NS_PER_MS <= pair.carry(FRAMES[0]).stamp_ns <= clock.monotonic_ns()
    assert pair.bus.counters()["wall_clock_steps"] == 2
