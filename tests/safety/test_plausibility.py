"""What can be true of a vehicle, and what cannot."""

import math
from dataclasses import replace

import pytest
from harness import ms, reference
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import VehicleState
from vehicle_iface.safety.plausibility import BELIEVED_AGAIN, Doubt, PlausibilityCheck

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
    return {name: count for name, count in checked.found.items() if count}


@given(st.floats(-20.0, 20.0), st.floats(-0.6, 0.6), st.lists(st.integers(0, ms(40)), max_size=60))
def test_a_vehicle_that_drives_as_vehicles_do_is_believed_however_its_samples_come(
    speed_mps: float, front_rad: float, delays_ns: list[int]
) -> None:
    if abs(speed_mps * math.tan(front_rad) / WHEELBASE_M) > 3.0:
        front_rad = 0.0
    checked, came_ns = check(), 0
    for state, delay_ns in zip(drive(60, speed_mps, front_rad), delays_ns, strict=False):
        came_ns = max(came_ns, state.stamp_ns + delay_ns)
        assert checked.believes(replace(state, stamp_ns=came_ns), pose_valid=True)
    assert doubts(checked) == {}


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        ({"speed_mps": 40.1}, Doubt.RANGE),
        ({"speed_mps": -40.1}, Doubt.RANGE),
        ({"accel_mps2": -20.1}, Doubt.RANGE),
        ({"yaw_rate_radps": 3.1}, Doubt.RANGE),
        ({"yaw_rate_radps": -3.1}, Doubt.RANGE),
        ({"yaw_rate_radps": 0.81}, Doubt.DISAGREEMENT),
        ({"yaw_rate_radps": -0.81}, Doubt.DISAGREEMENT),
        ({"front_wheel_angle_rad": 0.5}, Doubt.DISAGREEMENT),
        ({"speed_mps": 5.71}, Doubt.JUMP),
        ({"speed_mps": 4.29}, Doubt.JUMP),
        ({"x_m": 1.06}, Doubt.JUMP),
        ({"y_m": -0.6}, Doubt.JUMP),
        ({"heading_rad": 0.21}, Doubt.JUMP),
        ({"heading_rad": -0.21}, Doubt.JUMP),
        ({"heading_rad": math.pi}, Doubt.JUMP),
        ({"stamp_ns": ms(89)}, Doubt.ORDER),
    ],
)
def test_what_no_vehicle_does_is_dropped_and_counted_by_its_kind(change: dict[str, float], doubt: Doubt) -> None:
    checked, states = check(), drive(12)
    assert all(checked.believes(state, pose_valid=True) for state in states[:10])
    assert not checked.believes(replace(states[10], **change), pose_valid=True)
    assert doubts(checked) == {doubt.value: 1}
    assert checked.believes(states[11], pose_valid=True)
    assert not checked.persists(since_ns=0)


@pytest.mark.parametrize(
    "change",
    [{"speed_mps": 5.69}, {"x_m": 0.99}, {"heading_rad": 0.19}, {"yaw_rate_radps": 0.79}, {"accel_mps2": 19.9}],
)
def test_what_a_vehicle_may_do_is_believed(change: dict[str, float]) -> None:
    checked, states = check(), drive(12)
    assert all(checked.believes(state, pose_valid=True) for state in states[:10])
    assert checked.believes(replace(states[10], **change), pose_valid=True)


def test_the_third_in_a_row_persists_and_a_good_one_ends_it() -> None:
    checked, states = check(), drive(10)
    checked.believes(states[0], pose_valid=True)
    seen = []
    for state in states[1:4]:
        assert not checked.believes(replace(state, x_m=50.0), pose_valid=True)
        seen.append(checked.persists(since_ns=state.stamp_ns))
    assert seen == [False, False, True]
    assert not checked.persists(since_ns=states[3].stamp_ns + 1)
    assert checked.believes(states[4], pose_valid=True)
    assert not checked.persists(since_ns=0)


