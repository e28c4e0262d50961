"""The car's laws: which way is left, how tight it turns, and that brakes only ever stop it."""

import itertools
import math
from dataclasses import asdict

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vehicle_iface.errors import InvalidValueError
from vehicle_iface.sim.model import Actuation, Bicycle, BicycleParameters, BicycleState
from vehicle_iface.status import Gear

L_M = BicycleParameters().wheelbase_m


def rolling(speed_mps: float, **more: float) -> Bicycle:
    return Bicycle(state=BicycleState(speed_mps=speed_mps, **more))


def drive(car: Bicycle, seconds: float, actuation: Actuation, step_s: float = 0.01) -> list[BicycleState]:
    return [car.step(step_s, actuation) for _ in range(round(seconds / step_s))]


def cruise(angle_rad: float = 0.0, rear_rad: float = 0.0, gear: Gear = Gear.DRIVE) -> Actuation:
    return Actuation(gear=gear, accel_mps2=0.0, front_wheel_angle_rad=angle_rad, rear_wheel_angle_rad=rear_rad)


def test_a_left_turn_is_positive_in_wheel_angle_yaw_rate_heading_and_y() -> None:
    state = drive(rolling(5.0), 1.0, cruise(0.2))[-1]
    assert state.front_wheel_angle_rad > 0.0
    assert state.yaw_rate_radps > 0.0
    assert state.heading_rad > 0.0
    assert state.y_m > 0.0


def test_reversing_with_wheels_to_the_left_turns_the_heading_to_the_right() -> None:
    state = drive(rolling(-2.0), 1.0, cruise(0.2, gear=Gear.REVERSE))[-1]
    assert state.x_m < 0.0
    assert state.yaw_rate_radps < 0.0
    assert state.heading_rad < 0.0
    assert state.y_m > 0.0  # backwards along a heading that points to the right


