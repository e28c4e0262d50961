"""Inputs of a pose, the pose, and the interface of its sources."""

from typing import Protocol

import msgspec


class Pose(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Position and heading in the plane, of the rear axle's centre unless stated otherwise."""

    x_m: float
    y_m: float
    heading_rad: float
    """Counter-clockwise from the frame's x axis, in [−π, π]."""


class PoseInputs(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """The fields of one sample that a pose may be computed from, in SI units; None: not bound, or without a value."""

    x_m: float | None = None
    y_m: float | None = None
    heading_rad: float | None = None
    """Counter-clockwise from the frame's x axis; from east where the position is geographic."""
    latitude_deg: float | None = None
    """WGS 84, positive to the north."""
    longitude_deg: float | None = None
    """WGS 84, positive to the east; −180 to 180 or 0 to 360."""
    speed_mps: float | None = None
    yaw_rate_radps: float | None = None
    lateral_speed_mps: float | None = None
    front_wheel_angle_rad: float | None = None
    rear_wheel_angle_rad: float | None = None


class PoseSource(Protocol):
    """Computes poses from samples; one for each vehicle, called once for each sample in the order of their stamps."""

    @property
    def driven_m(self) -> float | None:
        """Distance in m since dead reckoning began, forwards plus backwards; None where the pose is measured."""

    @property
    def invalid_because(self) -> str:
        """Reason why the newest sample has no valid pose; empty while it has one, and before the first sample."""

    def resolve(self, stamp_ns: int, values: PoseInputs) -> Pose | None:
        """Return the pose of the rear axle's centre at `stamp_ns`; None: no valid pose.

        Only samples whose pose the vehicle calls valid should be given to a measured source: the first of them may
        become the origin. Dead reckoning needs every sample.
        """

    def reset(self) -> None:
        """Restart after a lost link, or to end the invalid pose of an interrupted dead reckoning.

        A geographic origin stays. Dead reckoning restarts at 0, 0, 0: a trajectory in its frame is no longer valid and
        must not be followed any further.
        """
