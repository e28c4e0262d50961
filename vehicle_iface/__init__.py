"""A CAN-bus vehicle interface: state frames in, checked commands out.

    CAN bus ─▶ bus ─▶ codec.decoder ─▶ state_assembler ─▶ control ─▶ safety.gate ─▶ codec.encoder ─▶ bus ─▶ CAN bus
                                                 trajectories ─▲                   telemetry ─▶ viewer, recorder

The public names are below; `CONVENTIONS.md` has frames, signs, units and time. A name's module, and NumPy, is imported
when the name is first used, so that `vehicle-iface --help` imports none of it.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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

_MODULES = {
    "BehaviorConfig": "control.base",
    "Command": "command",
    "ControlReference": "control.base",
    "ControllerBase": "control.base",
    "PurePursuit": "control.pure_pursuit",
    "PurePursuitConfig": "control.pure_pursuit",
    "Reason": "reason",
    "StopSteering": "control.base",
    "Trajectory": "trajectory",
    "VehicleState": "state",
    "predict": "control.prediction",
    "tracking_error": "control.tracking",
}


def __getattr__(name: str) -> object:
    """Import a public name (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
