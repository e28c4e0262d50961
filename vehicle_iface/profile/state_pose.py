"""The table `[state.pose]`: source and conversion of the vehicle's pose."""

from collections.abc import Iterator, Mapping
from typing import Literal

import msgspec

from vehicle_iface.profile.forms import Condition

ODOMETRY_FRAME = "odom"
MAX_LATITUDE_DEG = 89.0
"""Maximum latitude of an origin. Nearer to a pole, east and north change direction within the driven area."""
NEEDED_SIGNALS = {
    "local": ("x_m", "y_m", "heading_rad"),
    "geographic": ("latitude_deg", "longitude_deg", "heading_rad"),
    "odometry": (),
}
"""Pose fields that must be bound, by source; the others must not be."""
POSE_SIGNALS = ("x_m", "y_m", "heading_rad", "latitude_deg", "longitude_deg")


class Mount(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Position of the sensor on the vehicle, from the rear axle's centre: x forward, y left."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    """Heading of the sensor's x axis, counter-clockwise from the body's."""


class StatePose(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Source of the vehicle's pose."""

    source: Literal["local", "geographic", "odometry"] = "local"
    """A position in the frame; WGS 84, converted to east and north of `origin`; or dead reckoning from speed and yaw
    rate (or front wheel angle), in the frame `odom`."""
    origin: str | tuple[float, float] | None = None
    """Latitude and longitude in degrees, or "first": the first fix, as where it is left out."""
    mount: Mount = Mount()
    valid: Condition | None = None
    """Condition under which the pose may be used."""


def origin_faults(latitude_deg: float, longitude_deg: float) -> Iterator[str]:
    """List the faults of an origin, each with its value and the allowed range."""
    if not abs(latitude_deg) <= MAX_LATITUDE_DEG:
        yield f"latitude {latitude_deg}: must be within ±{MAX_LATITUDE_DEG:g}; latitude is the first of the two"
    if not abs(longitude_deg) <= 180.0:
        yield f"longitude {longitude_deg}: must be within ±180"


def needed_pose_signals(state: Mapping[str, object]) -> dict[str, str]:
    """Return the pose fields that a document's `[state]` must bind, each with the end of its error."""
    pose = state.get("pose", {})
    source = pose.get("source", "local") if isinstance(pose, dict) else None
    needed = NEEDED_SIGNALS.get(source, ()) if isinstance(source, str) else ()
    if source == "local":
        return dict.fromkeys(needed, '; a vehicle that does not send it has another $.state.pose.source than "local"')
    return dict.fromkeys(needed, f'; $.state.pose.source = "{source}" needs it')


def name_odometry_frame(document: dict[str, object]) -> None:
    """Set the frame of a profile with odometry that does not name one."""
    state = document.get("state")
    pose = state.get("pose") if isinstance(state, dict) else None
    if isinstance(state, dict) and isinstance(pose, dict) and pose.get("source") == "odometry":
        state.setdefault("frame_id", ODOMETRY_FRAME)
