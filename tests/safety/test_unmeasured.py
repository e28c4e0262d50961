"""Limits that would compare with a signal which the vehicle does not send."""

import math

import msgspec
import pytest

from tests.harness import reference
from vehicle_iface.safety.unmeasured import without_unmeasured

WHEELS = {"front_wheel_deviation_rad", "yaw_rate_tolerance_radps"}
YAW_RATE = {"yaw_rate_tolerance_radps", "heading_tolerance_rad"}


@pytest.mark.parametrize(
    ("unsent", "unlimited"),
    [
        ((), set()),
        (("front_wheel_angle_rad",), WHEELS),
        (("yaw_rate_radps",), YAW_RATE),
        (("front_wheel_angle_rad", "yaw_rate_radps"), WHEELS | YAW_RATE),
        (("rear_wheel_angle_rad", "accel_mps2"), set()),
    ],
)
def test_only_the_limits_of_what_is_not_sent_are_infinite(unsent: tuple[str, ...], unlimited: set[str]) -> None:
    profile = reference().profile
    signals = msgspec.structs.replace(profile.state.signals, **dict.fromkeys(unsent))
    state = msgspec.structs.replace(profile.state, signals=signals)
    found = without_unmeasured(msgspec.structs.replace(profile, state=state))
    infinite = set()
    for after, before in zip(found, (profile.limits, profile.plausibility), strict=True):
        for name in before.__struct_fields__:
            if getattr(after, name) != getattr(before, name):
                assert getattr(after, name) == math.inf
                infinite.add(name)
    assert infinite == unlimited
