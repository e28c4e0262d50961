"""Controllers: from a state and a trajectory to a wish.

`base` says when to stop and how, `tracking` where the vehicle is on its trajectory, `prediction` where it
will be, `stops` where it has to stand on the way, `lookahead` which point it aims at. Each controller has a
file of its own.
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
