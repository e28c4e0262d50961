"""A stop is held until its cause has been away for a while; causes that come and go latch."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import Reason
from vehicle_iface.profile import Recovery
from vehicle_iface.safety.stop_hold import StopHold

MS = 1_000_000
FAST_MPS = 5.0
SLOW_MPS = 1.0
"""Up to here stops by the trajectory are not counted."""
SLOW = [0.0, 0.5, SLOW_MPS, -SLOW_MPS]
BY_TRAJECTORY = [
    Reason.NO_TRAJECTORY,
    Reason.EMPTY_TRAJECTORY,
    Reason.PAST_END_SPACE,
    Reason.PAST_END_TIME,
    Reason.DEVIATION,
]
HOLDS_MS = {
    Reason.STATE_INVALID: 500,
    Reason.STATE_STALE: 200,
    Reason.FRAME_MISMATCH: 500,
    Reason.CONTROLLER_ERROR: 500,
    Reason.DEADLINE_MISSED: 200,
    Reason.LINK_DOWN: 200,
    **dict.fromkeys(BY_TRAJECTORY, 200),
}
"""The profile's defaults."""


@pytest.mark.parametrize(("cause", "hold_ms"), HOLDS_MS.items(), ids=lambda value: str(value))
def test_each_cause_is_held_for_its_time_to_the_nanosecond(cause: Reason, hold_ms: int) -> None:
    hold = StopHold(Recovery())
    assert hold.update(None, 0, FAST_MPS) is None
    assert hold.update(cause, 100, FAST_MPS) is cause
    assert hold.update(cause, 200, FAST_MPS) is cause
    assert hold.update(None, 200 + hold_ms * MS - 1, FAST_MPS) is cause
    assert hold.update(None, 200 + hold_ms * MS, FAST_MPS) is None
    assert hold.update(None, 201 + hold_ms * MS, FAST_MPS) is None


@pytest.mark.parametrize("key", [name for name in Recovery.__struct_fields__ if name.endswith("_s")])
def test_each_time_is_the_profiles(key: str) -> None:
    if key == "latch_window_s":
        return
    causes = BY_TRAJECTORY if key == "trajectory_s" else [Reason[key.removesuffix("_s").upper()]]
    for cause in causes:
        hold = StopHold(msgspec.structs.replace(Recovery(), **{key: 3.0}))
        hold.update(cause, 0, FAST_MPS)
        assert hold.update(None, 2_999 * MS, FAST_MPS) is cause
        assert hold.update(None, 3_000 * MS, FAST_MPS) is None


@pytest.mark.parametrize("cause", [Reason.DUPLICATE_COMMANDER, Reason.DRIVER_OVERRIDE, Reason.VEHICLE_FAULT])
def test_a_cause_without_a_time_of_its_own_ends_with_its_last_sample(cause: Reason) -> None:
    hold = StopHold(Recovery())
    assert hold.update(cause, 0, FAST_MPS) is cause
    assert hold.update(None, 0, FAST_MPS) is None


def test_the_newest_cause_is_the_one_that_is_held() -> None:
    hold = StopHold(Recovery())
    hold.update(Reason.STATE_INVALID, 0, FAST_MPS)
    hold.update(Reason.STATE_STALE, 100 * MS, FAST_MPS)
    assert hold.update(None, 299 * MS, FAST_MPS) is Reason.STATE_STALE
    assert hold.update(None, 300 * MS, FAST_MPS) is None


@pytest.mark.parametrize("cause", HOLDS_MS)
@pytest.mark.parametrize("speed_mps", SLOW)
def test_a_slow_vehicle_waits_as_long(cause: Reason, speed_mps: float) -> None:
    hold = StopHold(Recovery())
    hold.update(cause, 0, speed_mps)
    assert hold.update(None, 1, speed_mps) is cause


def test_an_ordered_stop_is_neither_held_nor_counted() -> None:
    hold = StopHold(Recovery(latch_stops=2))
    for now_ns in range(10):
        assert hold.update(Reason.SHUTDOWN, 2 * now_ns, FAST_MPS) is Reason.SHUTDOWN
        assert hold.update(None, 2 * now_ns + 1, FAST_MPS) is None
    assert not hold.must_latch
    hold.update(Reason.STATE_INVALID, 20, FAST_MPS)
    assert hold.update(Reason.SHUTDOWN, 21, FAST_MPS) is Reason.SHUTDOWN


