"""Builds the pose source of a profile's `[state.pose]`, and its inverse for the simulator."""

from collections.abc import Callable

from vehicle_iface.pose.data import Pose, PoseInputs, PoseSource
from vehicle_iface.pose.geographic import Fix
from vehicle_iface.pose.measured import GeographicPosition, LocalPosition
from vehicle_iface.pose.mount import SensorMount
from vehicle_iface.pose.odometry import Odometry
from vehicle_iface.profile import Profile

SIMULATED_ORIGIN = Fix(52.0601, 5.1102)
"""Origin of a simulated vehicle's plane when the profile's origin is the first fix."""


def build_pose_source(profile: Profile) -> PoseSource:
    """Build the pose source of a profile."""
    pose = profile.state.pose
    if pose.source == "odometry":
        return Odometry(
            wheelbase_m=profile.geometry.wheelbase_m,
            max_gap_s=profile.timing.state_stale_s,
            has_yaw_rate=profile.state.signals.yaw_rate_radps is not None,
        )
    if pose.source == "geographic":
        origin = pose.origin
        return GeographicPosition(_mount(profile), None if isinstance(origin, str | None) else Fix(*origin))
    return LocalPosition(_mount(profile))


def build_pose_sensor(profile: Profile) -> Callable[[Pose], PoseInputs]:
    """Build the position sensor of a simulated vehicle: pose of the rear axle's centre → measured fields.

    The reverse of `PoseSource.resolve`, and empty for a vehicle without such a sensor. Where the origin is the first
    fix, the simulated vehicle's plane is at `SIMULATED_ORIGIN`.
    """
    pose = profile.state.pose
    if pose.source == "odometry":
        return lambda _: PoseInputs()
    if pose.source == "geographic":
        origin = pose.origin
        return GeographicPosition(
            _mount(profile), SIMULATED_ORIGIN if isinstance(origin, str | None) else Fix(*origin)
        ).measure
    return LocalPosition(_mount(profile)).measure


def _mount(profile: Profile) -> SensorMount:
    mount = profile.state.pose.mount
    return SensorMount(x_m=mount.x_m, y_m=mount.y_m, heading_rad=mount.heading_rad)
