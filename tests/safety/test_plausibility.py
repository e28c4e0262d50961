"""What can be true of a vehicle, and what cannot."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness import ms, reference
from vehicle_iface import VehicleState
from vehicle_iface.safety.plausibility import ACCEPTED_AGAIN, PlausibilityCheck, PlausibilityFault

WHEELBASE_M = 2.7
PERIOD_NS = ms(10)


def check() -> PlausibilityCheck:
    return PlausibilityCheck(reference().profile.plausibility, wheelbase_m=WHEELBASE_M)


def drive(count: int, speed_mps: float = 5.0, front_rad: float = 0.0) -> list[VehicleState]:
    """A vehicle on a circle, sampled at 100 Hz."""
    yaw_radps = speed_mps * math.tan(front_rad) / WHEELBASE_M
    states, x_m, y_m = [], 0.0, 0.0
    for tick in range(count):
        heading_rad = math.remainder(yaw_radps * tick * 0.01, 2.0 * math.pi)
        states.append(
            VehicleState(
                stamp_ns=tick * PERIOD_NS,
                x_m=x_m,
                y_m=y_m,
                heading_rad=heading_rad,
                speed_mps=speed_mps,
                yaw_rate_radps=yaw_radps,
                front_wheel_angle_rad=front_rad,
            )
        )
        x_m += speed_mps * 0.01 * math.cos(heading_rad)
        y_m += speed_mps * 0.01 * math.sin(heading_rad)
    return states


def doubts(checked: PlausibilityCheck) -> dict[str, int]:
    return {name: count for name, count in checked.counts.items() if count}


@given(st.floats(-20.0, 20.0), st.floats(-0.6, 0.6), st.lists(st.integers(0, ms(40)), max_size=60))
def test_samples_of_an_ordinary_drive_are_accepted_at_any_spacing(
    speed_mps: float, front_rad: float, delays_ns: list[int]
) -> None:
    if abs(speed_mps * math.tan(front_rad) / WHEELBASE_M) > 3.0:
        front_rad = 0.0
    checked, came_ns = check(), 0
    for state, delay_ns in zip(drive(60, speed_mps, front_rad), delays_ns, strict=False):
        came_ns = max(came_ns, state.stamp_ns + delay_ns)
        assert checked.is_plausible(replace(state, stamp_ns=came_ns), pose_valid=True)
    assert doubts(checked) == {}


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        ({"speed_mps": 40.1}, PlausibilityFault.RANGE),
        ({"speed_mps": -40.1}, PlausibilityFault.RANGE),
        ({"accel_mps2": -20.1}, PlausibilityFault.RANGE),
        ({"yaw_rate_radps": 3.1}, PlausibilityFault.RANGE),
        ({"yaw_rate_radps": -3.1}, PlausibilityFault.RANGE),
        ({"yaw_rate_radps": 0.81}, PlausibilityFault.DISAGREEMENT),
        ({"yaw_rate_radps": -0.81}, PlausibilityFault.DISAGREEMENT),
        ({"front_wheel_angle_rad": 0.5}, PlausibilityFault.DISAGREEMENT),
        ({"speed_mps": 5.71}, PlausibilityFault.JUMP),
        ({"speed_mps": 4.29}, PlausibilityFault.JUMP),
        ({"x_m": 1.06}, PlausibilityFault.JUMP),
        ({"y_m": -0.6}, PlausibilityFault.JUMP),
        ({"heading_rad": 0.21}, PlausibilityFault.JUMP),
        ({"heading_rad": -0.21}, PlausibilityFault.JUMP),
        ({"heading_rad": math.pi}, PlausibilityFault.JUMP),
        ({"stamp_ns": ms(89)}, PlausibilityFault.ORDER),
    ],
)
def test_impossible_motion_is_dropped_and_counted_by_kind(change: dict[str, Any], doubt: PlausibilityFault) -> None:
    checked, states = check(), drive(12)
    assert all(checked.is_plausible(state, pose_valid=True) for state in states[:10])
    assert not checked.is_plausible(replace(states[10], **change), pose_valid=True)
    assert doubts(checked) == {doubt.value: 1}
    assert checked.is_plausible(states[11], pose_valid=True)
    assert not checked.is_persistent(since_ns=0)


@pytest.mark.parametrize(
    "change",
    [{"speed_mps": 5.69}, {"x_m": 0.99}, {"heading_rad": 0.19}, {"yaw_rate_radps": 0.79}, {"accel_mps2": 19.9}],
)
def test_motion_within_the_limits_is_accepted(change: dict[str, Any]) -> None:
    checked, states = check(), drive(12)
    assert all(checked.is_plausible(state, pose_valid=True) for state in states[:10])
    assert checked.is_plausible(replace(states[10], **change), pose_valid=True)


def test_the_third_in_a_row_persists_and_four_good_ones_end_it() -> None:
    checked, states = check(), drive(10)
    checked.is_plausible(states[0], pose_valid=True)
    seen = []
    for state in states[1:4]:
        assert not checked.is_plausible(replace(state, x_m=50.0), pose_valid=True)
        seen.append(checked.is_persistent(since_ns=state.stamp_ns))
    assert seen == [False, False, True]
    assert not checked.is_persistent(since_ns=states[3].stamp_ns + 1)
    persists = []
    for state in states[4:8]:
        assert checked.is_plausible(state, pose_valid=True)
        persists.append(checked.is_persistent(since_ns=0))
    assert persists == [True, True, True, False]


@pytest.mark.parametrize(("every", "is_seen"), [(2, True), (3, True), (4, True), (5, False), (8, False)])
def test_implausible_samples_persist_when_more_than_one_in_five_is(every: int, is_seen: bool) -> None:
    checked, seen = check(), False
    for number, state in enumerate(drive(200)):
        is_bad = number % every == every - 1
        sample = replace(state, x_m=state.x_m + 5.0) if is_bad else state
        assert checked.is_plausible(sample, pose_valid=True) is not is_bad
        seen = seen or checked.is_persistent(since_ns=0)
    assert seen is is_seen


def test_an_implausible_sample_of_long_ago_does_not_count_with_two_new_ones() -> None:
    checked, states = check(), drive(20)
    for number, state in enumerate(states):
        is_bad = number in (1, 18, 19)
        sample = replace(state, x_m=state.x_m + 5.0) if is_bad else state
        assert checked.is_plausible(sample, pose_valid=True) is not is_bad
    assert not checked.is_persistent(since_ns=0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "believed"),
    [
        (0.05, 0.5074, True),
        (0.05, 0.5076, False),
        (0.05, -0.5074, True),
        (0.05, -0.5076, False),
        (-0.4574, 0.0, True),
        (-0.4576, 0.0, False),
    ],
)
@pytest.mark.parametrize("heading_rad", [0.0, 0.5, 2.0, -1.0, math.pi])
def test_after_a_dropped_sample_the_vehicle_strayed_from_straight_on_by_a_share_of_its_way_at_most(
    heading_rad: float, ahead_m: float, aside_m: float, believed: bool, sign: float
) -> None:
    """0.05 m of way in 10 ms at 5 m/s: 0.15 times that, and 0.5 m, from the place straight ahead."""
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    here = still(x_m=7.0, y_m=-3.0, heading_rad=heading_rad, speed_mps=sign * 5.0)
    checked = check()
    assert checked.is_plausible(here, pose_valid=True)
    assert not checked.is_plausible(replace(here, stamp_ns=1, x_m=60.0), pose_valid=True)
    along_m = sign * ahead_m
    there = replace(
        here, stamp_ns=PERIOD_NS, x_m=7.0 + along_m * cos - aside_m * sin, y_m=-3.0 + along_m * sin + aside_m * cos
    )
    assert checked.is_plausible(there, pose_valid=True) is believed


def test_after_a_dropped_sample_a_vehicle_at_rest_may_have_strayed_by_exactly_what_is_written() -> None:
    checked = check()
    assert checked.is_plausible(still(), pose_valid=True)
    assert not checked.is_plausible(still(1, x_m=60.0), pose_valid=True)
    assert checked.is_plausible(still(PERIOD_NS, y_m=LIMITS.position_tolerance_m), pose_valid=True)


@pytest.mark.parametrize(
    "change", [{"speed_mps": -5.0}, {"speed_mps": 7.0}, {"y_m": 2.0}, {"y_m": -1.0}, {"x_m": -1.0}]
)
def test_samples_that_are_dropped_for_long_do_not_become_plausible_by_that(change: dict[str, Any]) -> None:
    """Within half a second; after that there has been silence."""
    checked, states = check(), drive(60)
    assert all(checked.is_plausible(state, pose_valid=True) for state in states[:10])
    for state in states[10:]:
        moved: dict[str, Any] = {
            name: value + (getattr(state, name) if name.endswith("_m") else 0.0) for name, value in change.items()
        }
        assert not checked.is_plausible(replace(state, **moved), pose_valid=True)


@pytest.mark.parametrize(("front_rad", "accel_mps2"), [(0.0, -3.0), (0.3, 0.0), (-0.3, -2.0), (0.2, 1.5)])
@pytest.mark.parametrize("lost", [1, 5, 20])
def test_samples_of_a_vehicle_that_braked_or_turned_while_others_were_dropped_are_accepted(
    front_rad: float, accel_mps2: float, lost: int
) -> None:
    checked, speed_mps, x_m, y_m, heading_rad = check(), 5.0, 0.0, 0.0, 0.0
    for tick in range(30 + lost):
        yaw_radps = speed_mps * math.tan(front_rad) / WHEELBASE_M
        state = still(tick * PERIOD_NS, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=speed_mps)
        state = replace(state, yaw_rate_radps=yaw_radps, front_wheel_angle_rad=front_rad)
        is_bad = 10 <= tick < 10 + lost
        sample = replace(state, x_m=x_m + 50.0) if is_bad else state
        assert checked.is_plausible(sample, pose_valid=True) is not is_bad
        x_m += speed_mps * 0.01 * math.cos(heading_rad)
        y_m += speed_mps * 0.01 * math.sin(heading_rad)
        heading_rad += yaw_radps * 0.01
        speed_mps += accel_mps2 * 0.01


def test_after_a_lasting_jump_the_new_position_is_accepted_in_the_end() -> None:
    checked, states = check(), drive(2 * ACCEPTED_AGAIN)
    checked.is_plausible(states[0], pose_valid=True)
    there = [replace(state, x_m=state.x_m + 50.0) for state in states[1:]]
    believed = [checked.is_plausible(state, pose_valid=True) for state in there]
    assert believed == [False] * 100 + [True] * (len(there) - 100)


def test_an_earlier_jump_does_not_count_for_the_position_that_is_accepted_in_the_end() -> None:
    checked, states = check(), drive(2 * ACCEPTED_AGAIN)
    there = [replace(state, x_m=state.x_m + 50.0) for state in states]
    believed = [checked.is_plausible(state, pose_valid=True) for state in [states[0], there[1], states[2], *there[3:]]]
    assert believed == [True, False, True] + [False] * 100 + [True] * (len(believed) - 103)


def test_a_constant_position_before_a_reset_does_not_count_as_frozen_after_it() -> None:
    checked = check()
    for first_ns in (0, ms(90)):
        for tick in range(9):
            assert checked.is_plausible(still(first_ns + tick * PERIOD_NS, speed_mps=5.0), pose_valid=True)
        checked.reset()


def test_positions_that_jump_about_are_never_accepted() -> None:
    checked, states = check(), drive(300)
    checked.is_plausible(states[0], pose_valid=True)
    for number, state in enumerate(states[1:]):
        assert not checked.is_plausible(replace(state, x_m=100.0 * (number % 2 + 1)), pose_valid=True)


@pytest.mark.parametrize("speed_mps", [-5.0, 5.0])
def test_a_constant_position_at_a_speed_other_than_zero_is_frozen(speed_mps: float) -> None:
    checked, states = check(), drive(40, speed_mps)
    frozen = [replace(state, x_m=0.0) for state in states]
    believed = [checked.is_plausible(state, pose_valid=True) for state in frozen]
    assert believed == [True] * 10 + [False] * 30
    assert doubts(checked) == {PlausibilityFault.FROZEN.value: 30}


@pytest.mark.parametrize(
    ("speed_mps", "believed"),
    [(20.0, 4), (6.0, 10), (0.51, 10), (0.5, 102), (-0.5, 102), (-0.51, 10), (0.25, 202)],
)
def test_a_frozen_position_is_found_out_by_its_way_where_it_is_fast_or_slow_and_else_by_its_time(
    speed_mps: float, believed: int
) -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=speed_mps) for tick in range(300))
    assert [checked.is_plausible(state, pose_valid=True) for state in samples].index(False) == believed


@given(st.floats(-20.0, 20.0), st.floats(-math.pi, math.pi), st.floats(0.0, 0.004))
def test_a_vehicle_that_moves_slowly_with_coarse_signals_is_not_frozen(
    speed_mps: float, heading_rad: float, start_m: float
) -> None:
    """The reference vehicle tells its position in steps of 5 mm, its speed in steps of 5 mm/s."""
    checked = check()
    for tick in range(400):
        way_m = start_m + speed_mps * tick * 0.01
        x_m, y_m = (round(way_m * part / 0.005) * 0.005 for part in (math.cos(heading_rad), math.sin(heading_rad)))
        sample = still(tick * PERIOD_NS, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=round(speed_mps, 2))
        assert checked.is_plausible(sample, pose_valid=True)


@pytest.mark.parametrize("brake_mps2", [0.5, 3.0, 6.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.1])
def test_a_vehicle_that_comes_to_a_stop_and_whose_speed_lags_behind_is_not_frozen(
    brake_mps2: float, lag_s: float
) -> None:
    checked, x_m, speed_mps, sent_mps = check(), 0.0, 2.0, 2.0
    for tick in range(600):
        sent_mps += (speed_mps - sent_mps) * (0.01 / lag_s if lag_s else 1.0)
        sample = still(tick * PERIOD_NS, x_m=round(x_m / 0.005) * 0.005, speed_mps=round(sent_mps / 0.005) * 0.005)
        assert checked.is_plausible(sample, pose_valid=True)
        speed_mps = max(0.0, speed_mps - brake_mps2 * 0.01)
        x_m += speed_mps * 0.01


@pytest.mark.parametrize("offset_mps", [0.0, 0.005, -0.05])
def test_a_vehicle_that_stands_may_send_the_same_for_ever_and_then_drive_on(offset_mps: float) -> None:
    checked = check()
    for tick in range(30_000):
        assert checked.is_plausible(still(tick * PERIOD_NS, x_m=1.0, speed_mps=offset_mps), pose_valid=True)
    for tick in range(300):
        speed_mps, x_m = 0.01 * tick, 1.0 + 0.00005 * tick**2
        sample = still((30_000 + tick) * PERIOD_NS, x_m=round(x_m / 0.005) * 0.005, speed_mps=speed_mps)
        assert checked.is_plausible(sample, pose_valid=True)


@pytest.mark.parametrize("stuck_mps", [0.3, 1.5, 10.0])
def test_a_speed_that_was_stuck_at_standstill_is_accepted_again_when_it_is_right(stuck_mps: float) -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=stuck_mps if tick < 300 else 0.0) for tick in range(600))
    believed = [checked.is_plausible(state, pose_valid=True) for state in samples]
    assert not believed[299]
    again = believed.index(True, 299)
    assert 349 <= again <= 300 + 50 + ACCEPTED_AGAIN
    assert all(believed[again:])


@pytest.mark.parametrize(("rest_samples", "is_forgotten"), [(50, True), (49, False)])
@pytest.mark.parametrize("rest_mps", [0.0, 0.05, -0.05])
def test_half_a_second_at_rest_forgets_the_way_before_it(
    rest_samples: int, rest_mps: float, is_forgotten: bool
) -> None:
    """0.48 m by the speed at one place, rest, and 0.04 m more."""
    checked = check()
    speeds_mps = [0.0, *[0.4] * 120, *[rest_mps] * rest_samples, *[0.4] * 10]
    states = (still(tick * PERIOD_NS, speed_mps=speed_mps) for tick, speed_mps in enumerate(speeds_mps))
    assert all(checked.is_plausible(state, pose_valid=True) for state in states) is is_forgotten


def test_time_at_rest_counts_from_the_last_motion() -> None:
    checked = check()
    speeds_mps = [0.0, *[0.4] * 120, *[0.0] * 30, 0.4, *[0.0] * 49, *[0.4] * 10]
    states = (still(tick * PERIOD_NS, speed_mps=speed_mps) for tick, speed_mps in enumerate(speeds_mps))
    assert not all(checked.is_plausible(state, pose_valid=True) for state in states)


def test_time_at_rest_counts_from_where_the_position_changed_last() -> None:
    checked = check()
    states = [still(tick * PERIOD_NS) for tick in range(200)]
    speeds_mps = [*[0.4] * 122, *[0.0] * 49, *[0.4] * 10]
    states += [still((200 + tick) * PERIOD_NS, x_m=0.1, speed_mps=speed) for tick, speed in enumerate(speeds_mps)]
    assert not all(checked.is_plausible(state, pose_valid=True) for state in states)


def test_a_speed_that_is_0_now_and_then_does_not_hide_a_frozen_position() -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=0.0 if tick % 40 == 0 else 0.3) for tick in range(400))
    assert not all(checked.is_plausible(state, pose_valid=True) for state in samples)


def test_time_above_the_speed_counts_only_while_it_is_above_it() -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=0.6 if tick % 9 else 0.1) for tick in range(300))
    believed = [checked.is_plausible(state, pose_valid=True) for state in samples]
    assert 85 <= believed.index(False) <= 95  # by its way alone


@pytest.mark.parametrize(("speed_mps", "is_seen"), [(0.05, False), (0.051, True), (-0.051, True)])
def test_a_frozen_slow_vehicle_is_distinguished_from_a_sensor_with_an_offset(speed_mps: float, is_seen: bool) -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=speed_mps) for tick in range(1_000))
    assert all(checked.is_plausible(state, pose_valid=True) for state in samples) is not is_seen


def test_a_sample_that_is_looked_at_twice_counts_once() -> None:
    checked = check()
    for tick in range(9):
        for _ in range(2):
            assert checked.is_plausible(still(tick * PERIOD_NS, speed_mps=5.0), pose_valid=True)
    assert not checked.is_plausible(still(9 * PERIOD_NS, speed_mps=5.0), pose_valid=True)


def test_without_a_valid_pose_only_the_rest_is_looked_at() -> None:
    checked, states = check(), drive(3)
    checked.is_plausible(states[0], pose_valid=True)
    assert checked.is_plausible(replace(states[1], x_m=500.0), pose_valid=False)
    assert not checked.is_plausible(replace(states[2], speed_mps=9.0), pose_valid=False)


def test_an_invalid_pose_is_no_place_that_a_later_one_could_have_jumped_from() -> None:
    checked, states = check(), drive(2)
    assert checked.is_plausible(states[0], pose_valid=False)
    assert checked.is_plausible(replace(states[1], x_m=300.0), pose_valid=True)


@pytest.mark.parametrize(("frame_id", "pose_valid"), [("map", False), ("odom", True), ("odom", False)])
def test_a_jump_is_seen_past_samples_without_a_valid_pose_and_in_another_frame(frame_id: str, pose_valid: bool) -> None:
    checked, states = check(), drive(5)
    checked.is_plausible(states[0], pose_valid=True)
    there = [replace(state, x_m=60.0) for state in states]
    assert checked.is_plausible(replace(there[1], frame_id=frame_id), pose_valid=pose_valid)
    assert not checked.is_plausible(there[2], pose_valid=True)
    assert not checked.is_plausible(replace(there[3], x_m=-60.0, heading_rad=3.0), pose_valid=True)
    assert checked.is_plausible(states[4], pose_valid=True)
    assert doubts(checked) == {PlausibilityFault.JUMP.value: 2}


def test_a_speed_that_jumps_does_so_in_any_frame_of_reference() -> None:
    checked, states = check(), drive(2)
    checked.is_plausible(states[0], pose_valid=True)
    assert not checked.is_plausible(replace(states[1], speed_mps=9.0, frame_id="odom"), pose_valid=True)


@pytest.mark.parametrize(
    ("x_m", "heading_rad", "believed"),
    [(20.0, 0.0, True), (20.49, 0.0, True), (20.51, 0.0, False), (0.0, 0.999, True), (0.0, 1.01, False)],
)
def test_without_a_valid_pose_the_vehicle_went_as_far_and_turned_as_much_as_at_its_fastest_then(
    x_m: float, heading_rad: float, believed: bool
) -> None:
    """A second without, in which it was at 20 m/s and turned by 0.8 rad/s."""
    checked = check()
    checked.is_plausible(still(), pose_valid=True)
    for tick in range(1, 100):
        speed_mps = 0.5 * min(tick, 40, 100 - tick)
        assert checked.is_plausible(still(tick * PERIOD_NS, speed_mps=speed_mps, yaw_rate_radps=-0.8), pose_valid=False)
    assert checked.is_plausible(still(ms(1000), x_m=x_m, heading_rad=heading_rad), pose_valid=True) is believed


def test_the_speed_before_an_accepted_position_does_not_count_after_it() -> None:
    checked = check()
    checked.is_plausible(still(), pose_valid=True)
    checked.is_plausible(still(PERIOD_NS, speed_mps=0.9, yaw_rate_radps=0.79), pose_valid=False)
    checked.is_plausible(still(2 * PERIOD_NS), pose_valid=True)
    assert not checked.is_plausible(still(ms(401), x_m=0.501), pose_valid=True)
    assert not checked.is_plausible(still(ms(402), heading_rad=0.201), pose_valid=True)


def test_a_position_that_is_accepted_again_is_the_reference_from_then_on() -> None:
    checked, states = check(), drive(ACCEPTED_AGAIN + 4)
    checked.is_plausible(states[0], pose_valid=True)
    there = [replace(state, x_m=state.x_m + 50.0) for state in states]
    for state in there[1 : ACCEPTED_AGAIN + 1]:
        assert not checked.is_plausible(state, pose_valid=True)
    assert checked.is_plausible(there[ACCEPTED_AGAIN + 1], pose_valid=True)
    assert not checked.is_plausible(states[ACCEPTED_AGAIN + 2], pose_valid=True)
    assert checked.is_plausible(there[ACCEPTED_AGAIN + 3], pose_valid=True)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x_m": 60.0}, "jumped: moved_m = 60, limit 0.65"),
        ({"heading_rad": -3.0}, "jumped: turned_rad = 3, limit 0.2"),
        ({"speed_mps": -3.0}, "jumped: speed_change_mps = 8, limit 1.1"),
        ({"speed_mps": 41.5}, "out of range: speed_mps = 41.5, limit 40"),
        ({"speed_mps": -41.5}, "out of range: speed_mps = 41.5, limit 40"),
        ({"yaw_rate_radps": -3.5}, "out of range: yaw_rate_radps = 3.5, limit 3"),
        ({"accel_mps2": -21.0}, "out of range: accel_mps2 = 21, limit 20"),
        ({"yaw_rate_radps": 3.5}, "out of range: yaw_rate_radps = 3.5, limit 3"),
        ({"yaw_rate_radps": -2.5}, "disagree: yaw_rate_difference_radps = 2.5, limit 0.8"),
        ({"stamp_ns": -ms(20)}, "out of order: older_s = 0.02, limit 0"),
    ],
)
def test_a_persistent_fault_is_logged_once_with_value_limit_and_place(
    change: dict[str, Any], said: str, caplog: pytest.LogCaptureFixture
) -> None:
    checked, states = check(), drive(4)
    checked.is_plausible(states[0], pose_valid=True)
    for _ in range(5):
        assert not checked.is_plausible(replace(states[3], **change), pose_valid=True)
    place = "x_m = 60, y_m = 0" if "x_m" in change else "x_m = 0.15, y_m = 0"
    assert caplog.messages == [f"3 implausible samples in a row; the last one, at {place}: {said}"]


@pytest.mark.parametrize(
    ("speed_mps", "said"), [(5.0, "frozen: still_s = 0.11, limit 0.09"), (0.4, "frozen: still_m = 0.512, limit 0.5")]
)
def test_time_and_distance_of_frozen_values_are_logged(
    speed_mps: float, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    checked = check()
    for tick in range(150):
        checked.is_plausible(still(tick * PERIOD_NS, speed_mps=speed_mps), pose_valid=True)
    assert [message.partition(": ")[2] for message in caplog.messages] == [said]


def test_another_frame_of_reference_or_a_long_gap_resets_the_check() -> None:
    checked, states = check(), drive(3)
    checked.is_plausible(states[0], pose_valid=True)
    assert checked.is_plausible(replace(states[1], x_m=500.0, frame_id="odom"), pose_valid=True)
    later = replace(states[2], stamp_ns=states[1].stamp_ns + ms(501), x_m=-500.0, frame_id="odom")
    assert checked.is_plausible(later, pose_valid=True)
    checked.reset()
    assert checked.is_plausible(replace(later, stamp_ns=later.stamp_ns + PERIOD_NS, x_m=0.0), pose_valid=True)


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-1e6, 1e6), st.floats(-4, 4), st.integers(-(10**9), 10**10))))
def test_every_sample_is_accepted_or_counted_once(rows: list[tuple[float, float, float, int]]) -> None:
    checked = check()
    believed = 0
    for speed_mps, x_m, heading_rad, stamp_ns in rows:
        state = VehicleState(stamp_ns=stamp_ns, x_m=x_m, y_m=0.0, heading_rad=heading_rad, speed_mps=speed_mps)
        believed += checked.is_plausible(state, pose_valid=True)
    assert believed + sum(checked.counts.values()) == len(rows)


LIMITS = reference().profile.plausibility


def still(stamp_ns: int = 0, /, **numbers: Any) -> VehicleState:
    return replace(VehicleState(stamp_ns=stamp_ns, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0), **numbers)


@pytest.mark.parametrize(
    "numbers",
    [
        {"speed_mps": LIMITS.speed_mps},
        {"accel_mps2": LIMITS.accel_mps2},
        {"yaw_rate_radps": LIMITS.yaw_rate_tolerance_radps},
        {
            "yaw_rate_radps": LIMITS.yaw_rate_radps,
            "speed_mps": 10.0,
            "front_wheel_angle_rad": math.atan(LIMITS.yaw_rate_radps * WHEELBASE_M / 10.0),
        },
    ],
)
def test_values_exactly_at_a_limit_are_accepted(numbers: dict[str, float]) -> None:
    assert check().is_plausible(still(**numbers), pose_valid=True)


@pytest.mark.parametrize(
    "numbers",
    [
        {"speed_mps": LIMITS.speed_tolerance_mps},
        {"x_m": LIMITS.position_tolerance_m},
        {"heading_rad": LIMITS.heading_tolerance_rad},
    ],
)
def test_two_samples_of_one_instant_may_lie_apart_by_exactly_what_is_written(numbers: dict[str, float]) -> None:
    checked = check()
    assert checked.is_plausible(still(), pose_valid=True)
    assert checked.is_plausible(still(**numbers), pose_valid=True)


def test_the_wheels_turn_the_vehicle_by_their_tangent() -> None:
    yaw_radps = 5.0 * math.tan(0.5) / WHEELBASE_M + 0.79
    turning = still(speed_mps=5.0, front_wheel_angle_rad=0.5, yaw_rate_radps=yaw_radps)
    assert check().is_plausible(turning, pose_valid=True)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("faster", [0, 1])
@pytest.mark.parametrize(
    ("rate", "place", "value", "way"), [("speed_mps", "x_m", 5.0, 1.5), ("yaw_rate_radps", "heading_rad", 0.7, 0.4)]
)
def test_between_two_samples_a_vehicle_may_have_moved_at_the_faster_one_of_both(
    rate: str, place: str, value: float, way: float, faster: int, sign: float
) -> None:
    checked, rates = check(), [0.0, 0.0]
    rates[faster] = sign * value
    assert checked.is_plausible(still(**{rate: rates[0]}), pose_valid=True)
    assert checked.is_plausible(still(ms(400), **{rate: rates[1], place: sign * way}), pose_valid=True)


@pytest.mark.parametrize(("gap_ns", "believed"), [(ms(500), False), (ms(500) + 1, True)])
def test_the_history_is_reset_after_half_a_second_to_the_nanosecond(gap_ns: int, believed: bool) -> None:
    checked = check()
    checked.is_plausible(still(), pose_valid=True)
    assert checked.is_plausible(still(gap_ns, x_m=100.0), pose_valid=True) is believed


def test_a_sample_from_the_past_does_not_make_the_next_gap_longer() -> None:
    checked = check()
    assert checked.is_plausible(still(ms(1000)), pose_valid=True)
    assert not checked.is_plausible(still(ms(600)), pose_valid=True)
    assert not checked.is_plausible(still(ms(1200), x_m=100.0), pose_valid=True)


def test_consecutive_implausible_samples_are_counted_from_the_start_and_after_a_reset() -> None:
    checked, bad = check(), still(speed_mps=LIMITS.speed_mps + 1.0)
    for _ in range(2):
        persists = []
        for _ in range(3):
            assert not checked.is_plausible(bad, pose_valid=True)
            persists.append(checked.is_persistent(since_ns=0))
        assert persists == [False, False, True]
        checked.reset()
        assert not checked.is_persistent(since_ns=0)
