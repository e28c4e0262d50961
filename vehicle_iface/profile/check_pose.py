"""Checks `[state.pose]` against the bound signals and the vehicle."""

import math
from collections.abc import Iterator

from vehicle_iface.profile.schema import Profile
from vehicle_iface.profile.state_pose import (
    NEEDED_SIGNALS,
    ODOMETRY_FRAME,
    POSE_SIGNALS,
    Mount,
    StatePose,
    origin_faults,
)


def check_pose(profile: Profile) -> Iterator[str]:
    """Return every fault of the table with its place; `check_tables` reports the signals that are missing."""
    state, pose = profile.state, profile.state.pose
    for field in POSE_SIGNALS:
        bound = getattr(state.signals, field)
        if bound is not None and field not in NEEDED_SIGNALS[pose.source]:
            sources = " or ".join(f'"{source}"' for source, fields in NEEDED_SIGNALS.items() if field in fields)
            text = f'not used with source = "{pose.source}"; remove it, or set $.state.pose.source to {sources}'
            yield f"$.state.signals.{field}: {bound}: {text}"
    if pose.source != "local" and state.signals.pose_frame is not None:
        text = f'not used with source = "{pose.source}"; remove it, $.state.frame_id names the frame'
        yield f"$.state.signals.pose_frame: {state.signals.pose_frame}: {text}"
    if pose.source == "odometry":
        yield from _check_odometry(profile)
    yield from _check_origin(pose)
    yield from _check_mount(pose.mount, profile.geometry.length_m)


def _check_odometry(profile: Profile) -> Iterator[str]:
    state = profile.state
    if state.signals.yaw_rate_radps is None and state.signals.front_wheel_angle_rad is None:
        yield '$.state.signals: source = "odometry" needs yaw_rate_radps or front_wheel_angle_rad, and neither is bound'
    if state.frame_id != ODOMETRY_FRAME:
        yield f'$.state.frame_id: {state.frame_id!r}: must be "{ODOMETRY_FRAME}" with source = "odometry"; remove it'
    if state.pose.mount != Mount():
        text = 'not used with source = "odometry", which has no position sensor; remove it'
        yield f"$.state.pose.mount: {text}"


def _check_origin(pose: StatePose) -> Iterator[str]:
    place, origin = "$.state.pose.origin", pose.origin
    if origin is None:
        return
    if pose.source != "geographic":
        yield f'{place}: only with source = "geographic", and it is "{pose.source}"; remove it'
    if isinstance(origin, str):
        if origin != "first":
            yield f'{place}: {origin!r}: must be [latitude, longitude] in degrees, or "first"'
        return
    yield from (f"{place}: {fault}" for fault in origin_faults(*origin))


def _check_mount(mount: Mount, length_m: float) -> Iterator[str]:
    """List numbers that are probably in another unit."""
    for key in ("x_m", "y_m"):
        distance_m = getattr(mount, key)
        if abs(distance_m) > length_m:
            yield f"$.state.pose.mount.{key}: {distance_m}: must be within ±$.geometry.length_m = {length_m}"
    if abs(mount.heading_rad) > math.pi:
        yield f"$.state.pose.mount.heading_rad: {mount.heading_rad}: must be in rad, within ±π"