def begins(hold: StopHold, cause: Reason, times_ns: list[int], speed_mps: float = FAST_MPS) -> list[bool]:
    """Whether the stop must be latched after each beginning; the vehicle drives on between them."""
    latches = []
    for now_ns in times_ns:
        hold.update(cause, now_ns, speed_mps)
        latches.append(hold.must_latch)
        assert hold.update(None, now_ns + 1000 * MS, speed_mps) is None
    return latches


@pytest.mark.parametrize("cause", HOLDS_MS)
def test_the_fourth_stop_within_twenty_seconds_latches(cause: Reason) -> None:
    assert begins(StopHold(Recovery()), cause, [0, 5000 * MS, 10_000 * MS, 20_000 * MS]) == [False, False, False, True]
    late = [0, 5000 * MS, 10_000 * MS, 20_000 * MS + 1, 25_000 * MS + 1]
    assert begins(StopHold(Recovery()), cause, late) == [False] * 5
    long_running = [30_000 * MS + begin_ns for begin_ns in (0, 5000 * MS, 10_000 * MS, 20_000 * MS)]
    assert begins(StopHold(Recovery()), cause, long_running) == [False, False, False, True]


def test_count_and_window_are_the_profiles() -> None:
    recovery = Recovery(latch_stops=2, latch_window_s=3.0)
    assert begins(StopHold(recovery), Reason.STATE_STALE, [0, 3000 * MS]) == [False, True]
    assert begins(StopHold(recovery), Reason.STATE_STALE, [0, 3000 * MS + 1]) == [False, False]


@pytest.mark.parametrize("cause", HOLDS_MS)
@pytest.mark.parametrize("speed_mps", SLOW)
def test_at_low_speed_only_faults_are_counted(cause: Reason, speed_mps: float) -> None:
    latches = begins(StopHold(Recovery()), cause, [0, 2000 * MS, 4000 * MS, 6000 * MS], speed_mps)
    assert latches[-1] is (cause not in BY_TRAJECTORY)


@pytest.mark.parametrize("speed_mps", [SLOW_MPS + 1e-9, -SLOW_MPS - 1e-9])
def test_the_direction_of_travel_makes_no_difference(speed_mps: float) -> None:
    assert begins(StopHold(Recovery(latch_stops=2)), Reason.PAST_END_TIME, [0, 2000 * MS], speed_mps)[-1]


def test_a_stop_that_goes_on_is_one() -> None:
    hold = StopHold(Recovery(latch_stops=2))
    for tick in range(100):
        hold.update(Reason.STATE_INVALID if tick % 2 else Reason.FRAME_MISMATCH, tick * 10 * MS, FAST_MPS)
    assert not hold.must_latch


def test_a_new_drive_begins_without_history() -> None:
    hold = StopHold(Recovery(latch_stops=2))
    assert begins(hold, Reason.STATE_STALE, [0, 2000 * MS])[-1]
    hold.update(Reason.STATE_STALE, 4000 * MS, FAST_MPS)
    hold.reset()
    assert hold.update(None, 4001 * MS, FAST_MPS) is None
    assert begins(hold, Reason.STATE_STALE, [5000 * MS]) == [False]


@given(st.lists(st.tuples(st.integers(1, 60), st.booleans()), min_size=1, max_size=300))
def test_between_two_drives_the_cause_was_away_for_its_time(steps: list[tuple[int, bool]]) -> None:
    hold, now_ns, seen_ns = StopHold(Recovery(latch_stops=10)), 0, -(10**12)
    for wait_ms, is_bad in steps:
        now_ns += wait_ms * MS
        if is_bad:
            seen_ns = now_ns
        reason = hold.update(Reason.STATE_INVALID if is_bad else None, now_ns, FAST_MPS)
        assert (reason is None) == (now_ns - seen_ns >= 500 * MS)
