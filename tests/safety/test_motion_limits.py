"""How far two sources of motion may differ, and in which sample a greater difference is found.

The numbers are those of the table in FAILURES.md, "Sources of motion that disagree", with the reference vehicle's
tolerances: 0.5 m, 0.5 m/s and 0.2 rad between two samples.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import pytest

from tests.harness import reference
from tests.kinematics import PERIOD_NS, PERIOD_S, WHEELBASE_M
from vehicle_iface import VehicleState
from vehicle_iface.motion_sources import MotionSources
from vehicle_iface.safety.motion import Disagreement, MotionCheck
from vehicle_iface.status import Gear
from vehicle_iface.units import ns_from_s, wrapped_rad

LIMITS = reference().profile.plausibility
SPEED, HEADING, ACCEL, TURN, WHEELS = Disagreement


def motion_check(*, gap_s: float = 0.05, **sources: bool) -> MotionCheck:
    return MotionCheck(LIMITS, sources=MotionSources(**sources), wheelbase_m=WHEELBASE_M, gap_s=gap_s, agree_s=0.5)


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A drive at one speed and turn, in which two sources may differ by noise + per second · window, and no more."""

    kind: Disagreement
    noise: float
    per_s: float
    speed_mps: float = 0.0
    turn_radps: float = 0.0
    has_yaw_rate: bool = True
    has_wheels: bool = True

    def check(self) -> MotionCheck:
        return motion_check(yaw_rate=self.has_yaw_rate, front_wheels=self.has_wheels)

    def limit(self, window_s: float) -> float:
        return self.noise + self.per_s * window_s

    def drive(self, seconds: float, *, rate: float, onset_s: float) -> list[VehicleState]:
        """Samples in which the pair's difference grows by `rate` a second from the onset on, and no other does."""
        states: list[VehicleState] = []
        x_m = y_m = last_m = last_mps = last_rad = 0.0
        for tick in range(round(seconds / PERIOD_S) + 1):
            t_s = tick * PERIOD_S
            apart = rate * max(0.0, t_s - onset_s)
            is_apart = t_s >= onset_s
            speed_mps = self.speed_mps + (apart if self.kind is ACCEL else 0.0)
            heading_rad = self.turn_radps * t_s + (apart if self.kind is TURN else 0.0)
            by_wheels_radps = self.turn_radps - (rate if self.kind is WHEELS and is_apart else 0.0)
            curvature = by_wheels_radps / speed_mps if speed_mps else 0.0
            if tick > 0:
                way_m, excess_m = 0.5 * PERIOD_S * (last_mps + speed_mps), apart - last_m
                along_m = way_m + (excess_m if self.kind is SPEED else 0.0)
                aside_m = excess_m if self.kind is HEADING else 0.0
                course_rad = 0.5 * (last_rad + heading_rad)
                x_m += along_m * math.cos(course_rad) - aside_m * math.sin(course_rad)
                y_m += along_m * math.sin(course_rad) + aside_m * math.cos(course_rad)
            last_m, last_mps, last_rad = apart, speed_mps, heading_rad
            states.append(
                VehicleState(
                    stamp_ns=tick * PERIOD_NS,
                    x_m=x_m,
                    y_m=y_m,
                    heading_rad=wrapped_rad(heading_rad),
                    speed_mps=speed_mps,
                    yaw_rate_radps=self.turn_radps if self.has_yaw_rate else 0.0,
                    front_wheel_angle_rad=math.atan(curvature * WHEELBASE_M) if self.has_wheels else 0.0,
                )
            )
        return states


