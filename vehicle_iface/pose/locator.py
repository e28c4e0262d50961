"""The pose of each sample for the loop; where there is none, the last one, marked as invalid."""

from typing import NamedTuple

from vehicle_iface.pose.build import build_pose_source
from vehicle_iface.pose.data import Pose, PoseInputs
from vehicle_iface.profile import Profile


class Located(NamedTuple):
    """A pose, and whether it may be used."""

    pose: Pose
    is_valid: bool


class Locator:
    """Locates the vehicle of a profile, sample after sample."""

    def __init__(self, profile: Profile) -> None:
        self._source = build_pose_source(profile)
        self._is_measured = profile.state.pose.source != "odometry"
        self._last = Pose(x_m=0.0, y_m=0.0, heading_rad=0.0)

    @property
    def driven_m(self) -> float | None:
        """The way since dead reckoning began; None where the pose is measured."""
        return self._source.driven_m

    @property
    def is_interrupted(self) -> bool:
        """Whether dead reckoning has lost its place: it goes on only after `reset`."""
        return not self._is_measured and bool(self._source.invalid_because)

    def locate(self, stamp_ns: int, is_valid: bool, values: PoseInputs) -> Located:
        """The pose at `stamp_ns`; with a measured source only a valid sample is looked at."""
        pose = self._source.resolve(stamp_ns, values) if is_valid or not self._is_measured else None
        if pose is not None:
            self._last = pose
        return Located(self._last, is_valid and pose is not None)

    def reset(self) -> None:
        """Start again: dead reckoning is at 0, 0, 0 once more."""
        self._source.reset()
