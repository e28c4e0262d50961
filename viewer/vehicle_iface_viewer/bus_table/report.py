"""What the viewer asks of the listener, and what the listener reports: one JSON object a line."""

from __future__ import annotations

import msgspec


class ListenRequest(msgspec.Struct, frozen=True, kw_only=True):
    """The first line of the listener's input."""

    profile: str
    """Name or file, as for `run --profile`."""
    channels: dict[str, str]
    """By the name of each bus, the SocketCAN interface; by "" that of the only one."""


class SignalKey(msgspec.Struct, frozen=True, kw_only=True):
    """One signal of one identifier; bus and identifier are written as in a `MessageRow`."""

    bus: str
    can_id: str
    signal: str


class PlotRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Each further line of the listener's input: the signals that are plotted from now on."""

    number: int
    signals: list[SignalKey]


class Samples(msgspec.Struct, frozen=True, array_like=True):
    """Values of one signal, in the unit of the DBC, in the order in which they were received."""

    times_ns: list[int]
    """On the monotonic clock."""
    values: list[float]


class BusSamples(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """All values since the last report, of each plotted signal."""

    request: int
    """Number of the `PlotRequest` whose signals these are, in its order."""
    signals: list[Samples]


class SignalValue(msgspec.Struct, frozen=True, kw_only=True):
    """The last value of a signal."""

    name: str
    value: str
    """A number in `unit`, or the name that the DBC has for it."""
    unit: str = ""
    is_named: bool = False
    """`value` is a name, and has no unit."""
    is_out_of_range: bool = False
    """The DBC does not allow this value."""
    has_changed: bool = False
    """Since the last report."""
    is_absent: bool = False
    """The last frame was of another multiplexer branch."""


class MessageRow(msgspec.Struct, frozen=True, kw_only=True):
    """One message, or one identifier that no DBC has."""

    bus: str
    can_id: str
    """Like `0x110`, or `0x18FEF100` for an extended one."""
    name: str = ""
    """Empty: in no DBC."""
    is_sent: bool = False
    """A message that the loop sends."""
    is_masked: bool = False
    """Other identifiers may be the same message."""
    is_bound: bool = False
    """The profile uses it, so its checksum, counter and ranges are checked as the loop does."""
    frames: int
    """Since the listener's start."""
    rate_hz: float
    """Of the last seconds; 0 when the message has ceased."""
    expected_hz: float | None = None
    """From the profile or the DBC; None: neither states a period."""
    age_s: float
    jitter_s: float | None = None
    """Largest deviation of an interval from the mean one, in the last seconds."""
    counter: int | None = None
    """Value of the last frame; None: the message has none, or is not bound."""
    errors: dict[str, int] = msgspec.field(default_factory=dict)
    """Frames that the loop drops, by cause."""
    data: str
    """Payload of the last frame, hexadecimal."""
    signals: list[SignalValue] = msgspec.field(default_factory=list)

    @property
    def error_count(self) -> int:
        """Number of frames that the loop drops."""
        return sum(self.errors.values())


class BusReport(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """All messages that were seen so far."""

    rows: list[MessageRow] = msgspec.field(default_factory=list)
    frames: int = 0
    error_frames: int = 0
    lost: int = 0
    """Frames that the kernel dropped because the listener was too slow: not errors of the bus."""
    unlisted: int = 0
    """Frames of identifiers beyond the number that is listed."""
    note: str = ""
    """Why there is nothing to receive, where this is no problem."""
    problem: str = ""
    """Why nothing is, or may be, received; empty when all is well."""