PAIRS = {
    "position and speed, at rest": Pair(kind=SPEED, noise=0.5, per_s=0.05),
    "position and speed, forwards": Pair(kind=SPEED, noise=0.5, per_s=0.05 + 0.03 * 5.0, speed_mps=5.0),
    "position and speed, backwards": Pair(kind=SPEED, noise=0.5, per_s=0.05 + 0.03 * 5.0, speed_mps=-5.0),
    "position and speed, fast in a bend": Pair(
        kind=SPEED, noise=0.5, per_s=0.05 + 0.03 * 15.0, speed_mps=15.0, turn_radps=0.3
    ),
    "position and heading, at rest": Pair(kind=HEADING, noise=0.5, per_s=0.0),
    "position and heading, forwards": Pair(kind=HEADING, noise=0.5, per_s=0.06 * 5.0, speed_mps=5.0),
    "position and heading, backwards in a bend": Pair(
        kind=HEADING, noise=0.5, per_s=0.06 * 10.0, speed_mps=-10.0, turn_radps=0.3
    ),
    "speed and acceleration, forwards": Pair(kind=ACCEL, noise=0.5, per_s=0.7, speed_mps=5.0),
    "speed and acceleration, backwards": Pair(kind=ACCEL, noise=0.5, per_s=0.7, speed_mps=-15.0),
    "heading and yaw rate, straight on": Pair(kind=TURN, noise=0.2, per_s=0.03, speed_mps=5.0, has_wheels=False),
    "heading and yaw rate, to the left": Pair(
        kind=TURN, noise=0.2, per_s=0.03 + 0.05 * 0.4, speed_mps=5.0, turn_radps=0.4
    ),
    "heading and yaw rate, to the right": Pair(
        kind=TURN, noise=0.2, per_s=0.03 + 0.05 * 2.0, turn_radps=-2.0, has_wheels=False
    ),
    "heading and wheels, straight on": Pair(
        kind=TURN, noise=0.2 + 0.05, per_s=0.03 + 0.03 * 5.0 / 2.7, speed_mps=5.0, has_yaw_rate=False
    ),
    "heading and wheels, to the right": Pair(
        kind=TURN,
        noise=0.2 + 0.05,
        per_s=0.03 + 0.05 * 0.4 + 0.03 * 5.0 / 2.7 + 0.3 * 0.4,
        speed_mps=-5.0,
        turn_radps=-0.4,
        has_yaw_rate=False,
    ),
    "yaw rate and wheels, straight on": Pair(kind=WHEELS, noise=0.05, per_s=0.03 * 5.0 / 2.7, speed_mps=5.0),
    "yaw rate and wheels, to the left": Pair(
        kind=WHEELS, noise=0.05, per_s=0.03 * 2.0 / 2.7 + 0.3 * 0.4, speed_mps=2.0, turn_radps=0.4
    ),
    "yaw rate and wheels, backwards to the right": Pair(
        kind=WHEELS, noise=0.05, per_s=0.03 * 8.0 / 2.7 + 0.3 * 0.3, speed_mps=-8.0, turn_radps=-0.3
    ),
}
A_LITTLE = 1e-9
NEVER_S = math.inf


def found_after(pair: Pair, states: list[VehicleState]) -> tuple[float, MotionCheck]:
    """The time of the sample in which the disagreement was found, s."""
    check = pair.check()
    for state in states:
        check.update(state, pose_valid=True)
        if check.disagreement is not None:
            assert check.disagreement.kind is pair.kind
            return state.stamp_ns / 1e9, check
    return NEVER_S, check


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("window_s", "more", "found_s"),
    [
        (0.05, A_LITTLE, 0.05),
        (0.05, -A_LITTLE, 0.1),
        (0.5, A_LITTLE, 0.5),
        (0.5, -A_LITTLE, 0.55),
        (1.0, A_LITTLE, 1.0),
        (1.0, -A_LITTLE, 1.05),
        (2.0, A_LITTLE, 2.0),
        (2.0, -A_LITTLE, NEVER_S),
    ],
)
@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_sources_that_differ_from_the_start_are_found_as_soon_as_the_difference_exceeds_its_limit(
    pair: Pair, window_s: float, more: float, found_s: float, sign: float
) -> None:
    """The rate is the one that reaches the limit after `window_s`, and a little more or less."""
    rate = pair.limit(window_s) / window_s * (1.0 + more)
    at_s, check = found_after(pair, pair.drive(min(found_s, 5.0), rate=sign * rate, onset_s=0.0))
    assert at_s == found_s
    if check.disagreement is not None:
        assert check.disagreement.value == pytest.approx(rate * found_s)
        assert check.disagreement.limit == pytest.approx(pair.limit(found_s))


