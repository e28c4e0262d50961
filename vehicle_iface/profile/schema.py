"""The keys of a profile: one frozen type for each table, in SI units."""

from typing import Annotated, Literal

import msgspec

from vehicle_iface.profile.command_forms import LateralForm, LongitudinalForm, Pedals
from vehicle_iface.profile.forms import Condition, FieldSource, SignalName, SignalNames
from vehicle_iface.profile.notes import MessageNotes, SignalNotes
from vehicle_iface.profile.sends import SentMessage, SentValue
from vehicle_iface.profile.state_pose import StatePose

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Negative = Annotated[float, msgspec.Meta(lt=0.0)]


class Geometry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The vehicle's dimensions; the reference point is the rear axle's centre."""

    wheelbase_m: Positive
    length_m: Positive
    width_m: Positive
    height_m: Positive
    rear_overhang_m: NonNegative
    """From the rear axle to the rear end."""
    track_m: Positive
    wheel_radius_m: Positive


SpeedTable = Annotated[tuple[tuple[NonNegative, Positive], ...], msgspec.Meta(min_length=1)]
"""Rows of speed in m/s (rising, of either direction) and value; linear between rows, constant beyond them."""


class EngagingLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Additional limits until the vehicle reports AUTONOMOUS."""

    front_wheel_rate_radps: Positive
    accel_max_mps2: Positive


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of the commands."""

    front_wheel_angle_rad: Positive
    """To either side."""
    front_wheel_angle_by_speed: SpeedTable
    """Limit of the same angle in rad, by the measured speed."""
    front_wheel_rate_radps: Positive
    front_wheel_deviation_rad: Positive
    """How far the command may be from the measured angle, to either side."""
    lateral_accel_mps2: Positive
    """At the measured speed, to either side."""
    lateral_jerk_mps3: Positive
    """The change of that per second."""
    rear_wheel_angle_rad: NonNegative
    """To either side; 0 where the rear wheels do not steer."""
    rear_wheel_rate_radps: NonNegative
    accel_max_mps2: Positive
    accel_max_by_speed: SpeedTable
    """Limit of the acceleration in m/s², by the measured speed."""
    accel_min_mps2: Negative
    accel_rate_mps3: Positive
    speed_max_mps: Positive
    """Forwards and backwards."""
    unconfirmed_speed_max_mps: Positive = 3.0
    """Limit where no other signal confirms the speed signal (see `motion_sources`)."""
    gear_change_speed_mps: Positive
    """Above it the vehicle refuses another gear."""
    driver_steer_torque_nm: Positive
    """From this torque on the driver steers."""
    while_engaging: EngagingLimits


class Deviation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the vehicle may be from the trajectory and the speed limit."""

    lateral_warn_m: Positive
    """Distance to the path (beside it, before its first point, behind its last) that is counted and shown."""
    lateral_stop_m: Positive
    """Distance to the path that stops the vehicle."""
    heading_stop_rad: Positive
    """Heading error that stops the vehicle."""
    overspeed_mps: NonNegative
    """Speed above `limits.speed_max_mps` that stops the vehicle."""
    rollback_mps: Positive
    """Speed against the requested direction of travel that stops the vehicle."""