def test_after_a_jump_that_stays_the_new_place_is_believed_in_the_end() -> None:
    checked, states = check(), drive(2 * BELIEVED_AGAIN)
    checked.believes(states[0], pose_valid=True)
    there = [replace(state, x_m=state.x_m + 50.0) for state in states[1:]]
    believed = [checked.believes(state, pose_valid=True) for state in there]
    assert believed == [False] * 100 + [True] * (len(there) - 100)


def test_a_jump_before_does_not_count_for_the_place_that_is_believed_in_the_end() -> None:
    checked, states = check(), drive(2 * BELIEVED_AGAIN)
    there = [replace(state, x_m=state.x_m + 50.0) for state in states]
    believed = [checked.believes(state, pose_valid=True) for state in [states[0], there[1], states[2], *there[3:]]]
    assert believed == [True, False, True] + [False] * 100 + [True] * (len(believed) - 103)


def test_what_stood_before_forgetting_is_not_frozen_after_it() -> None:
    checked = check()
    for first_ns in (0, ms(90)):
        for tick in range(9):
            assert checked.believes(still(first_ns + tick * PERIOD_NS, speed_mps=5.0), pose_valid=True)
        checked.forget()


def test_positions_that_jump_about_are_never_believed() -> None:
    checked, states = check(), drive(300)
    checked.believes(states[0], pose_valid=True)
    for number, state in enumerate(states[1:]):
        assert not checked.believes(replace(state, x_m=100.0 * (number % 2 + 1)), pose_valid=True)


@pytest.mark.parametrize("speed_mps", [-5.0, 5.0])
def test_a_position_that_stands_while_the_speed_says_otherwise_is_frozen(speed_mps: float) -> None:
    checked, states = check(), drive(40, speed_mps)
    frozen = [replace(state, x_m=0.0) for state in states]
    believed = [checked.believes(state, pose_valid=True) for state in frozen]
    assert believed == [True] * 10 + [False] * 30
    assert doubts(checked) == {Doubt.FROZEN.value: 30}


@pytest.mark.parametrize(
    ("speed_mps", "believed"),
    [(20.0, 4), (6.0, 10), (0.51, 10), (0.5, 102), (-0.5, 102), (-0.51, 10), (0.25, 202)],
)
def test_a_frozen_position_is_found_out_by_its_way_where_it_is_fast_or_slow_and_else_by_its_time(
    speed_mps: float, believed: int
) -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=speed_mps) for tick in range(300))
    assert [checked.believes(state, pose_valid=True) for state in samples].index(False) == believed


@given(st.floats(-20.0, 20.0), st.floats(-math.pi, math.pi), st.floats(0.0, 0.004))
def test_however_slowly_a_vehicle_moves_and_however_coarsely_it_says_so_it_is_not_frozen(
    speed_mps: float, heading_rad: float, start_m: float
) -> None:
    """The reference vehicle tells its position in steps of 5 mm, its speed in steps of 5 mm/s."""
    checked = check()
    for tick in range(400):
        way_m = start_m + speed_mps * tick * 0.01
        x_m, y_m = (round(way_m * part / 0.005) * 0.005 for part in (math.cos(heading_rad), math.sin(heading_rad)))
        told = still(tick * PERIOD_NS, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=round(speed_mps, 2))
        assert checked.believes(told, pose_valid=True)


@pytest.mark.parametrize("brake_mps2", [0.5, 3.0, 6.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.1])
def test_a_vehicle_that_comes_to_a_stop_and_whose_speed_lags_behind_is_not_frozen(
    brake_mps2: float, lag_s: float
) -> None:
    checked, x_m, speed_mps, told_mps = check(), 0.0, 2.0, 2.0
    for tick in range(600):
        told_mps += (speed_mps - told_mps) * (0.01 / lag_s if lag_s else 1.0)
        told = still(tick * PERIOD_NS, x_m=round(x_m / 0.005) * 0.005, speed_mps=round(told_mps / 0.005) * 0.005)
        assert checked.believes(told, pose_valid=True)
        speed_mps = max(0.0, speed_mps - brake_mps2 * 0.01)
        x_m += speed_mps * 0.01