ONSET_S = 2.995
"""Between two samples: half of the step between them is before it."""


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("window_s", "more", "found_s"),
    [(0.5, A_LITTLE, 3.5), (0.5, -A_LITTLE, None), (2.0, A_LITTLE, 5.0), (2.0, -A_LITTLE, NEVER_S)],
)
@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_sources_that_begin_to_differ_are_compared_over_half_a_second_and_over_two(
    pair: Pair, window_s: float, more: float, found_s: float | None, sign: float
) -> None:
    """The rate is the one that reaches the limit over a window, and a little more or less. Each 50 ms is compared."""
    rate = pair.limit(window_s) / window_s * (1.0 + more)
    if found_s is None:  # by the long window, which holds more and allows more
        found_s = 0.05 * math.ceil((ONSET_S + pair.limit(2.0) / rate) / 0.05)
        assert 3.5 < found_s < 5.0 or pair.per_s == 0.0
    at_s, _ = found_after(pair, pair.drive(min(found_s, 6.0), rate=sign * rate, onset_s=ONSET_S))
    assert at_s == pytest.approx(found_s)


def at(t_s: float, **numbers: Any) -> VehicleState:
    return replace(VehicleState(stamp_ns=ns_from_s(t_s), x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0), **numbers)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("kind", "pose_valid", "most", "per_unit"),
    [
        (SPEED, True, 0.5 + 0.05 * 0.5, {"x_m": 1.0}),
        (HEADING, True, 0.5, {"y_m": 1.0}),
        (ACCEL, True, 0.5 + 0.7 * 0.5, {"speed_mps": 1.0, "x_m": 0.25}),
        (TURN, True, 0.2 + 0.03 * 0.5, {"heading_rad": 1.0}),
        (WHEELS, False, 0.05 / (1.0 - 0.3), {"yaw_rate_radps": 4.0}),  # the turn that the limit has its share of
    ],
)
def test_sources_that_differ_by_exactly_the_limit_agree(
    kind: Disagreement, pose_valid: bool, most: float, per_unit: dict[str, float], sign: float
) -> None:
    """Two samples half a second apart; of speeds and yaw rates the mean is integrated."""
    for apart, found in ((most, None), (math.nextafter(most, 1.0), kind)):
        check = motion_check(gap_s=1.0)
        check.update(at(0.0), pose_valid=pose_valid)
        check.update(at(0.5, **{name: sign * apart * unit for name, unit in per_unit.items()}), pose_valid=pose_valid)
        assert (check.disagreement and check.disagreement.kind) is found


@pytest.mark.parametrize("turn_radps", [2.0, -2.0])
def test_between_two_samples_the_vehicle_moved_along_the_heading_in_the_middle(turn_radps: float) -> None:
    """Half a radian from sample to sample; only the middle one is the direction of the chord."""
    strict = msgspec.structs.replace(LIMITS, position_tolerance_m=0.05)
    check = MotionCheck(strict, sources=MotionSources(), wheelbase_m=WHEELBASE_M, gap_s=1.0, agree_s=0.5)
    front_rad, radius_m = math.atan(turn_radps / 4.0 * WHEELBASE_M), 4.0 / turn_radps
    for tick in range(9):
        heading_rad = turn_radps * 0.25 * tick
        state = at(
            0.25 * tick,
            x_m=radius_m * math.sin(heading_rad),
            y_m=radius_m * (1.0 - math.cos(heading_rad)),
            heading_rad=wrapped_rad(heading_rad),
            speed_mps=4.0,
            yaw_rate_radps=turn_radps,
            front_wheel_angle_rad=front_rad,
        )
        check.update(state, pose_valid=True)
        assert check.disagreement is None


# What is compared, and since when


def found_at(check: MotionCheck, states: list[VehicleState]) -> float:
    for state in states:
        check.update(state, pose_valid=True)
        if check.disagreement is not None:
            return state.stamp_ns / 1e9
    return NEVER_S


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("speed_mps", "found_s"), [(0.5, 1.15), (0.501, NEVER_S), (5.0, NEVER_S)])
def test_a_position_that_has_not_changed_is_compared_at_low_speed_only(
    speed_mps: float, found_s: float, sign: float
) -> None:
    """At 0.5 m/s it lags by 0.5 m + 0.05 m/s + 3 % of the way after 1.149 s. A faster one that stands is frozen."""
    states = [at(0.01 * tick, speed_mps=sign * speed_mps) for tick in range(300)]
    assert found_at(motion_check(), states) == found_s


