"""Keys of a profile that bind its signals to fields: state, status, command, body, report."""

from typing import Annotated, Literal

import msgspec

from vehicle_iface.profile.command_forms import LateralForm, LongitudinalForm, Pedals
from vehicle_iface.profile.forms import Condition, FieldSource, SignalName, SignalNames
from vehicle_iface.profile.numbers import Positive
from vehicle_iface.profile.sends import SentValue
from vehicle_iface.profile.state_pose import StatePose


class StateSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The signals of a `VehicleState`; a field without a signal is 0."""

    x_m: FieldSource | None = None
    """Position x; of this and the next four fields, those that the pose source needs."""
    y_m: FieldSource | None = None
    heading_rad: FieldSource | None = None
    latitude_deg: FieldSource | None = None
    longitude_deg: FieldSource | None = None
    speed_mps: FieldSource
    accel_mps2: FieldSource | None = None
    yaw_rate_radps: FieldSource | None = None
    lateral_speed_mps: FieldSource | None = None
    front_wheel_angle_rad: FieldSource | None = None
    rear_wheel_angle_rad: FieldSource | None = None
    pose_frame: SignalName | None = None
    """The enumeration that `frames` translates."""
    pose_valid: SignalName | None = None
    """0: the pose must not be used."""


class State(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The messages that together are one sample of the vehicle's state."""

    sample: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    signals: StateSignals
    assemble: Literal["counter", "newest"] | None = None
    """Rule for samples: messages with one counter value, or the newest of each when `trigger` arrives.

    Left out: by the counter where each of several messages is protected by `e2e`, else the newest.
    """
    trigger: str | None = None
    """The message whose arrival completes a sample; left out, the first one."""
    max_age_s: Positive | dict[str, Positive] | None = None
    """Maximum age of a part when the trigger arrives, for all or by message; left out, `timing.state_stale_s`."""
    pose: StatePose = StatePose()
    frames: dict[str, str] = {}
    """Name in the VAL_ table of `pose_frame` = frame of reference."""
    frame_id: str = "map"
    """The frame of reference where there is no `pose_frame`; `odom` where it is left out with odometry."""


class StatusSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The signals of a `VehicleStatus`."""

    mode: SignalName | None = None
    """An enumeration; left out where `status.when` says who drives."""
    gear: SignalName | None = None
    driver_brake: SignalName | None = None
    driver_throttle: SignalName | None = None
    driver_steer_torque_nm: SignalName | None = None
    fault_code: SignalName | None = None


class ModeConditions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Conditions of the modes: the first that holds, in this order, is the vehicle's mode; MANUAL when none does."""

    emergency_stop: Condition | None = None
    fault: Condition | None = None
    manual: Condition | None = None
    autonomous: Condition | None = None
    ready: Condition | None = None


class DriverConditions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Conditions of an override by the driver; any of them is one."""

    brake: Condition | None = None
    throttle: Condition | None = None
    steering: Condition | None = None


class Status(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Reports of the vehicle other than its motion."""

    signals: StatusSignals = StatusSignals()
    when: ModeConditions | None = None
    driver: DriverConditions | None = None
    modes: dict[str, str] = {}
    """Name in the DBC = name of `VehicleMode`; a name that is left out is the same, or else a fault."""
    gears: dict[str, str] = {}
    """Name in the DBC = name of `Gear`; a name that is left out is the same, or else no known gear."""


class CommandSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The signals that carry a command; which of them a profile needs follows from `longitudinal` and `lateral`."""

    enable: SignalNames | None = None
    """Enable flag; left out where `send` or `command.values` enables the vehicle."""
    accel_mps2: SignalNames | None = None
    speed_mps: SignalNames | None = None
    """The speed to be driven with longitudinal = "speed"; else the reference speed, for information."""
    drive_mps2: SignalNames | None = None
    """Along the direction of travel, never below 0."""
    brake_mps2: SignalNames | None = None
    """Against the direction of travel, never below 0."""
    throttle: SignalNames | None = None
    """In the signal's own unit, as is `brake`."""
    brake: SignalNames | None = None
    front_wheel_angle_rad: SignalNames | None = None
    curvature_per_m: SignalNames | None = None
    yaw_rate_radps: SignalNames | None = None
    safe_stop: SignalNames | None = None
    rear_wheel_angle_rad: SignalNames | None = None
    reason: SignalNames | None = None
    gear_request: SignalNames | None = None


class Command(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Commands to the vehicle."""

    longitudinal: LongitudinalForm = "acceleration"
    lateral: LateralForm = "wheel_angle"
    signals: CommandSignals = CommandSignals()
    pedals: Pedals | None = None
    periods: dict[str, Positive] = {}
    """Periods by message; left out, `timing.command_period_s`. Each a whole multiple of `timing.sample_period_s`."""
    values: dict[SignalName, SentValue] = {}
    """Signals of command messages that no field fills; left out, the DBC's initial value."""


class BodySignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The signals that carry a `BodyRequest`."""

    hazard_lights: SignalNames | None = None
    headlights: SignalNames | None = None
    turn_indicator: SignalNames | None = None
    horn: SignalNames | None = None


class Body(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Lights and horn."""

    signals: BodySignals


class ReportSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The signals that carry a `ControllerReport`."""

    state: SignalNames | None = None
    reason: SignalNames | None = None
    ref_spatial_index: SignalNames | None = None
    ref_temporal_index: SignalNames | None = None
    deadline_misses: SignalNames | None = None
    handover: SignalNames | None = None
    """1: control is about to be handed over to the driver."""


class Report(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Reports of the program."""

    signals: ReportSignals
