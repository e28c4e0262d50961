"""Two ends of a bus in one process."""

import pytest
from harness import START_NS, Clock
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.bus.memory import ROOM_FRAMES, MemoryBus
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame


def pair() -> tuple[Clock, MemoryBus, MemoryBus]:
    clock = Clock()
    return (clock, *MemoryBus.pair(clock.now_ns, clock.sleep_until))


@given(st.lists(st.binary(max_size=8), max_size=50))
def test_what_one_end_sends_the_other_hears_in_order_stamped_and_once(payloads: list[bytes]) -> None:
    clock, one, other = pair()
    for number, payload in enumerate(payloads):
        clock.t_ns += 1
        assert one.send(CanFrame(number, payload, stamp_ns=5))
    assert [(f.can_id, f.data, f.stamp_ns) for f in other.drain()] == [
        (number, payload, START_NS + number + 1) for number, payload in enumerate(payloads)
    ]
    assert other.drain() == one.drain() == []


def test_the_kind_of_a_frame_comes_through() -> None:
    _, one, other = pair()
    frames = [
        CanFrame(1, b"", is_remote=True),
        CanFrame(1 << 20, b"1", is_extended=True),
        CanFrame(2, bytes(64), is_fd=True),
    ]
    for frame in frames:
        one.send(frame)
    assert [frame._replace(stamp_ns=0) for frame in other.drain()] == frames


def test_waiting_sleeps_until_the_deadline_or_returns_at_once_when_something_is_there() -> None:
    clock, one, other = pair()
    assert not one.wait(START_NS + 100)
    assert clock.t_ns == START_NS + 100
    other.send(CanFrame(1, b""))
    assert one.wait(START_NS + 10**9)
    assert clock.t_ns == START_NS + 100


def test_a_full_end_keeps_the_oldest_and_counts_what_it_had_no_room_for() -> None:
    _, one, other = pair()
    took = [one.send(CanFrame(number, b"")) for number in range(ROOM_FRAMES + 5)]
    assert took == [True] * ROOM_FRAMES + [False] * 5
    assert [frame.can_id for frame in other.drain()] == list(range(ROOM_FRAMES))
    assert one.counters() == {"received": 0, "sent": ROOM_FRAMES, "send_no_room": 5}
    assert other.counters()["received"] == ROOM_FRAMES


@pytest.mark.parametrize("closed", [0, 1])
def test_when_either_end_is_closed_sending_says_so_by_name(closed: int) -> None:
    _, *ends = pair()
    ends[closed].close()
    ends[closed].close()
    for end in ends:
        with pytest.raises(BusError, match="memory bus: the other end is closed"):
            end.send(CanFrame(1, b""))