@pytest.mark.parametrize(("x_mps", "y_mps", "heading_rad"), [(5.0, 0.0, math.pi / 2.0), (0.0, 5.0, 0.0)])
def test_a_position_that_changes_along_one_axis_has_changed(x_mps: float, y_mps: float, heading_rad: float) -> None:
    states = [
        at(t_s, x_m=x_mps * t_s, y_m=y_mps * t_s, heading_rad=heading_rad, speed_mps=5.0)
        for t_s in (0.01 * tick for tick in range(100))
    ]
    assert found_at(motion_check(), states) == 0.15  # 0.5 m + 0.2 m/s of 5 m/s, each 50 ms


def test_after_a_gap_differences_count_from_the_last_comparison_before_it() -> None:
    """The position is 0.4 m off before a gap of two seconds, and 0.3 m more after it: never 0.5 m within a window."""
    check = motion_check()
    for t_s, x_m in ((0.0, 0.0), (0.05, 0.4), (2.05, 0.4), (2.1, 0.7), (2.15, 0.7)):
        check.update(at(t_s, x_m=x_m), pose_valid=True)
        assert check.disagreement is None
    check.update(at(2.2, x_m=1.5), pose_valid=True)
    assert check.disagreement is not None


def test_a_sample_with_the_stamp_of_the_one_before_it_makes_no_way() -> None:
    states = [at(0.0), at(0.0, x_m=99.0), *(at(0.01 * tick, x_m=99.0) for tick in range(1, 100))]
    assert found_at(motion_check(), states) == NEVER_S


def test_a_disagreement_ends_when_it_has_left_the_long_window_for_half_a_second() -> None:
    """The position steps by a metre in the sample at 3.01 s. The last window that holds it begins at 3 s."""
    check, held = motion_check(), []
    for tick in range(700):
        check.update(at(0.01 * tick, x_m=1.0 if tick > 300 else 0.0), pose_valid=True)
        held.append(check.disagreement is not None)
    assert (held.index(True), len(held) - held[::-1].index(True)) == (305, 550)
    assert sum(held) == 550 - 305


# The speed that limits go by


@pytest.mark.parametrize(
    ("speed_mps", "by_position_mps", "t_s", "limit_mps"),
    [
        (5.0, 5.4, 3.0, 5.25),
        (5.0, 5.4, 2.0, 5.25),
        (5.0, 5.4, 0.5, 5.25),
        (5.0, 5.4, 0.25, 5.05),  # over half a second at least
        (-5.0, -5.4, 3.0, -5.25),
        (5.0, 4.6, 3.0, 5.0),
        (-5.0, -4.6, 3.0, -5.0),
        (5.0, 5.15 + 1e-6, 3.0, 5.0 + 1e-6),
        (5.0, 5.15 - 1e-6, 3.0, 5.0),
        (5.0, -5.4, 3.0, -5.25),
        (-5.0, 5.4, 3.0, 5.25),
        (0.0, -2.0, 3.0, -1.85),
    ],
)
def test_a_speed_by_position_counts_beyond_15_centimetres_a_second(
    speed_mps: float, by_position_mps: float, t_s: float, limit_mps: float
) -> None:
    check = motion_check()
    for tick in range(round(t_s / 0.01) + 1):
        check.update(at(0.01 * tick, x_m=by_position_mps * 0.01 * tick, speed_mps=speed_mps), pose_valid=True)
    assert check.limit_speed_mps(speed_mps) == pytest.approx(limit_mps, abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("speed_mps", "accel_mps2", "t_s", "limit_mps"),
    [
        (0.0, 3.0, 4.0, 3.0 * 2.0 - 0.5 - 0.7 * 2.0),
        (0.0, 3.0, 2.0, 3.0 * 2.0 - 0.5 - 0.7 * 2.0),
        (0.0, 3.0, 1.0, 3.0 * 1.0 - 0.5 - 0.7 * 1.0),
        (0.0, 5.0, 0.25, 5.0 * 0.25 - 0.5 - 0.7 * 0.5),  # the noise is that of half a second at least
        (5.0, 3.0, 4.0, 5.0 + 4.1),
        (5.0, -3.0, 4.0, 5.0),
        (1.0, -3.0, 4.0, 1.0 - 4.1),
        (5.0, 0.95 + 1e-6, 4.0, 5.0 + 2e-6),
        (5.0, 0.95 - 1e-6, 4.0, 5.0),
    ],
)
def test_a_speed_by_acceleration_counts_beyond_its_drift(
    speed_mps: float, accel_mps2: float, t_s: float, limit_mps: float, sign: float
) -> None:
    check = motion_check()
    for tick in range(round(t_s / 0.01) + 1):
        state = at(
            0.01 * tick, x_m=sign * speed_mps * 0.01 * tick, speed_mps=sign * speed_mps, accel_mps2=sign * accel_mps2
        )
        check.update(state, pose_valid=True)
    assert check.limit_speed_mps(sign * speed_mps) == pytest.approx(sign * limit_mps, abs=1e-9)


