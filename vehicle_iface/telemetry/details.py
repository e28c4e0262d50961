"""Counters of a run, by package and cause: live, for viewer and recorder, and at the end, for the summary.

Causes, messages and signals are keys of dictionaries, because the vehicle defines their names. Everything else is a
field. A field that may be unset is left out of the JSON.
"""

import msgspec
from msgspec import UNSET, UnsetType

from vehicle_iface.telemetry.events import EventKind, Phase

ByCause = dict[str, int]
"""Number of events by cause."""


class LatencySummary(msgspec.Struct, frozen=True, kw_only=True):
    """Latencies in seconds; None when there are none."""

    count: int
    p50_s: float | None
    p95_s: float | None
    p99_s: float | None
    max_s: float | None


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """Absolute differences of a quantity, in its unit; zeros when there are none."""

    mean: float
    p50: float
    p95: float
    max: float


class ShadowSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Differences between this loop's commands and those of another commander."""

    compared: int
    takeovers: int
    unmatched_commands: int
    drops: ByCause
    mismatches: ByCause
    """Commands in which a field differs, by the name of the field."""
    accel_mps2: Spread
    front_wheel_angle_rad: Spread


class LinkDetails(msgspec.Struct, frozen=True, kw_only=True):
    """The link's state and, where the bus supports it, its traffic."""

    state: str
    why: str | UnsetType = UNSET
    """Why the link is in this state; empty while it is UP."""
    load_percent: float | UnsetType = UNSET
    """Bus load; with several buses the greatest."""
    loads_percent: dict[str, float] | UnsetType = UNSET
    """Load of each bus, where there are several."""
    frames_per_s: float | UnsetType = UNSET
    rates_hz: dict[str, float] | UnsetType = UNSET
    """Frame rates by identifier and message, like `0x110 POSE`; with several buses like `ins 0x601 INS_POS`."""


class LinkChange(msgspec.Struct, frozen=True, kw_only=True):
    """A change of the link's state, in seconds since the start of the run."""

    at_s: float
    state: str
    why: str


class LinkSummary(LinkDetails, frozen=True, kw_only=True):
    """The link over a whole run."""

    transitions: list[LinkChange]
    highest_load_percent: float | UnsetType = UNSET


class SampleCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Samples by completeness."""

    complete: int
    incomplete: int
    repeated: int


class Causes(msgspec.Struct, frozen=True, kw_only=True):
    """Counts of what was dropped, limited or rejected, and of what the hardware reported."""

    drops: ByCause = msgspec.field(default_factory=dict)
    lost: ByCause = msgspec.field(default_factory=dict)
    limited: ByCause = msgspec.field(default_factory=dict)
    implausible: ByCause = msgspec.field(default_factory=dict)
    disagreements: ByCause = msgspec.field(default_factory=dict)
    deviations: ByCause = msgspec.field(default_factory=dict)
    tx_blocked: ByCause = msgspec.field(default_factory=dict)
    link_events: ByCause = msgspec.field(default_factory=dict)


class LiveDetails(Causes, frozen=True, kw_only=True):
    """All counters at one time."""

    link: LinkDetails
    shadow: ShadowSummary | UnsetType = UNSET
    loop: ByCause = msgspec.field(default_factory=dict)
    """The counters of the loop, by name."""
    samples: SampleCounts = SampleCounts(complete=0, incomplete=0, repeated=0)
    part_ages_s: dict[str, float] | UnsetType = UNSET
    """By message, the greatest age of a part of a sample by time."""
    odometry_m: float | UnsetType = UNSET
    """The distance of dead reckoning, with which its error grows."""
    trajectory_being_checked: str | UnsetType = UNSET
    """The number of its points, while a new trajectory is checked and so not driven yet."""
    bus: ByCause = msgspec.field(default_factory=dict)

    def shortened(self) -> "LiveDetails":
        """Return a shorter copy: without rates, and with one total for each group of causes."""
        groups = {
            name: {"all": sum(value.values())}
            for name in self.__struct_fields__
            if isinstance(value := getattr(self, name), dict) and name != "part_ages_s"
        }
        link = LinkDetails(state=self.link.state, why=self.link.why)
        return msgspec.structs.replace(self, link=link, part_ages_s=UNSET, **groups)


class Transition(msgspec.Struct, frozen=True, kw_only=True):
    """A change of mode, in seconds since the start of the run."""

    at_s: float
    mode: str
    reason: str


class StopSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One stop, in seconds since the start of the run."""

    at_s: float
    reason: str
    reaction: str
    """`stopped`, `released` to the driver, or `silent`."""
    duration_s: float
    """Until the loop drove on, the reason or the reaction changed, or the run ended."""
    latched: bool
    """Whether only arming or a new trajectory ended it."""


class LimitSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One limit of the gate that acted."""

    commands: int
    """Commands that it changed."""
    times: int
    """How often it began to act, after at least 0.5 s without."""
    duration_s: float
    """Sum of the times from its first to its last command."""


class ErrorSummary(msgspec.Struct, frozen=True, kw_only=True):
    """An error of tracking in its unit, regardless of its sign."""

    rms: float
    p95: float
    max: float


class LapSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of tracking of one lap."""

    samples: int
    lateral_m: ErrorSummary
    heading_rad: ErrorSummary


class TrackingSummary(LapSummary, frozen=True, kw_only=True):
    """Errors of tracking over the run: of each sample that was answered with a command to drive."""

    laps: list[LapSummary]
    """On a closed route the errors of each lap, the first and the last one perhaps incomplete."""


class EventSummary(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One event, in seconds since the start of the run."""

    at_s: float
    kind: EventKind
    name: str
    phase: Phase = Phase.ONCE
    text: str = ""


class RecorderSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The recorder's final status."""

    folder: str
    text: str
    """What was written and lost, in one line."""
    written: ByCause | UnsetType = UNSET
    lost: ByCause | UnsetType = UNSET
    trouble: str | UnsetType = UNSET


class RunSummary(Causes, frozen=True, kw_only=True):
    """Summary of a run."""

    controller_state: str
    reason: str
    bus: str
    wire: str
    """Which code handled the frames: C or Python."""
    latched_fault: str | None
    duration_s: float
    samples: int
    incomplete_samples: int
    commands: int
    deadline_misses: int
    latency: LatencySummary
    counts: ByCause
    bus_counters: ByCause
    link: LinkSummary
    transitions: list[Transition]
    stops: list[StopSummary] = msgspec.field(default_factory=list)
    """The first stops of the run, at most 1000; also that of its end."""
    limits: dict[str, LimitSummary] = msgspec.field(default_factory=dict)
    """The limits that acted, by name as in `limited`."""
    tracking: TrackingSummary | UnsetType = UNSET
    """Unset where nothing was driven."""
    events: list[EventSummary] = msgspec.field(default_factory=list)
    """The newest events of the run, at most 1000."""
    events_left_out: int = 0
    """Number of events before them."""
    part_ages_s: dict[str, float] | UnsetType = UNSET
    """By message, the greatest age of a part of a sample by time."""
    odometry_m: float | UnsetType = UNSET
    """The distance of dead reckoning, with which its error grows."""
    shadow: ShadowSummary | UnsetType = UNSET
    recorder: RecorderSummary | UnsetType = UNSET
    review: str | UnsetType = UNSET
    """Record of the profile's review; only of an armed run on a real bus."""