@pytest.mark.parametrize("offset_mps", [0.0, 0.005, -0.05])
def test_a_vehicle_that_stands_may_send_the_same_for_ever_and_then_drive_on(offset_mps: float) -> None:
    checked = check()
    for tick in range(30_000):
        assert checked.believes(still(tick * PERIOD_NS, x_m=1.0, speed_mps=offset_mps), pose_valid=True)
    for tick in range(300):
        speed_mps, x_m = 0.01 * tick, 1.0 + 0.00005 * tick**2
        told = still((30_000 + tick) * PERIOD_NS, x_m=round(x_m / 0.005) * 0.005, speed_mps=speed_mps)
        assert checked.believes(told, pose_valid=True)


def test_time_above_the_speed_counts_only_while_it_is_above_it() -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=0.6 if tick % 9 else 0.1) for tick in range(300))
    believed = [checked.believes(state, pose_valid=True) for state in samples]
    assert 85 <= believed.index(False) <= 95  # by its way alone


@pytest.mark.parametrize(("speed_mps", "is_seen"), [(0.05, False), (0.051, True), (-0.051, True)])
def test_a_slow_vehicle_that_is_frozen_is_told_from_a_sensor_with_an_offset(speed_mps: float, is_seen: bool) -> None:
    checked = check()
    samples = (still(tick * PERIOD_NS, speed_mps=speed_mps) for tick in range(1_000))
    assert all(checked.believes(state, pose_valid=True) for state in samples) is not is_seen


def test_a_sample_that_is_looked_at_twice_counts_once() -> None:
    checked = check()
    for tick in range(9):
        for _ in range(2):
            assert checked.believes(still(tick * PERIOD_NS, speed_mps=5.0), pose_valid=True)
    assert not checked.believes(still(9 * PERIOD_NS, speed_mps=5.0), pose_valid=True)


def test_without_a_valid_pose_only_the_rest_is_looked_at() -> None:
    checked, states = check(), drive(3)
    checked.believes(states[0], pose_valid=True)
    assert checked.believes(replace(states[1], x_m=500.0), pose_valid=False)
    assert not checked.believes(replace(states[2], speed_mps=9.0), pose_valid=False)


@pytest.mark.parametrize(("frame_id", "pose_valid"), [("map", False), ("odom", True), ("odom", False)])
def test_a_jump_is_seen_past_samples_without_a_valid_pose_and_in_another_frame(frame_id: str, pose_valid: bool) -> None:
    checked, states = check(), drive(5)
    checked.believes(states[0], pose_valid=True)
    there = [replace(state, x_m=60.0) for state in states]
    assert checked.believes(replace(there[1], frame_id=frame_id), pose_valid=pose_valid)
    assert not checked.believes(there[2], pose_valid=True)
    assert not checked.believes(replace(there[3], x_m=-60.0, heading_rad=3.0), pose_valid=True)
    assert checked.believes(states[4], pose_valid=True)
    assert doubts(checked) == {Doubt.JUMP.value: 2}


def test_a_speed_that_jumps_does_so_in_any_frame_of_reference() -> None:
    checked, states = check(), drive(2)
    checked.believes(states[0], pose_valid=True)
    assert not checked.believes(replace(states[1], speed_mps=9.0, frame_id="odom"), pose_valid=True)


@pytest.mark.parametrize(
    ("x_m", "heading_rad", "believed"),
    [(20.0, 0.0, True), (20.49, 0.0, True), (20.51, 0.0, False), (0.0, 0.999, True), (0.0, 1.01, False)],
)
def test_without_a_valid_pose_the_vehicle_went_as_far_and_turned_as_much_as_at_its_fastest_then(
    x_m: float, heading_rad: float, believed: bool
) -> None:
    """A second without, in which it was at 20 m/s and turned by 0.8 rad/s."""
    checked = check()
    checked.believes(still(), pose_valid=True)
    for tick in range(1, 100):
        speed_mps = 0.5 * min(tick, 40, 100 - tick)
        assert checked.believes(still(tick * PERIOD_NS, speed_mps=speed_mps, yaw_rate_radps=-0.8), pose_valid=False)
    assert checked.believes(still(ms(1000), x_m=x_m, heading_rad=heading_rad), pose_valid=True) is believed