class Plausibility(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What this vehicle can do; an implausible sample is dropped, and several in a row stop the vehicle."""

    speed_mps: Positive
    accel_mps2: Positive
    """Positive or negative; between two samples the speed changes by at most this times the time between them …"""
    speed_tolerance_mps: NonNegative
    """… plus this."""
    position_tolerance_m: Positive
    """Between two samples the vehicle moves by at most speed times time plus this."""
    yaw_rate_radps: Positive
    heading_tolerance_rad: Positive
    """Between two samples the vehicle turns by at most yaw rate times time plus this."""
    yaw_rate_tolerance_radps: Positive
    """Between the measured yaw rate and the one that follows from speed and front wheel angle."""
    frozen_distance_m: Positive
    """A position is frozen that stays the same while the speed adds up to this distance …"""
    frozen_time_s: Positive
    """… or for this time …"""
    frozen_min_speed_mps: Positive
    """… at more than this speed."""


class Timing(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Periods of the messages and what counts as late."""

    sample_period_s: Positive
    status_period_s: Positive
    command_period_s: Positive
    body_period_s: Positive
    report_period_s: Positive
    state_stale_s: Positive
    """Without a complete sample for this long the vehicle is stopped."""
    state_silent_s: Positive
    """Without a complete sample for this long nothing is sent."""
    max_command_age_s: Positive
    """No command is computed from an older sample, and none sent."""
    status_stale_s: Positive
    """Without a message from outside the sample for this long the vehicle is stopped."""
    engage_settle_s: Positive
    """Samples must have been fresh for this long before the vehicle is engaged."""
    engage_timeout_s: Positive
    """Engaging is given up when the vehicle does not report AUTONOMOUS within this time."""
    shutdown_s: Positive
    """Longest time to brake to standstill at the end of a run."""
    controller_budget_s: Positive
    """The vehicle is stopped when the controller takes longer for a command."""


class Behavior(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the vehicle is stopped."""

    safe_deceleration_mps2: Positive
    time_step_s: Positive
    stop_jerk_mps3: Positive
    """How fast the brake is applied; drive torque and braking beyond a stop's are removed at once."""
    stop_release_time_constant_s: Positive
    """Speed over deceleration just before standstill: the brake is released in proportion to the speed."""
    hold_deceleration_mps2: NonNegative
    """Requested at standstill, against the gear; 0 where SAFE_STOP alone holds the vehicle."""
    stop_steering: Literal["straight", "hold", "track"] = "straight"
    """`control.StopSteering`: where the wheels are steered during a stop."""


class Recovery(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When driving goes on after a stop: once its cause has been away for this long, in seconds."""

    state_invalid_s: NonNegative = 0.5
    """Pose invalid, samples implausible, sources of motion that disagreed."""
    state_stale_s: NonNegative = 0.2
    frame_mismatch_s: NonNegative = 0.5
    controller_error_s: NonNegative = 0.5
    deadline_missed_s: NonNegative = 0.2
    link_down_s: NonNegative = 0.2
    """The transmit queue had no room."""
    trajectory_s: NonNegative = 0.2
    """No trajectory, an empty one, its end, or a deviation from it."""
    latch_stops: Annotated[int, msgspec.Meta(ge=2)] = 4
    """This many stops that begin within `latch_window_s` latch: the vehicle is held until it is armed again."""
    latch_window_s: Positive = 20.0


class Handover(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How control is given back at a planned end."""

    warning_s: NonNegative
    """The driver is warned this long before."""
    hold_until_warned: bool = False
    """Whether the vehicle is held at standstill until the warning is over; otherwise it is released at standstill."""


class Bus(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The bus that the vehicle is on."""

    bitrate: Annotated[int, msgspec.Meta(gt=0)]
    """Bits per second; of the arbitration phase on CAN FD."""
    fd: bool = False
    data_bitrate: Annotated[int, msgspec.Meta(gt=0)] | None = None
    """Bits per second of the data phase on CAN FD; left out, that of the arbitration phase."""


Byte = Annotated[int, msgspec.Meta(ge=0, le=255)]
DataId = Annotated[int, msgspec.Meta(ge=0, le=0xFFFF)] | tuple[Byte, ...]
"""A number of 16 bits, or a byte for each value of the counter."""
DataIdMode = Literal["BOTH", "ALT", "LOW", "NIBBLE"]


class EndToEnd(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """AUTOSAR end-to-end protection of the messages in `data_ids`."""

    profile: Literal[1, 2, 5, 11]
    data_id_mode: DataIdMode = "BOTH"
    """Profiles 1 and 11 (BOTH or NIBBLE); the others have one way only."""
    crc_signal: str = "CRC"
    counter_signal: str = "COUNTER"
    max_counter_step: Annotated[int, msgspec.Meta(ge=1)] = 3
    """A greater step of the counter is a wrong sequence."""
    data_ids: dict[str, DataId]
    """The data id of each protected message; 16 bytes each in profile 2."""


class Checksum(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a checksum is computed and where it is."""

    signal: str
    """Its name in the message."""
    kind: Literal["autosar-1", "autosar-2", "autosar-5", "autosar-11", "sum", "xor", "crc8", "crc16", "python"]
    over: Annotated[tuple[Literal["id", "length", "bytes", "data_id", "counter"], ...], msgspec.Meta(min_length=1)] = (
        "bytes",
    )
    """What is covered, in this order; `codec.checksums` says as which bytes. A data id that is not named comes last."""
    poly: Annotated[int, msgspec.Meta(ge=1, le=0xFFFF)] | None = None
    """Polynomial of a CRC without its highest power, most significant bit first, also where the CRC is reflected."""
    init: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Value before the first byte."""
    xor_out: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Exclusive or with the result."""
    reflect: bool = False
    """Whether a CRC takes each byte, and gives its result, least significant bit first."""
    table: Annotated[tuple[Byte, ...], msgspec.Meta(min_length=1)] | None = None
    """The data id of messages without one of their own: a byte for each value of the counter, or a single one."""
    data_id_mode: DataIdMode | None = None
    """Of autosar-1 and autosar-11; BOTH where it is left out."""
    function: str | None = None
    """FILE.py:NAME of kind python, relative to the profile: `checksum(can_id: int, data: bytes) -> int`."""


class SequenceCounter(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A counter that steps by one from frame to frame."""

    signal: str
    """Its name in the message."""
    max_step: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """A greater step is a wrong sequence; left out, 3 or as many as the counter's width allows."""


class ProtectionRule(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The protection that several messages have in common: a checksum, a counter, or both."""

    checksum: Checksum | None = None
    counter: SequenceCounter | None = None


class ProtectedMessage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The protection of one message."""

    use: str
    """Name of the rule."""
    data_id: DataId | None = None


class MessageProtection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rules by name, and which message uses which."""

    rules: dict[str, ProtectionRule]
    """In the file they stand beside `messages`: `[protection.NAME]`."""
    messages: dict[str, str | ProtectedMessage]


class StateSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The signals of a `VehicleState`; a field without a signal is 0."""

    x_m: FieldSource | None = None
    """This and the next four: those that the source of the pose needs."""
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
    """How the messages become a sample: those with one counter value, or the newest of each when `trigger` arrives.

    Left out: by the counter where each of several messages is protected by `e2e`, else the newest.
    """
    trigger: str | None = None
    """The message whose arrival completes a sample; left out, the first one."""
    max_age_s: Positive | dict[str, Positive] | None = None
    """No part is older than this when the trigger arrives, for all or by message; left out, `timing.state_stale_s`."""
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
    """The first of these that holds, in this order, is the vehicle's mode; MANUAL when none does."""

    emergency_stop: Condition | None = None
    fault: Condition | None = None
    manual: Condition | None = None
    autonomous: Condition | None = None
    ready: Condition | None = None


class DriverConditions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Any of these is an override."""

    brake: Condition | None = None
    throttle: Condition | None = None
    steering: Condition | None = None


class Status(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the vehicle reports about itself other than its motion."""

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
    """Left out where `send` or `command.values` enables the vehicle."""
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
    """By message; left out, `timing.command_period_s`. Each a whole multiple of `timing.sample_period_s`."""
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
    """What the program reports about itself."""

    signals: ReportSignals


class Profile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One vehicle: its DBC, what the signals mean, and its limits."""

    name: str
    description: str = ""
    dbc: str
    """The DBC file: relative to the profile in its file, absolute here."""
    file: str = ""
    """The file that this profile was read from; not a key in it."""
    reviewed: bool = False
    """Whether somebody has checked limits and signs against the real vehicle."""
    ignored: tuple[SignalName, ...] = ()
    """Signals of bound messages that the program does not use."""
    signals: dict[SignalName, SignalNotes] = {}
    messages: dict[str, MessageNotes] = {}
    constants: dict[SignalName, float] = {}
    """Signals of sent messages that always have one value, in the DBC's units."""
    geometry: Geometry
    limits: Limits
    timing: Timing
    behavior: Behavior
    recovery: Recovery = Recovery()
    handover: Handover = Handover(warning_s=0.0)
    deviation: Deviation
    plausibility: Plausibility
    bus: Bus
    e2e: EndToEnd | None = None
    protection: MessageProtection | None = None
    state: State
    status: Status
    command: Command = Command()
    """Left out where the vehicle is only watched."""
    send: tuple[SentMessage, ...] = ()
    """What is sent besides."""
    body: Body | None = None
    report: Report | None = None

    @property
    def only_watches(self) -> bool:
        """Whether nothing of a command is bound: the vehicle cannot be driven."""
        return self.command.signals == CommandSignals()
