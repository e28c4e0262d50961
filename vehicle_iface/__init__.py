"""A CAN-bus vehicle interface: state frames in, checked commands out.

    CAN bus ─▶ bus ─▶ codec.decoder ─▶ state_assembler ─▶ control ─▶ safety.gate ─▶ codec.encoder ─▶ bus ─▶ CAN bus
                                                 trajectories ─▲                   telemetry ─▶ viewer, recorder

The public names are below; `CONVENTIONS.md` has frames, signs, units and time.
"""

from vehicle_iface.command import Command
from vehicle_iface.control.base import BehaviorConfig, ControllerBase, ControlReference, StopSteering
from vehicle_iface.control.prediction import predict
from vehicle_iface.control.pure_pursuit import PurePursuit, PurePursuitConfig
from vehicle_iface.control.tracking import tracking_error
from vehicle_iface.reason import Reason
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory

__all__ = [
    "BehaviorConfig",
    "Command",
    "ControlReference",
    "ControllerBase",
    "PurePursuit",
    "PurePursuitConfig",
    "Reason",
    "StopSteering",
    "Trajectory",
    "VehicleState",
    "predict",
    "tracking_error",
]