def test_what_a_place_was_reached_by_does_not_count_from_there_on() -> None:
    checked = check()
    checked.believes(still(), pose_valid=True)
    checked.believes(still(PERIOD_NS, speed_mps=0.9, yaw_rate_radps=0.79), pose_valid=False)
    checked.believes(still(2 * PERIOD_NS), pose_valid=True)
    assert not checked.believes(still(ms(401), x_m=0.501), pose_valid=True)
    assert not checked.believes(still(ms(402), heading_rad=0.201), pose_valid=True)


def test_a_place_that_was_believed_again_is_the_one_that_counts_then() -> None:
    checked, states = check(), drive(BELIEVED_AGAIN + 4)
    checked.believes(states[0], pose_valid=True)
    there = [replace(state, x_m=state.x_m + 50.0) for state in states]
    for state in there[1 : BELIEVED_AGAIN + 1]:
        assert not checked.believes(state, pose_valid=True)
    assert checked.believes(there[BELIEVED_AGAIN + 1], pose_valid=True)
    assert not checked.believes(states[BELIEVED_AGAIN + 2], pose_valid=True)
    assert checked.believes(there[BELIEVED_AGAIN + 3], pose_valid=True)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x_m": 60.0}, "jumped: moved_m = 60, limit 0.65"),
        ({"heading_rad": -3.0}, "jumped: turned_rad = 3, limit 0.2"),
        ({"speed_mps": -3.0}, "jumped: speed_change_mps = 8, limit 1.1"),
        ({"speed_mps": 41.5}, "out of range: speed_mps = 41.5, limit 40"),
        ({"accel_mps2": -21.0}, "out of range: accel_mps2 = 21, limit 20"),
        ({"yaw_rate_radps": 3.5}, "out of range: yaw_rate_radps = 3.5, limit 3"),
        ({"yaw_rate_radps": -2.5}, "disagree: yaw_rate_apart_radps = 2.5, limit 0.8"),
        ({"stamp_ns": -ms(20)}, "out of order: older_s = 0.02, limit 0"),
    ],
)
def test_what_persists_is_said_once_with_value_limit_and_place(
    change: dict[str, float], said: str, caplog: pytest.LogCaptureFixture
) -> None:
    checked, states = check(), drive(4)
    checked.believes(states[0], pose_valid=True)
    for _ in range(5):
        assert not checked.believes(replace(states[3], **change), pose_valid=True)
    place = "x_m = 60, y_m = 0" if "x_m" in change else "x_m = 0.15, y_m = 0"
    assert caplog.messages == [f"3 implausible samples in a row; the last one, at {place}: {said}"]


@pytest.mark.parametrize(
    ("speed_mps", "said"), [(5.0, "frozen: still_s = 0.11, limit 0.09"), (0.4, "frozen: still_m = 0.512, limit 0.5")]
)
def test_how_long_and_how_far_values_were_frozen_is_said(
    speed_mps: float, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    checked = check()
    for tick in range(150):
        checked.believes(still(tick * PERIOD_NS, speed_mps=speed_mps), pose_valid=True)
    assert [message.partition(": ")[2] for message in caplog.messages] == [said]


def test_another_frame_of_reference_and_a_long_gap_begin_anew() -> None:
    checked, states = check(), drive(3)
    checked.believes(states[0], pose_valid=True)
    assert checked.believes(replace(states[1], x_m=500.0, frame_id="odom"), pose_valid=True)
    later = replace(states[2], stamp_ns=states[1].stamp_ns + ms(501), x_m=-500.0, frame_id="odom")
    assert checked.believes(later, pose_valid=True)
    checked.forget()
    assert checked.believes(replace(later, stamp_ns=later.stamp_ns + PERIOD_NS, x_m=0.0), pose_valid=True)


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-1e6, 1e6), st.floats(-4, 4), st.integers(-(10**9), 10**10))))
def test_every_sample_is_believed_or_counted_once(rows: list[tuple[float, float, float, int]]) -> None:
    checked = check()
    believed = 0
    for speed_mps, x_m, heading_rad, stamp_ns in rows:
        state = VehicleState(stamp_ns=stamp_ns, x_m=x_m, y_m=0.0, heading_rad=heading_rad, speed_mps=speed_mps)
        believed += checked.believes(state, pose_valid=True)
    assert believed + sum(checked.found.values()) == len(rows)


