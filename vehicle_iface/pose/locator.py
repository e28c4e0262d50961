"""The pose of each sample for the loop; where there is none, the last pose, marked as invalid."""

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
        """Distance in m since dead reckoning began; None where the pose is measured."""
        return self._source.driven_m

    @property
    def is_interrupted(self) -> bool:
        """Whether dead reckoning was interrupted: it continues only after `reset`."""
        return not self._is_measured and bool(self._source.invalid_because)

    def locate(self, stamp_ns: int, is_valid: bool, values: PoseInputs) -> Located:
        """Return the pose at `stamp_ns`; a measured source uses only valid samples."""
        pose = self._source.resolve(stamp_ns, values) if is_valid or not self._is_measured else None
        if pose is not None:
            self._last = pose
        return Located(self._last, is_valid and pose is not None)

    def reset(self) -> None:
        """Restart: dead reckoning begins at 0, 0, 0 again."""
        self._source.reset()
