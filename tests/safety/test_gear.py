"""A gear in which the vehicle cannot be driven as it moves is a contradiction."""

import logging

import pytest

from vehicle_iface.safety.gear import CONTRADICTS_NS, GearCheck
from vehicle_iface.status import Gear

LIMIT_MPS = 0.5


def contradicts(speed_mps: float, requested: Gear, gear: Gear | None) -> bool:
    check = GearCheck(LIMIT_MPS)
    assert not check.contradicts(speed_mps, requested, gear, 0)
    assert not check.contradicts(speed_mps, requested, gear, CONTRADICTS_NS - 1)
    return check.contradicts(speed_mps, requested, gear, CONTRADICTS_NS)


@pytest.mark.parametrize("gear", [Gear.PARK, Gear.REVERSE, Gear.NEUTRAL])
@pytest.mark.parametrize(("speed_mps", "expected"), [(5.0, True), (0.501, True), (0.5, False), (0.0, False)])
def test_driven_forwards_only_drive_fits(gear: Gear, speed_mps: float, expected: bool) -> None:
    assert contradicts(speed_mps, Gear.DRIVE, gear) is expected
    assert not contradicts(speed_mps, Gear.DRIVE, Gear.DRIVE)


@pytest.mark.parametrize("gear", [Gear.PARK, Gear.DRIVE, Gear.NEUTRAL])
@pytest.mark.parametrize(("speed_mps", "expected"), [(-5.0, True), (-0.501, True), (-0.5, False)])
def test_driven_backwards_only_reverse_fits(gear: Gear, speed_mps: float, expected: bool) -> None:
    assert contradicts(speed_mps, Gear.REVERSE, gear) is expected
    assert not contradicts(speed_mps, Gear.REVERSE, Gear.REVERSE)


@pytest.mark.parametrize(
    ("speed_mps", "requested", "gear"), [(-2.0, Gear.DRIVE, Gear.REVERSE), (2.0, Gear.REVERSE, Gear.PARK)]
)
def test_a_vehicle_that_rolls_back_may_be_in_any_gear(speed_mps: float, requested: Gear, gear: Gear) -> None:
    assert not contradicts(speed_mps, requested, gear)


@pytest.mark.parametrize("speed_mps", [5.0, -5.0])
def test_without_a_direction_or_a_gear_nothing_is_compared(speed_mps: float) -> None:
    assert not contradicts(speed_mps, Gear.NO_REQUEST, Gear.PARK)
    assert not contradicts(speed_mps, Gear.DRIVE, None)


def test_a_gear_that_fits_again_ends_it_and_each_beginning_counts(caplog: pytest.LogCaptureFixture) -> None:
    check, now_ns = GearCheck(LIMIT_MPS), 0
    found = []
    with caplog.at_level(logging.WARNING):
        for gear in (Gear.PARK, Gear.DRIVE, Gear.NEUTRAL):
            for _ in range(40):
                now_ns += 10_000_000
                found.append(check.contradicts(5.0, Gear.DRIVE, gear, now_ns))
    assert found == [False] * 20 + [True] * 20 + [False] * 40 + [False] * 20 + [True] * 20
    assert check.count == 2
    assert caplog.messages == [
        "the gear is PARK while the vehicle is driven at 5 m/s",
        "the gear is NEUTRAL while the vehicle is driven at 5 m/s",
    ]