LIMITS = reference().profile.plausibility


def still(stamp_ns: int = 0, **numbers: float) -> VehicleState:
    return replace(VehicleState(stamp_ns=stamp_ns, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0), **numbers)


@pytest.mark.parametrize(
    "numbers",
    [
        {"speed_mps": LIMITS.speed_mps},
        {"accel_mps2": LIMITS.accel_mps2},
        {"yaw_rate_radps": LIMITS.yaw_rate_apart_radps},
        {
            "yaw_rate_radps": LIMITS.yaw_rate_radps,
            "speed_mps": 10.0,
            "front_wheel_angle_rad": math.atan(LIMITS.yaw_rate_radps * WHEELBASE_M / 10.0),
        },
    ],
)
def test_what_is_exactly_at_a_limit_can_be_true(numbers: dict[str, float]) -> None:
    assert check().believes(still(**numbers), pose_valid=True)


@pytest.mark.parametrize(
    "numbers",
    [
        {"speed_mps": LIMITS.speed_apart_mps},
        {"x_m": LIMITS.position_apart_m},
        {"heading_rad": LIMITS.heading_apart_rad},
    ],
)
def test_two_samples_of_one_instant_may_lie_apart_by_exactly_what_is_written(numbers: dict[str, float]) -> None:
    checked = check()
    assert checked.believes(still(), pose_valid=True)
    assert checked.believes(still(**numbers), pose_valid=True)


def test_the_wheels_turn_the_vehicle_by_their_tangent() -> None:
    yaw_radps = 5.0 * math.tan(0.5) / WHEELBASE_M + 0.79
    turning = still(speed_mps=5.0, front_wheel_angle_rad=0.5, yaw_rate_radps=yaw_radps)
    assert check().believes(turning, pose_valid=True)


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
    assert checked.believes(still(**{rate: rates[0]}), pose_valid=True)
    assert checked.believes(still(ms(400), **{rate: rates[1], place: sign * way}), pose_valid=True)


@pytest.mark.parametrize(("gap_ns", "believed"), [(ms(500), False), (ms(500) + 1, True)])
def test_what_was_known_is_forgotten_after_half_a_second_to_the_nanosecond(gap_ns: int, believed: bool) -> None:
    checked = check()
    checked.believes(still(), pose_valid=True)
    assert checked.believes(still(gap_ns, x_m=100.0), pose_valid=True) is believed


def test_a_sample_from_the_past_does_not_make_the_next_gap_longer() -> None:
    checked = check()
    assert checked.believes(still(ms(1000)), pose_valid=True)
    assert not checked.believes(still(ms(600)), pose_valid=True)
    assert not checked.believes(still(ms(1200), x_m=100.0), pose_valid=True)


def test_implausible_samples_are_counted_in_a_row_from_the_start_and_anew_after_forgetting() -> None:
    checked, bad = check(), still(speed_mps=LIMITS.speed_mps + 1.0)
    for _ in range(2):
        persists = []
        for _ in range(3):
            assert not checked.believes(bad, pose_valid=True)
            persists.append(checked.persists(since_ns=0))
        assert persists == [False, False, True]
        checked.forget()
        assert not checked.persists(since_ns=0)
