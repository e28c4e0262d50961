"""The simulated vehicle's bus as fields: commands received, reports sent, and the wire that makes bytes of them."""

from collections.abc import Mapping
from typing import Protocol

from vehicle_iface.frame import CanFrame
from vehicle_iface.sim.demands import Demands
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.value import Value


class ReceivedMessage(Value, frozen=True):
    """One intact message to the vehicle."""

    name: str
    values: Mapping[str, float | int]
    """Fields of a command, by name: `enable`, `accel_mps2`, `gear_request`, …"""
    signals: Mapping[str, float]
    """Changing signals that no field fills, by name, in the DBC's unit."""


class VehicleReport(Value, frozen=True, kw_only=True):
    """Everything that the vehicle can report at one instant, under the names that profiles use."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    accel_mps2: float
    yaw_rate_radps: float
    lateral_speed_mps: float
    front_wheel_angle_rad: float
    rear_wheel_angle_rad: float
    pose_frame: int
    """The frame of reference's number on the bus."""
    pose_valid: bool
    mode: VehicleMode
    gear: Gear
    driver_brake: bool
    driver_throttle: bool
    driver_steer_torque_nm: float
    fault_code: int


class Wire(Protocol):
    """Between the vehicle's fields and the bytes on its bus."""

    command_periods_ns: Mapping[str, int]
    """Messages that a commander must keep sending, and their periods."""
    sample: tuple[str, ...]
    """Messages of one state sample, in the order in which they are sent."""
    periods_ns: Mapping[str, int]
    """Periods of the messages that it sends, status first: its angle belongs to the sample sent after it."""
    frame_ids: Mapping[str, int]
    """Frames of reference that it can express, and their numbers."""
    requests_gear: bool
    """Whether the commands can request a gear."""
    demands: Demands
    """What the vehicle requires in addition to commands."""

    def find_name(self, frame: CanFrame) -> str | None:
        """Return the message with the frame's identifier; None where the vehicle does not receive it."""
        ...

    def is_known(self, frame: CanFrame) -> bool:
        """Return whether the frame has an identifier of this vehicle's profile."""
        ...

    def read(self, frame: CanFrame) -> ReceivedMessage | None:
        """Decode the frame; None when it is damaged, out of order or invalid."""
        ...

    def write(self, message: str, report: VehicleReport) -> CanFrame:
        """Encode the next frame of `message`; its counter steps."""
        ...
