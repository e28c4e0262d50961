"""Telemetry: one-way data out of the loop, through a file in memory that any process of this user may read.

runtime.publisher ─▶ TelemetryWriter ─▶ file ─▶ TelemetryReader ─▶ viewer, recorder
"""

from vehicle_iface.telemetry.address import telemetry_path
from vehicle_iface.telemetry.reader import TelemetryReader
from vehicle_iface.telemetry.snapshot import (
    MAX_POINTS,
    RING_LENGTH,
    DrawnTrajectory,
    DrivingLimits,
    SessionInfo,
    Snapshot,
    VehicleShape,
    WriterState,
)
from vehicle_iface.telemetry.writer import TelemetryWriter

__all__ = [
    "MAX_POINTS",
    "RING_LENGTH",
    "DrawnTrajectory",
    "DrivingLimits",
    "SessionInfo",
    "Snapshot",
    "TelemetryReader",
    "TelemetryWriter",
    "VehicleShape",
    "WriterState",
    "telemetry_path",
]
