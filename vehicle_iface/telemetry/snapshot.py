"""Published data: one snapshot for each pass, the session, the trajectory for drawing.

Adding a field: write it into `Snapshot`, with a flag beside it when it can be missing. The layout and its fingerprint
follow from the annotations, and a reader of another layout reports that instead of guessing.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import NamedTuple, ParamSpec

from vehicle_iface import checks
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.value import Value

RING_LENGTH = 512
"""Snapshots kept for readers: a reader that is later drops some. 5 s at 100 Hz."""
MAX_POINTS = 512
"""Points of a trajectory that are published for drawing."""


_Fields = ParamSpec("_Fields")


class Snapshot(NamedTuple):
    """State of the loop at the end of one pass. A group of fields is valid only where its flag is set."""

    # A plain tuple because it is packed in the loop: one call, no conversion per field.
    published_ns: int
    """When this was published, nanoseconds of the monotonic clock."""
    controller_state: int
    """A `ControllerState`."""
    reason: int
    """A `Reason`."""

    has_state: bool = False
    """A state has been received; `stamp_ns` is its time."""
    stamp_ns: int = 0
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    speed_mps: float = 0.0
    accel_mps2: float = 0.0
    yaw_rate_radps: float = 0.0
    lateral_speed_mps: float = 0.0
    front_wheel_angle_rad: float = 0.0
    rear_wheel_angle_rad: float = 0.0

    has_status: bool = False
    """The vehicle's status has been received."""
    vehicle_mode: int = 0
    """A `VehicleMode`."""
    gear: int = 0
    """A `Gear`; NO_REQUEST where the vehicle does not report it."""

    trajectory_version: int = 0
    """Which trajectory is in force (`TelemetryWriter.publish_trajectory`); 0: none yet."""
    has_reference: bool = False
    """The controller has found the vehicle on the trajectory."""
    spatial_index: int = 0
    temporal_index: int = 0
    spatial_reference_x_m: float = 0.0
    spatial_reference_y_m: float = 0.0
    temporal_reference_x_m: float = 0.0
    temporal_reference_y_m: float = 0.0
    reference_speed_mps: float = 0.0
    lateral_error_m: float = 0.0
    """Positive when the vehicle is to the left of the reference."""
    heading_error_rad: float = 0.0
    """Positive when the vehicle's heading is to the left of the reference's."""

    has_lookahead: bool = False
    lookahead_x_m: float = 0.0
    lookahead_y_m: float = 0.0

    has_requested: bool = False
    """The controller computed a command."""
    requested_accel_mps2: float = 0.0
    requested_front_wheel_angle_rad: float = 0.0

    sent: bool = False
    """A command was sent in this pass; `latency_ns` belongs to it."""
    sent_accel_mps2: float = 0.0
    sent_front_wheel_angle_rad: float = 0.0
    latency_ns: int = 0
    """From the arrival of the sample's last frame to the sending of the command."""

    samples: int = 0
    """Complete samples received since the start."""
    commands: int = 0
    """Commands sent since the start."""
    drops: int = 0
    """Frames dropped since the start, whatever the cause; `publish_details` has them by cause."""
    deadline_misses: int = 0

    handover_pending: bool = False
    """Control is about to be returned to the driver."""
    handover_in_ns: int = 0
    """Time until the release, at the earliest; 0: as soon as the vehicle stands."""

    frame_id: str = "map"
    """Frame of reference of all positions here."""
    sequence: int = 0
    """Number of the snapshot in its session, from 1. Set by the writer; a value given here is ignored."""


def _by_position(_: Callable[_Fields, Snapshot]) -> Callable[_Fields, Snapshot]:
    def make(*values: _Fields.args, **_: _Fields.kwargs) -> Snapshot:
        return tuple.__new__(Snapshot, values)

    return make


make_snapshot = _by_position(Snapshot)
"""A snapshot of all its fields by position, in half the time that `Snapshot` takes; type checkers compare the types."""


class VehicleShape(Value, frozen=True, kw_only=True):
    """Size of the vehicle, for drawing. The origin is the centre of the rear axle."""

    wheelbase_m: float = 2.7
    length_m: float = 4.5
    width_m: float = 1.85
    height_m: float = 1.5
    rear_overhang_m: float = 0.9
    track_m: float = 1.6
    wheel_radius_m: float = 0.33

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            checks.positive(name, getattr(self, name))


class DrivingLimits(Value, frozen=True, kw_only=True):
    """Limits of the profile, for the ranges of the plots."""

    speed_max_mps: float = 20.0
    accel_min_mps2: float = -6.0
    accel_max_mps2: float = 3.0
    front_wheel_angle_rad: float = 0.6
    """To either side."""
    lateral_warn_m: float = 1.0
    """Distance to the path that is counted and shown."""
    heading_stop_rad: float = 0.8
    """Heading error that stops the vehicle."""

    def __post_init__(self) -> None:
        checks.positive("-accel_min_mps2", -self.accel_min_mps2)
        for name in self.__struct_fields__:
            if name != "accel_min_mps2":
                checks.positive(name, getattr(self, name))


class SessionInfo(Value, frozen=True, kw_only=True):
    """Constant data of one run of the loop."""

    channel: str
    bus: str
    """Kind of bus, as text: "SocketCAN vcan0"."""
    bus_hint: str = ""
    """How to use a real bus, where this is not one."""
    profile: str = ""
    unprotected: tuple[str, ...] = ()
    """Messages of state and command that have neither checksum nor counter."""
    route: str = ""
    """The route's name or the trajectory file's."""
    arming: str = "shadow"
    """"armed" or "shadow"."""
    period_s: float = 0.01
    pid: int = 0
    """The loop's process; 0: unknown."""
    recording: str = ""
    """The folder of the recording; empty when the run is not recorded."""
    shape: VehicleShape = VehicleShape()
    limits: DrivingLimits = DrivingLimits()


class DrawnTrajectory(Value, frozen=True, kw_only=True, eq=False):
    """A trajectory as published: at most `MAX_POINTS` of its points, always with the first and the last."""

    version: int
    stamp_ns: int
    frame_id: str
    original_count: int
    """Number of points of the trajectory itself."""
    x_m: FloatArray
    """(n,)"""
    y_m: FloatArray
    """(n,)"""
    heading_rad: FloatArray
    """(n,)"""
    speed_mps: FloatArray
    """(n,)"""
    time_s: FloatArray
    """(n,) from `stamp_ns` on."""


class WriterState(Enum):
    """State of the writer at a reader's address."""

    ABSENT = "absent"
    """No file: no loop has run since the machine started."""
    LIVE = "live"
    """A session whose writer has not closed it. Check timestamps for freshness."""
    ENDED = "ended"
    """The writer closed the session."""
    DEAD = "dead"
    """The writer terminated without closing the session."""
    OTHER_VERSION = "other version"
    """Written by a program with another layout."""
    UNREADABLE = "unreadable"
    """Not a telemetry file, damaged, truncated, or not readable by this user."""