def test_before_the_first_comparison_limits_go_by_the_speed_signal() -> None:
    check = motion_check()
    assert check.limit_speed_mps(-5.0) == -5.0
    check.update(at(0.0, speed_mps=3.0), pose_valid=True)
    assert check.limit_speed_mps(3.0) == 3.0


# Which way


def disagreeing(way_m: dict[int, float], until: int) -> MotionCheck:
    """A vehicle whose accelerometer is wrong, and that moves by `way_m` in the samples with these numbers."""
    check, x_m = motion_check(), 0.0
    for tick in range(until + 1):
        x_m += way_m.get(tick, 0.0)
        check.update(at(0.01 * tick, x_m=x_m, accel_mps2=5.0), pose_valid=True)
    assert check.disagreement is not None
    return check


@pytest.mark.parametrize("gear", [Gear.DRIVE, Gear.REVERSE, Gear.PARK, Gear.NEUTRAL, None])
@pytest.mark.parametrize("by_position", [1, 0, -1])
@pytest.mark.parametrize("by_speed", [1, 0, -1])
def test_while_sources_disagree_the_majority_of_three_decides_the_direction_and_of_two_the_gear(
    by_speed: int, by_position: int, gear: Gear | None
) -> None:
    by_gear = 1 if gear is Gear.DRIVE else -1 if gear is Gear.REVERSE else 0
    says = [by_speed, by_position, by_gear]
    forwards, backwards = says.count(1), says.count(-1)
    expected = backwards > forwards if backwards != forwards else by_gear < 0 if by_gear else by_speed < 0
    check = disagreeing({350: 0.1 * by_position}, 355)
    assert check.is_backwards(2.0 * by_speed, gear) is expected


@pytest.mark.parametrize(
    ("way_m", "speed_mps", "gear", "backwards"),
    [
        (-0.05, 0.0, None, False),
        (-0.051, 0.0, None, True),
        (0.05, 2.0, Gear.REVERSE, True),
        (0.051, 2.0, Gear.REVERSE, False),
        (0.051, 0.05, Gear.REVERSE, True),
        (0.051, 0.051, Gear.REVERSE, False),
        (-0.051, -0.05, Gear.DRIVE, False),
        (-0.051, -0.051, Gear.DRIVE, True),
    ],
)
def test_5_centimetres_of_way_and_5_centimetres_a_second_give_no_direction(
    way_m: float, speed_mps: float, gear: Gear | None, backwards: bool
) -> None:
    assert disagreeing({350: way_m}, 355).is_backwards(speed_mps, gear) is backwards


def test_the_position_gives_the_direction_of_the_last_half_second() -> None:
    """Forwards until 3 s, and 6 cm back in the sample after that."""
    way_m = dict.fromkeys(range(301), 0.02) | {301: -0.06}
    backwards = {until: disagreeing(way_m, until).is_backwards(0.0, None) for until in (300, 310, 349, 350, 354, 355)}
    assert backwards == {300: False, 310: False, 349: False, 350: True, 354: True, 355: False}
