"""The keys of a profile: one frozen type for each table, in SI units."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from vehicle_iface.profile.forms import SignalName
from vehicle_iface.profile.notes import MessageNotes, SignalNotes
from vehicle_iface.profile.numbers import Negative, NonNegative, Positive
from vehicle_iface.profile.protection import EndToEnd, MessageProtection, locate_function
from vehicle_iface.profile.review_record import ReviewRecord
from vehicle_iface.profile.sends import SentMessage
from vehicle_iface.profile.signals import Body, Command, CommandSignals, Report, State, Status


class Geometry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The vehicle's dimensions; the reference point is the rear axle's centre."""

    wheelbase_m: Positive
    length_m: Positive
    width_m: Positive
    height_m: Positive
    rear_overhang_m: NonNegative
    """Distance from the rear axle to the rear end."""
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
    """Limit of the difference between command and measured angle, to either side."""
    lateral_accel_mps2: Positive
    """At the measured speed, to either side."""
    lateral_jerk_mps3: Positive
    """Limit of the change of lateral acceleration per second."""
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
    """Speed above which the vehicle rejects a gear change."""
    driver_steer_torque_nm: Positive
    """Torque from which on the driver counts as steering."""
    while_engaging: EngagingLimits


class Deviation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of the deviation from the trajectory and the speed limit."""

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
    """Physical limits of the vehicle; an implausible sample is dropped, and several in a row stop the vehicle."""

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
    """Times in seconds after which driving resumes: the cause of the stop must have been absent for this long."""

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
    """Time for which the driver is warned before the release."""
    hold_until_warned: bool = False
    """Whether the vehicle is held at standstill until the warning is over; otherwise it is released at standstill."""


class Bus(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A bus of the vehicle."""

    bitrate: Annotated[int, msgspec.Meta(gt=0)]
    """Bit rate in bits per second; of the arbitration phase on CAN FD."""
    fd: bool = False
    data_bitrate: Annotated[int, msgspec.Meta(gt=0)] | None = None
    """Bits per second of the data phase on CAN FD; left out, that of the arbitration phase."""


class NamedBus(Bus, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A bus and its DBC."""

    dbc: str
    """As `Profile.dbc`."""


class Profile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One vehicle: its DBC, what the signals mean, and its limits."""

    name: str
    description: str = ""
    dbc: str = ""
    """The DBC file: relative to the profile in its file, absolute here. Empty where `buses` has the DBCs."""
    file: str = ""
    """The file that this profile was read from; not a key in it."""
    reviewed: bool = False
    """Whether limits and signs were checked against the real vehicle."""
    review: ReviewRecord | None = None
    """The walk that set `reviewed`; None where it was set by hand."""
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
    bus: Bus | None = None
    """The only bus of the vehicle; left out where `buses` has several."""
    buses: dict[str, NamedBus] = {}
    """Buses by name, instead of `dbc` and `bus`. A frame's `bus` is the index in this order."""
    e2e: EndToEnd | None = None
    protection: MessageProtection | None = None
    state: State
    status: Status
    command: Command = Command()
    """Commands; left out where the vehicle is only watched."""
    send: tuple[SentMessage, ...] = ()
    """Messages that are sent in addition to commands, body and report."""
    body: Body | None = None
    report: Report | None = None

    @property
    def all_buses(self) -> dict[str, NamedBus]:
        """All buses in their order; a single bus has the name ""."""
        if self.bus is None:
            return self.buses
        only = NamedBus(dbc=self.dbc, **msgspec.structs.asdict(self.bus))
        return {"": only}

    @property
    def dbc_files(self) -> list[Path]:
        """The DBCs of all buses in their order."""
        return [Path(bus.dbc) for bus in self.all_buses.values()]

    @property
    def checksum_files(self) -> list[Path]:
        """The Python files with checksum functions that the profile names."""
        rules = self.protection.rules.values() if self.protection else ()
        functions = [rule.checksum.function for rule in rules if rule.checksum and rule.checksum.function]
        return sorted({locate_function(function, Path(self.file).parent).file for function in functions})

    @property
    def only_watches(self) -> bool:
        """Whether nothing of a command is bound: the vehicle cannot be driven."""
        return self.command.signals == CommandSignals()
