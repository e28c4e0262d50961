"""Sensors that are noisy, but as good as those that vehicles have, never stop a drive."""

import pytest

from tests.harness import reference
from tests.kinematics import SensorNoise, drive_route
from vehicle_iface.drivable import build_route
from vehicle_iface.motion_sources import MotionSources
from vehicle_iface.safety.motion import MotionCheck
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.trajectories.shapes import ROUTES

PROFILE = reference().profile
QUARTER_OF_AN_HOUR = 90_000
"""Samples."""


@pytest.mark.parametrize("name", sorted(ROUTES))
def test_in_two_hours_on_all_routes_no_sample_is_dropped_and_no_sources_disagree(name: str) -> None:
    """Each of the eight routes is driven again and again, each time with other noise."""
    route, samples, seed = build_route(name, PROFILE), 0, 0
    motion = MotionCheck(
        PROFILE.plausibility,
        sources=MotionSources(),
        wheelbase_m=PROFILE.geometry.wheelbase_m,
        gap_s=PROFILE.timing.state_stale_s,
        agree_s=PROFILE.recovery.state_invalid_s,
    )
    plausibility = PlausibilityCheck(PROFILE.plausibility, wheelbase_m=PROFILE.geometry.wheelbase_m)
    while samples < QUARTER_OF_AN_HOUR:
        motion.reset()
        plausibility.reset()
        for state in drive_route(route, SensorNoise(), seed):
            is_believed = plausibility.is_plausible(state, pose_valid=True)
            motion.update(state, pose_valid=True)
            samples += 1
            if not is_believed or motion.disagreement is not None:
                pytest.fail(f"drive {seed}, {state}: {motion.disagreement}, {plausibility.counts}")
        seed += 1
