"""Controllers: from a state and a trajectory to a requested command.

`base` has stops and guarantees, `tracking` the progress along the trajectory, `prediction` the state a short time
ahead, `stop_schedule` the standstills on the way, `lookahead` the point to steer at. Each controller has its own file.
"""

from vehicle_iface.control.base import BehaviorConfig, ControllerBase, ControlReference, StopSteering
from vehicle_iface.control.prediction import predict
from vehicle_iface.control.pure_pursuit import PurePursuit, PurePursuitConfig
from vehicle_iface.control.tracking import ReferencePoint, TrackingError, point_at, tracking_error

__all__ = [
    "BehaviorConfig",
    "ControlReference",
    "ControllerBase",
    "PurePursuit",
    "PurePursuitConfig",
    "ReferencePoint",
    "StopSteering",
    "TrackingError",
    "point_at",
    "predict",
    "tracking_error",
]
