"""The loop's hold on the bus: lost once, told once, tried again on a grid."""

import pytest
from harness import Clock, ms

from vehicle_iface.bus.memory import MemoryBus
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.link import REOPEN_NS, Link

FRAME = CanFrame(0x80, b"12345678")


class Socket:
    """A bus that can be cut, and that remembers how it was treated."""

    def __init__(self, cable: "Cable") -> None:
        self.description = f"socket {len(cable.sockets)}"
        self.cable = cable
        self.closed = 0
        self.received = 0

    def wait(self, until_ns: int) -> bool:
        self._check()
        self.cable.clock.sleep_until(until_ns)
        return bool(self.cable.frames)

    def drain(self) -> list[CanFrame]:
        self._check()
        frames, self.cable.frames = self.cable.frames, []
        self.received += len(frames)
        return frames

    def send(self, frame: CanFrame) -> bool:  # noqa: ARG002
        self._check()
        return not self.cable.full

    def counters(self) -> dict[str, int]:
        return {"received": self.received}

    def close(self) -> None:
        self.closed += 1

    def _check(self) -> None:
        if self.cable.down:
            raise BusError("cut")


class Cable:
    """Everything that a link is opened on."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.down = self.full = False
        self.frames: list[CanFrame] = []
        self.sockets: list[Socket] = []
        self.tries_ns: list[int] = []
        self.lost = 0
        self.counts = Counts()
        self.link = Link(
            self.open,
            self.counts,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
            on_lost=self.on_lost,
        )

    def open(self) -> Socket:
        self.tries_ns.append(self.clock.t_ns)
        if self.down:
            raise BusError("still down")
        self.sockets.append(Socket(self))
        return self.sockets[-1]

    def on_lost(self) -> None:
        self.lost += 1

    def pass_for(self, duration_ns: int) -> list[CanFrame]:
        heard: list[CanFrame] = []
        end_ns = self.clock.t_ns + duration_ns
        while self.clock.t_ns < end_ns:
            heard += self.link.hear(self.clock.t_ns + ms(10))
        return heard


def test_a_bus_that_cannot_be_opened_at_the_start_is_an_error() -> None:
    def refuse() -> MemoryBus:
        raise BusError("vcan0: no such interface")

    clock = Clock()
    with pytest.raises(BusError, match="vcan0"):
        Link(refuse, Counts(), now_ns=clock.now_ns, sleep_until=clock.sleep_until, on_lost=lambda: None)


@pytest.mark.parametrize("by", ["hearing", "sending"])
def test_a_loss_closes_the_bus_and_is_counted_and_told_once(by: str) -> None:
    cable = Cable()
    cable.down = True
    if by == "hearing":
        assert cable.link.hear(cable.clock.t_ns + ms(10)) == []
    else:
        assert not cable.link.send(FRAME)
    for _ in range(3):
        assert not cable.link.send(FRAME)
    cable.pass_for(ms(1000))
    assert (cable.lost, cable.counts.link_losses, cable.sockets[0].closed) == (1, 1, 1)
    assert cable.counts.frames_sent == 0


def test_a_frame_that_met_a_lost_link_is_not_sent_later() -> None:
    cable = Cable()
    cable.down = True
    cable.link.send(FRAME)
    cable.down = False
    cable.pass_for(ms(300))
    assert len(cable.sockets) == 2
    assert cable.counts.frames_sent == 0


def test_a_lost_link_is_tried_ten_times_a_second_on_its_grid() -> None:
    cable = Cable()
    began_ns = cable.clock.t_ns
    cable.down = True
    cable.pass_for(ms(1005))
    tries_ns = cable.tries_ns[1:]
    assert len(tries_ns) == 10
    assert [(t_ns - began_ns) % REOPEN_NS for t_ns in tries_ns] == [0] * 10


def test_a_link_that_is_back_hears_and_sends_again() -> None:
    cable = Cable()
    cable.down = True
    cable.pass_for(ms(250))
    cable.down = False
    cable.pass_for(ms(100))
    cable.frames = [FRAME]
    assert cable.pass_for(ms(10)) == [FRAME]
    assert cable.link.send(FRAME)
    cable.down = True
    cable.pass_for(ms(20))
    assert (cable.lost, cable.counts.link_losses) == (2, 2)


def test_a_full_bus_is_no_lost_link() -> None:
    cable = Cable()
    cable.full = True
    assert not cable.link.send(FRAME)
    assert (cable.counts.frames_sent, cable.counts.frames_not_sent, cable.lost) == (0, 1, 0)
    cable.full = False
    assert cable.link.send(FRAME)
    assert (cable.counts.frames_sent, cable.counts.frames_not_sent) == (1, 1)


def test_the_counters_survive_every_loss() -> None:
    cable = Cable()
    for heard in range(1, 4):
        cable.frames = [FRAME] * heard
        cable.pass_for(ms(10))
        cable.down = True
        cable.pass_for(ms(10))
        cable.down = False
        cable.pass_for(ms(200))
    assert cable.link.counters() == {"received": 1 + 2 + 3}


def test_closing_twice_closes_the_bus_once() -> None:
    cable = Cable()
    cable.link.close()
    cable.link.close()
    assert cable.sockets[0].closed == 1
    assert cable.lost == 0
