"""The vehicle's pose: from the values of a sample to the pose of the rear axle's centre.

`build_pose_source(profile)` builds the source of `[state.pose]`: a local position, a geographic one, or dead reckoning.
`build_pose_sensor(profile)` is the reverse, for a simulated vehicle.
"""

from vehicle_iface.pose.build import build_pose_sensor, build_pose_source
from vehicle_iface.pose.data import Pose, PoseInputs, PoseSource
from vehicle_iface.pose.locator import Located, Locator

__all__ = ["Located", "Locator", "Pose", "PoseInputs", "PoseSource", "build_pose_sensor", "build_pose_source"]