@pytest.mark.parametrize(("angle_rad", "speed_mps"), [(0.1, 5.0), (-0.3, 3.0), (0.7, 1.0), (0.3, -3.0)])
def test_a_circle_of_radius_wheelbase_by_tangent_closes(angle_rad: float, speed_mps: float) -> None:
    radius_m = L_M / math.tan(angle_rad)
    car = rolling(speed_mps, front_wheel_angle_rad=angle_rad)
    lap_s = abs(math.tau * radius_m / speed_mps)
    gear = Gear.DRIVE if speed_mps > 0 else Gear.REVERSE
    half = drive(car, lap_s / 2, cruise(angle_rad, gear=gear), lap_s / 1000)[-1]
    assert half.x_m == pytest.approx(0.0, abs=1e-6)
    assert half.y_m == pytest.approx(2 * radius_m, abs=1e-6)
    whole = drive(car, lap_s / 2, cruise(angle_rad, gear=gear), lap_s / 1000)[-1]
    assert (whole.x_m, whole.y_m) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert math.remainder(whole.heading_rad, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_both_axles_steered_alike_move_the_car_sideways_without_turning() -> None:
    car = rolling(2.0, front_wheel_angle_rad=0.1, rear_wheel_angle_rad=0.1)
    state = drive(car, 1.0, cruise(0.1, 0.1))[-1]
    assert state.yaw_rate_radps == 0.0
    assert state.lateral_speed_mps == pytest.approx(2.0 * math.tan(0.1))
    assert (state.x_m, state.y_m) == pytest.approx((2.0, 2.0 * math.tan(0.1)))


def test_the_rear_axle_moves_sideways_only_when_its_wheels_are_steered() -> None:
    assert drive(rolling(5.0), 1.0, cruise(0.3))[-1].lateral_speed_mps == 0.0
    left = drive(rolling(5.0), 1.0, cruise(0.0, 0.1))[-1]
    assert left.lateral_speed_mps > 0.0
    assert left.yaw_rate_radps < 0.0


@given(front=st.floats(-0.7, 0.7), rear=st.floats(-0.2, 0.2), speed=st.floats(-10, 20), heading=st.floats(-3, 3))
@settings(max_examples=50, deadline=None)
def test_the_pose_moves_by_speed_lateral_speed_and_yaw_rate(
    front: float, rear: float, speed: float, heading: float
) -> None:
    car = rolling(speed, front_wheel_angle_rad=front, rear_wheel_angle_rad=rear, heading_rad=heading)
    before = car.state
    after = car.step(1e-4, cruise(front, rear, Gear.DRIVE if speed >= 0 else Gear.REVERSE))
    dx_m, dy_m = after.x_m - before.x_m, after.y_m - before.y_m
    cos, sin = math.cos(heading), math.sin(heading)
    assert dx_m * cos + dy_m * sin == pytest.approx(after.speed_mps * 1e-4, abs=1e-6)
    assert dy_m * cos - dx_m * sin == pytest.approx(after.lateral_speed_mps * 1e-4, abs=1e-6)
    turned = math.remainder(after.heading_rad - heading, math.tau)
    assert turned == pytest.approx(after.yaw_rate_radps * 1e-4, abs=1e-9)


def test_steering_lags_by_a_tenth_of_a_second_and_turns_no_faster_than_its_rate() -> None:
    small = drive(Bicycle(), 0.1, cruise(0.05), 0.001)[-1]
    assert small.front_wheel_angle_rad == pytest.approx(0.05 * (1 - math.exp(-1)), rel=1e-6)
    states = drive(Bicycle(), 2.0, cruise(0.7), 0.001)
    angles = [0.0] + [state.front_wheel_angle_rad for state in states]
    assert max(b - a for a, b in itertools.pairwise(angles)) <= 0.001 + 1e-12
    assert angles[500] == pytest.approx(0.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_wheels_stop_at_their_limits(sign: float) -> None:
    state = drive(Bicycle(), 5.0, cruise(sign * 3.0, sign * 3.0))[-1]
    assert state.front_wheel_angle_rad == pytest.approx(sign * 0.7)
    assert abs(state.front_wheel_angle_rad) <= 0.7
    assert abs(state.rear_wheel_angle_rad) <= 0.2


def test_acceleration_lags_by_a_tenth_of_a_second_and_stays_within_its_limits() -> None:
    car = rolling(5.0)
    state = drive(car, 0.1, Actuation(gear=Gear.DRIVE, accel_mps2=2.0))[-1]
    assert state.accel_mps2 == pytest.approx(2.0 * (1 - math.exp(-1)), rel=1e-6)
    assert drive(car, 1.0, Actuation(gear=Gear.DRIVE, accel_mps2=99.0))[-1].accel_mps2 <= 4.0
    assert drive(rolling(30.0), 1.0, Actuation(gear=Gear.DRIVE, accel_mps2=-99.0))[-1].accel_mps2 >= -8.0


def test_the_engine_goes_no_faster_than_its_limit() -> None:
    states = drive(rolling(39.5), 3.0, Actuation(gear=Gear.DRIVE, accel_mps2=4.0))
    assert states[-1].speed_mps < 41.0


@pytest.mark.parametrize(
    ("gear", "request_mps2", "sign"),
    [
        (Gear.DRIVE, 1.0, 1),
        (Gear.DRIVE, -1.0, 0),
        (Gear.REVERSE, -1.0, -1),
        (Gear.REVERSE, 1.0, 0),
        (Gear.NEUTRAL, 1.0, 0),
        (Gear.NEUTRAL, -1.0, 0),
        (Gear.PARK, 1.0, 0),
        (Gear.PARK, -1.0, 0),
    ],
)
def test_from_standstill_each_gear_moves_its_own_way_only(gear: Gear, request_mps2: float, sign: int) -> None:
    state = drive(Bicycle(), 1.0, Actuation(gear=gear, accel_mps2=request_mps2))[-1]
    assert math.copysign(1, state.speed_mps) * (state.speed_mps != 0) == sign
    if sign == 0:
        assert state == BicycleState()


def test_reversing_faster_is_a_negative_acceleration_and_braking_it_a_positive_one() -> None:
    car = Bicycle()
    assert drive(car, 2.0, Actuation(gear=Gear.REVERSE, accel_mps2=-1.0))[-1].accel_mps2 < 0.0
    state = drive(car, 0.5, Actuation(gear=Gear.REVERSE, accel_mps2=1.0))[-1]
    assert state.speed_mps < 0.0 < state.accel_mps2


@example(speed=0.0, brake=1.0, gear=Gear.REVERSE, hold=False, step_s=0.004)
@example(speed=-0.0, brake=1.0, gear=Gear.DRIVE, hold=False, step_s=0.004)
@given(
    speed=st.floats(-15, 30),
    brake=st.floats(0.05, 20),
    gear=st.sampled_from([Gear.DRIVE, Gear.NEUTRAL, Gear.REVERSE, Gear.PARK]),
    hold=st.booleans(),
    step_s=st.sampled_from([0.004, 0.01, 0.013, 0.1]),
)
@settings(max_examples=60, deadline=None)
def test_braking_never_reverses_and_ends_at_exactly_zero(
    speed: float, brake: float, gear: Gear, hold: bool, step_s: float
) -> None:
    forwards = math.copysign(1.0, speed) > 0.0  # a zero has a sign, too: the brake is against it
    opposes_gear = {Gear.DRIVE: forwards, Gear.REVERSE: not forwards}.get(gear, True)
    hold = hold or not opposes_gear  # else the engine takes over where the brake ends
    car = rolling(speed)
    actuation = Actuation(gear=gear, accel_mps2=-math.copysign(brake, speed), hold=hold)
    last = abs(speed)
    for _ in range(round(4.0 / step_s)):
        state = car.step(step_s, actuation)
        assert state.speed_mps * speed >= 0.0
        assert abs(state.speed_mps) <= last
        last = abs(state.speed_mps)
        if last == 0.0:
            assert state.accel_mps2 == 0.0
    if abs(speed) < brake and brake > 1.0:
        assert last == 0.0


@pytest.mark.parametrize("speed_mps", [10.0, -3.0])
def test_braking_at_three_takes_the_way_of_the_textbook_and_the_lag(speed_mps: float) -> None:
    car = rolling(speed_mps)
    gear = Gear.DRIVE if speed_mps > 0 else Gear.REVERSE
    end = drive(car, 5.0, Actuation(gear=gear, accel_mps2=-math.copysign(3.0, speed_mps)))[-1]
    assert end.speed_mps == 0.0
    assert end.accel_mps2 == 0.0
    assert abs(end.x_m) == pytest.approx(speed_mps**2 / 6 + abs(speed_mps) * 0.1, abs=0.05)


def test_a_vehicle_released_in_drive_rolls_on_and_slows_only_by_its_resistance() -> None:
    states = drive(rolling(5.0), 10.0, Actuation(gear=Gear.DRIVE))
    assert states[-1].speed_mps == pytest.approx(4.0)
    assert states[-1].accel_mps2 == pytest.approx(-0.1)


def test_a_zero_request_in_drive_keeps_the_speed() -> None:
    assert drive(rolling(5.0), 10.0, cruise())[-1].speed_mps == pytest.approx(5.0)


def test_park_holds_and_its_pawl_stops_a_slow_vehicle() -> None:
    state = drive(rolling(0.4), 0.2, Actuation(gear=Gear.PARK))[-1]
    assert state.speed_mps == 0.0
    assert drive(Bicycle(state=state), 1.0, Actuation(gear=Gear.PARK))[-1].x_m == state.x_m


@pytest.mark.parametrize("speed_mps", [0.002, -0.002, 0.04])
def test_a_held_vehicle_comes_to_rest_even_when_the_request_is_zero(speed_mps: float) -> None:
    car = rolling(speed_mps)
    states = drive(car, 1.0, Actuation(gear=Gear.DRIVE, accel_mps2=0.0, hold=True))
    assert states[-1].speed_mps == 0.0
    assert drive(car, 1.0, Actuation(gear=Gear.DRIVE, accel_mps2=2.0, hold=True))[-1] == states[-1]


def test_taking_the_gear_out_cuts_the_engine_at_once() -> None:
    car = rolling(3.0)
    drive(car, 1.0, Actuation(gear=Gear.DRIVE, accel_mps2=2.0))
    assert car.step(0.001, Actuation(gear=Gear.NEUTRAL, accel_mps2=2.0)).accel_mps2 <= 0.0


def test_changing_to_drive_while_rolling_back_brakes_first_and_then_drives() -> None:
    states = drive(rolling(-0.4), 2.0, Actuation(gear=Gear.DRIVE, accel_mps2=1.0))
    speeds = [state.speed_mps for state in states]
    assert speeds == sorted(speeds)
    assert speeds[-1] > 0.5


def test_ten_steps_of_a_centisecond_are_one_of_a_decisecond() -> None:
    actuation = Actuation(gear=Gear.DRIVE, accel_mps2=1.0, front_wheel_angle_rad=0.3)
    ten, one = rolling(3.0), rolling(3.0)
    for _ in range(10):
        ten.step(0.01, actuation)
    one.step(0.1, actuation)
    assert asdict(ten.state) == pytest.approx(asdict(one.state), abs=1e-12)


def test_no_time_changes_nothing() -> None:
    car = rolling(3.0)
    before = car.state
    assert car.step(0.0, Actuation(gear=Gear.DRIVE, accel_mps2=1.0)) == before


@pytest.mark.parametrize(
    "bad",
    [
        lambda: Actuation(accel_mps2=math.nan),
        lambda: Actuation(front_wheel_angle_rad=math.inf),
        lambda: Actuation(gear=Gear.NO_REQUEST),
        lambda: BicycleState(speed_mps=math.nan),
        lambda: BicycleParameters(wheelbase_m=0.0),
        lambda: BicycleParameters(front_wheel_angle_limit_rad=1.6),
        lambda: Bicycle().step(-0.01, Actuation()),
        lambda: Bicycle().step(math.nan, Actuation()),
    ],
)
def test_numbers_that_no_car_has_are_refused(bad: object) -> None:
    with pytest.raises(InvalidValueError):
        bad()  # type: ignore[operator]


def test_a_car_without_rear_steering_is_a_legal_car() -> None:
    car = Bicycle(BicycleParameters(rear_wheel_angle_limit_rad=0.0), BicycleState(speed_mps=1.0))
    assert drive(car, 1.0, cruise(0.0, 0.5))[-1].rear_wheel_angle_rad == 0.0
