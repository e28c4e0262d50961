"""What may leave: frames on the list, and no more of them than the list says."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.transmit_filter import WINDOW_NS, AllowedMessage, TransmitFilter, most_in_window
from vehicle_iface.units import NS_PER_MS

DRIVE = AllowedMessage(0x080, False, False, 8, 10 * NS_PER_MS)
LIGHTS = AllowedMessage(0x082, False, False, 8, 100 * NS_PER_MS)
FRAME = CanFrame(0x080, bytes(8))


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x081, bytes(8)),
        CanFrame(0x080, bytes(7)),
        CanFrame(0x080, b""),
        CanFrame(0x080, bytes(8), is_extended=True),
        CanFrame(0x080, bytes(8), is_fd=True),
        CanFrame(0x080, bytes(8), is_remote=True),
        CanFrame(0x080, bytes(8), is_error=True),
    ],
)
def test_frames_that_are_not_on_the_list_are_not_sent(frame: CanFrame) -> None:
    transmit_filter = TransmitFilter([DRIVE])
    assert not transmit_filter.allows(frame, 0)
    assert transmit_filter.refused == {"not on the list": 1, "too often": 0}
    assert transmit_filter.allows(FRAME, 0)


@pytest.mark.parametrize(("period_ms", "most"), [(10, 31), (1, 301), (100, 4), (1000, 1)])
def test_the_most_that_may_leave_in_a_window_is_a_fifth_more_than_nominal_and_one(period_ms: int, most: int) -> None:
    assert most_in_window(period_ms * NS_PER_MS) == most


@given(st.lists(st.integers(0, 40 * NS_PER_MS), max_size=200))
def test_no_window_has_more_frames_than_that(gaps_ns: list[int]) -> None:
    transmit_filter, now_ns, left_ns = TransmitFilter([DRIVE]), 0, []
    for gap_ns in gaps_ns:
        now_ns += gap_ns
        if transmit_filter.allows(FRAME, now_ns):
            left_ns.append(now_ns)
    for start_ns in left_ns:
        assert sum(start_ns <= at_ns < start_ns + WINDOW_NS for at_ns in left_ns) <= 31
    assert len(left_ns) + transmit_filter.refused["too often"] == len(gaps_ns)


def test_a_message_at_its_own_period_is_never_refused_and_another_one_has_its_own_count() -> None:
    transmit_filter = TransmitFilter([DRIVE, LIGHTS])
    assert all(transmit_filter.allows(FRAME, tick * 10 * NS_PER_MS) for tick in range(1000))
    assert all(transmit_filter.allows(CanFrame(0x082, bytes(8)), 0) for _ in range(4))
    assert not transmit_filter.allows(CanFrame(0x082, bytes(8)), WINDOW_NS - 1)
    assert transmit_filter.allows(CanFrame(0x082, bytes(8)), WINDOW_NS)


def test_each_frame_that_comes_too_often_is_counted() -> None:
    transmit_filter = TransmitFilter([DRIVE])
    assert [transmit_filter.allows(FRAME, 0) for _ in range(33)] == [True] * 31 + [False] * 2
    assert transmit_filter.refused == {"not on the list": 0, "too often": 2}


def test_asking_for_room_does_not_count() -> None:
    transmit_filter = TransmitFilter([LIGHTS])
    for _ in range(4):
        assert transmit_filter.has_room(0x082, False, False, 8, 0)
        assert transmit_filter.allows(CanFrame(0x082, bytes(8)), 0)
    assert not transmit_filter.has_room(0x082, False, False, 8, WINDOW_NS - 1)
    assert transmit_filter.has_room(0x082, False, False, 8, WINDOW_NS)
    assert transmit_filter.refused == {"not on the list": 0, "too often": 0}
