"""The simulated vehicle of the bench is checked against commonroad-vehicle-models, with the data of a BMW 320i.

The oracle (Althoff et al., CommonRoad: Vehicle Models, 2020a) gets what the plant's actuators did, wheel rate and
acceleration in each millisecond, and integrates by itself (Runge-Kutta, 4th order). It obeys the plant's limits, so
that a plant that broke them would leave it behind.
"""

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from hil_bench.plant import Plant
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

ROOT = Path(__file__).resolve().parents[2]

STEP_S = 0.001
BMW = parameters_vehicle2()
WHEELBASE_M = BMW.a + BMW.b

POSITION_TOLERANCE_M = 0.02
"""Kinematic: the plant steers at the beginning of its millisecond, the oracle all through it: 1 cm after 100 m."""
HEADING_TOLERANCE_RAD = 0.001
SLIP_TOLERANCE = 0.012
"""Of the distance driven: at 2 m/s² the rear tyres of this car run 0.01 rad beside where they point."""
SLIP_HEADING_TOLERANCE_RAD = 0.02

Request = tuple[float, float, int]
"""Acceleration m/s², wheel angle rad, gear."""
Dynamics = Callable[[Sequence[float], Sequence[float], object], list[float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvre:
    """What is asked of the plant, by time."""

    asked: Callable[[float], Request]
    seconds: float
    speed_mps: float = 0.0
    heading_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Of the centre of the rear axle."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


MANOEUVRES = {
    "step to the left": Manoeuvre(asked=lambda t: (0.0, 0.1 if t > 1.0 else 0.0, 1), seconds=6.0, speed_mps=10.0),
    "step to the right": Manoeuvre(asked=lambda t: (0.0, -0.1 if t > 1.0 else 0.0, 1), seconds=6.0, speed_mps=10.0),
    "slalom": Manoeuvre(asked=lambda t: (0.5, 0.15 * math.sin(2.5 * t), 1), seconds=10.0, speed_mps=8.0),
    "circle and a half": Manoeuvre(asked=lambda _: (0.0, 0.25, 1), seconds=16.0, speed_mps=6.0, heading_rad=3.0),
    "full lock from standstill": Manoeuvre(asked=lambda _: (2.0, 0.7, 1), seconds=4.0),
    "brake to standstill": Manoeuvre(asked=lambda _: (-6.0, 0.1, 1), seconds=4.0, speed_mps=15.0),
    "reverse and brake": Manoeuvre(asked=lambda t: (-1.5 if t < 4.0 else 3.0, -0.3, -1), seconds=8.0),
}


def limited(plant: Plant) -> object:
    """The car's data with the plant's limits."""
    car = copy.deepcopy(BMW)
    car.steering.min, car.steering.max = -plant.wheel_limit_rad, plant.wheel_limit_rad
    car.steering.v_min, car.steering.v_max = -plant.wheel_rate_limit_radps, plant.wheel_rate_limit_radps
    car.longitudinal.a_max = plant.brake_limit_mps2
    car.longitudinal.v_switch = car.longitudinal.v_max
    return car


def driven(manoeuvre: Manoeuvre, plant: Plant) -> tuple[list[Pose], list[tuple[float, float]]]:
    """Where the plant was, and its wheel rate and acceleration, millisecond by millisecond."""
    plant.speed_mps, plant.heading_rad = manoeuvre.speed_mps, manoeuvre.heading_rad
    poses, inputs = [pose_of(plant)], []
    for tick in range(round(manoeuvre.seconds / STEP_S)):
        wheel_rad, speed_mps = plant.wheel_rad, plant.speed_mps
        accel_mps2, asked_rad, gear = manoeuvre.asked(tick * STEP_S)
        plant.step(STEP_S, accel_mps2=accel_mps2, wheel_rad=asked_rad, gear=gear, only_brake=False)
        inputs.append(((plant.wheel_rad - wheel_rad) / STEP_S, (plant.speed_mps - speed_mps) / STEP_S))
        poses.append(pose_of(plant))
    return poses, inputs


def pose_of(plant: Plant) -> Pose:
    return Pose(x_m=plant.x_m, y_m=plant.y_m, heading_rad=plant.heading_rad, speed_mps=plant.speed_mps)


def integrated(
    dynamics: Dynamics, state: list[float], inputs: Sequence[tuple[float, float]], car: object
) -> list[list[float]]:
    """States of the oracle, one more than inputs."""
    states = [state]
    for one in inputs:
        states.append(runge_kutta(dynamics, states[-1], one, car))
    return states


def runge_kutta(dynamics: Dynamics, state: list[float], one: tuple[float, float], car: object) -> list[float]:
    def moved(slope: Sequence[float], dt_s: float) -> list[float]:
        return [value + dt_s * rate for value, rate in zip(state, slope, strict=True)]

    k1 = dynamics(state, one, car)
    k2 = dynamics(moved(k1, STEP_S / 2), one, car)
    k3 = dynamics(moved(k2, STEP_S / 2), one, car)
    k4 = dynamics(moved(k3, STEP_S), one, car)
    return moved([(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)], STEP_S)


def kinematic(manoeuvre: Manoeuvre, inputs: Sequence[tuple[float, float]], car: object) -> list[Pose]:
    """`vehicle_dynamics_ks`: about the rear axle, as the plant is."""
    start = [0.0, 0.0, 0.0, manoeuvre.speed_mps, manoeuvre.heading_rad]
    states = integrated(vehicle_dynamics_ks, start, inputs, car)
    return [Pose(x_m=s[0], y_m=s[1], heading_rad=s[4], speed_mps=s[3]) for s in states]


def with_tyres(manoeuvre: Manoeuvre, inputs: Sequence[tuple[float, float]], car: object) -> list[Pose]:
    """`vehicle_dynamics_st`: about the centre of mass, with slip angles."""
    behind_m = BMW.b
    start = [behind_m, 0.0, 0.0, manoeuvre.speed_mps, 0.0, 0.0, 0.0]
    states = integrated(vehicle_dynamics_st, start, inputs, car)
    return [
        Pose(
            x_m=s[0] - behind_m * math.cos(s[4]),
            y_m=s[1] - behind_m * math.sin(s[4]),
            heading_rad=s[4],
            speed_mps=s[3] * math.cos(s[6]),
        )
        for s in states
    ]


def farthest_m(poses: Sequence[Pose], others: Sequence[Pose]) -> float:
    return max(math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) for a, b in zip(poses, others, strict=True))


def most_turned_rad(poses: Sequence[Pose], others: Sequence[Pose]) -> float:
    return max(abs(math.remainder(a.heading_rad - b.heading_rad, math.tau)) for a, b in zip(poses, others, strict=True))


def distance_m(poses: Sequence[Pose]) -> float:
    return sum(abs(pose.speed_mps) for pose in poses) * STEP_S


def largest_lateral_accel_mps2(poses: Sequence[Pose]) -> float:
    turned = ((a, math.remainder(b.heading_rad - a.heading_rad, math.tau)) for a, b in itertools.pairwise(poses))
    return max(abs(pose.speed_mps * turned_rad / STEP_S) for pose, turned_rad in turned)


@pytest.mark.parametrize("name", MANOEUVRES)
def test_plant_follows_the_kinematic_single_track_model(name: str) -> None:
    manoeuvre, plant = MANOEUVRES[name], Plant(wheelbase_m=WHEELBASE_M)
    poses, inputs = driven(manoeuvre, plant)
    expected = kinematic(manoeuvre, inputs, limited(plant))
    assert math.dist((poses[0].x_m, poses[0].y_m), (poses[-1].x_m, poses[-1].y_m)) > 2.0
    assert farthest_m(poses, expected) < POSITION_TOLERANCE_M
    assert most_turned_rad(poses, expected) < HEADING_TOLERANCE_RAD
    assert max(abs(a.speed_mps - b.speed_mps) for a, b in zip(poses, expected, strict=True)) < 1e-6


@pytest.mark.parametrize("name", MANOEUVRES)
@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_wheelbase_error_of_five_per_cent_is_detected(name: str, factor: float) -> None:
    manoeuvre, plant = MANOEUVRES[name], Plant(wheelbase_m=factor * WHEELBASE_M)
    poses, inputs = driven(manoeuvre, plant)
    expected = kinematic(manoeuvre, inputs, limited(plant))
    assert farthest_m(poses, expected) > 5 * POSITION_TOLERANCE_M
    assert most_turned_rad(poses, expected) > 5 * HEADING_TOLERANCE_RAD


@pytest.mark.parametrize(("speed_mps", "wheel_rad"), [(10.0, 0.1), (10.0, -0.1), (-3.0, 0.4), (0.0, 0.7)])
def test_yaw_rate_equals_that_of_the_model(speed_mps: float, wheel_rad: float) -> None:
    plant = Plant(wheelbase_m=WHEELBASE_M, speed_mps=speed_mps, wheel_rad=wheel_rad)
    turning = vehicle_dynamics_ks([0.0, 0.0, wheel_rad, speed_mps, 0.0], [0.0, 0.0], BMW)[4]
    assert plant.yaw_rate_radps == pytest.approx(turning, rel=1e-12)


GENTLE = {
    "lane change": Manoeuvre(
        asked=lambda t: (0.0, 0.02 * math.sin(math.tau * t / 4.0) if t < 4.0 else 0.0, 1), seconds=6.0, speed_mps=10.0
    ),
    "wide circle": Manoeuvre(asked=lambda _: (0.0, 0.1, 1), seconds=15.0, speed_mps=5.0),
    "braking in a bend": Manoeuvre(asked=lambda _: (-1.0, 0.05, 1), seconds=8.0, speed_mps=9.0),
}
"""Below 2 m/s² to the side, where tyres hardly slip."""


@pytest.mark.parametrize("name", GENTLE)
def test_at_low_lateral_acceleration_tyres_make_little_difference(name: str) -> None:
    manoeuvre, plant = GENTLE[name], Plant(wheelbase_m=WHEELBASE_M)
    poses, inputs = driven(manoeuvre, plant)
    expected = with_tyres(manoeuvre, inputs, limited(plant))
    assert 0.5 < largest_lateral_accel_mps2(poses) < 2.0
    assert farthest_m(poses, expected) < SLIP_TOLERANCE * distance_m(poses)
    assert most_turned_rad(poses, expected) < SLIP_HEADING_TOLERANCE_RAD


@pytest.mark.parametrize("name", ["wide circle", "braking in a bend"])
def test_with_tyres_too_a_wheelbase_error_of_five_per_cent_is_detected(name: str) -> None:
    manoeuvre, plant = GENTLE[name], Plant(wheelbase_m=1.05 * WHEELBASE_M)
    poses, inputs = driven(manoeuvre, plant)
    expected = with_tyres(manoeuvre, inputs, limited(plant))
    assert farthest_m(poses, expected) > SLIP_TOLERANCE * distance_m(poses)
    assert most_turned_rad(poses, expected) > SLIP_HEADING_TOLERANCE_RAD


def test_wheels_and_acceleration_follow_with_a_lag() -> None:
    """First-order lags, against their solution; the plant's own Euler step is half a millisecond off."""
    plant = Plant(wheelbase_m=WHEELBASE_M, speed_mps=10.0)
    for tick in range(1, 301):
        plant.step(STEP_S, accel_mps2=1.0, wheel_rad=0.05, gear=1, only_brake=False)
        assert plant.wheel_rad == pytest.approx(0.05 * (1 - math.exp(-tick * STEP_S / 0.08)), abs=0.05 * 0.005)
        assert plant.accel_mps2 == pytest.approx(1 - math.exp(-tick * STEP_S / 0.08), abs=0.005)


def test_a_large_steering_step_is_limited_in_rate_and_angle() -> None:
    plant = Plant(wheelbase_m=WHEELBASE_M)
    for tick in range(1, 2001):
        plant.step(STEP_S, accel_mps2=0.0, wheel_rad=5.0, gear=1, only_brake=True)
        assert plant.wheel_rad == pytest.approx(min(0.7, tick * STEP_S * 1.0))


def test_one_long_step_equals_many_short_steps() -> None:
    at_once, in_parts = (Plant(wheelbase_m=WHEELBASE_M, speed_mps=5.0) for _ in range(2))
    for _ in range(300):
        at_once.step(0.01, accel_mps2=-1.0, wheel_rad=0.2, gear=1, only_brake=False)
        for _ in range(10):
            in_parts.step(STEP_S, accel_mps2=-1.0, wheel_rad=0.2, gear=1, only_brake=False)
    assert (at_once.x_m, at_once.y_m) == pytest.approx((in_parts.x_m, in_parts.y_m), abs=1e-9)
    assert at_once.heading_rad == pytest.approx(in_parts.heading_rad, abs=1e-9)


@pytest.mark.parametrize("gear", [-1, 1])
def test_brakes_stop_the_vehicle_without_reversing_it(gear: int) -> None:
    plant = Plant(wheelbase_m=WHEELBASE_M, speed_mps=gear * 5.0)
    speeds = []
    for _ in range(4000):
        plant.step(STEP_S, accel_mps2=-gear * 3.0, wheel_rad=0.0, gear=gear, only_brake=False)
        speeds.append(gear * plant.speed_mps)
    assert min(speeds) == 0.0
    assert speeds[-1] == 0.0
    assert plant.accel_mps2 == 0.0
    expected_m = 5.0**2 / (2 * 3.0) + 5.0 * 0.08 - 3.0 * 0.08**2 / 2
    assert gear * plant.x_m == pytest.approx(expected_m, abs=0.01)
