"""The socket of those who only listen: it is opened again, and what it loses is counted across all sockets."""

import errno
import os
import socket
from collections.abc import Iterator

import pytest

from vehicle_iface.bus import listening
from vehicle_iface.bus.listening import ListeningSocket
from vehicle_iface.bus.receive import BATCH
from vehicle_iface.errors import BusError

REOPEN_NS = 100


class Kernel:
    """Opens one socket after another; `is_up` decides whether it can."""

    def __init__(self) -> None:
        self.opened: list[socket.socket] = []
        self.is_up = True
        self.dropped = 0

    def open_socket(self, channel: str, *_: object, **__: object) -> socket.socket:
        if not self.is_up:
            raise BusError(f"{channel}: the interface is down")
        self.opened.append(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        return self.opened[-1]

    def count_dropped_frames(self, _: socket.socket) -> int:
        return self.dropped


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Iterator[Kernel]:
    made = Kernel()
    monkeypatch.setattr(listening, "open_socket", made.open_socket)
    monkeypatch.setattr(listening, "count_dropped_frames", made.count_dropped_frames)
    yield made
    for each in made.opened:
        each.close()


def fail(_: int) -> int:
    raise OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN))


def listen() -> ListeningSocket[int]:
    return ListeningSocket("can7", lambda descriptor: descriptor, receive_bytes=1, reopen_ns=REOPEN_NS)


def test_it_receives_until_a_batch_is_not_full_and_at_most_so_often(kernel: Kernel) -> None:
    counts = [BATCH, BATCH, 3, BATCH, BATCH, BATCH]
    socket = listen()
    socket.read(0, lambda _: counts.pop(0), most_batches=5)
    assert len(counts) == 3
    socket.read(0, lambda _: counts.pop(0), most_batches=2)
    assert len(counts) == 1
    socket.close()
    socket.close()
    assert not socket.is_open
    assert len(kernel.opened) == 1


def test_a_lost_interface_is_opened_again_and_its_losses_are_kept(kernel: Kernel) -> None:
    socket = listen()
    kernel.dropped = 4
    socket.read(0, lambda _: 0, most_batches=1)
    assert (socket.is_open, socket.problem, socket.lost) == (True, "", 4)
    socket.read(1, fail, most_batches=1)
    assert (socket.is_open, socket.problem) == (False, "can7: Network is down")
    assert kernel.opened[0].fileno() == -1
    kernel.is_up = False
    socket.read(REOPEN_NS, fail, most_batches=1)  # not due yet
    assert socket.problem == "can7: Network is down"
    socket.read(1 + REOPEN_NS, fail, most_batches=1)
    assert socket.problem == "can7: the interface is down"
    kernel.is_up, kernel.dropped = True, 2
    socket.read(1 + 2 * REOPEN_NS, lambda _: 0, most_batches=1)
    assert (socket.is_open, socket.problem, socket.lost) == (True, "", 6)


@pytest.mark.usefixtures("kernel")
def test_each_socket_has_a_receiver_of_its_own() -> None:
    seen: set[int] = set()

    def receive(descriptor: int) -> int:
        seen.add(descriptor)
        os.fstat(descriptor)
        return 0

    socket = listen()
    socket.open()
    socket.read(0, receive, most_batches=1)
    assert len(seen) == 1
