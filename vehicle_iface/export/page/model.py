"""The data of a page, as its JavaScript reads them."""

import msgspec


class Packed(msgspec.Struct, kw_only=True, frozen=True):
    """Numbers as text: see `packing`."""

    decimals: int
    offset: float = 0.0
    data: str


class Curve(msgspec.Struct, kw_only=True, frozen=True):
    """One curve of a plot."""

    drive: int
    """Index of the drive whose times it has."""
    key: str
    """Name of the column in CSV; with its unit."""
    label: str
    color: str
    """A CSS variable of the page."""
    width: float = 1.6
    is_stepped: bool = False
    """A value holds until the next one."""
    values: Packed
    """As many as the drive has times; NaN where nothing is known."""


class Plot(msgspec.Struct, kw_only=True, frozen=True):
    """One plot: curves of one unit."""

    title: str
    unit: str
    digits: int
    """Decimals of the values at the cursor."""
    low: float | None = None
    """Range of the vertical axis; it grows with the values. None: that of the values."""
    high: float | None = None
    limits: list[float] = []
    """Horizontal lines."""
    curves: list[Curve]


class StateSpan(msgspec.Struct, array_like=True, frozen=True):
    """What is true from a time on, as text; empty where it is unknown."""

    at_s: float
    state: str
    reason: str
    vehicle_mode: str
    gear: str


class PageEvent(msgspec.Struct, kw_only=True, frozen=True):
    """One event of a drive."""

    at_s: float
    kind: str
    name: str
    phase: str = ""
    text: str = ""


class Ticks(msgspec.Struct, kw_only=True, frozen=True):
    """Times in s at which something happened that is marked on the strip of states."""

    label: str
    color: str
    at_s: list[float]


class PathLine(msgspec.Struct, kw_only=True, frozen=True):
    """A line in the plane, in m."""

    x: Packed
    y: Packed


class Track(msgspec.Struct, kw_only=True, frozen=True):
    """Where the vehicle was at each time, and its size."""

    x: Packed
    y: Packed
    heading: Packed
    reference_x: Packed
    """The point of the path that the vehicle was to be at."""
    reference_y: Packed
    length_m: float
    width_m: float
    height_m: float
    wheelbase_m: float
    rear_overhang_m: float
    paths: PathLine
    """The trajectories that it was to follow, with gaps between them."""


class Drive(msgspec.Struct, kw_only=True, frozen=True):
    """One drive on the page."""

    label: str
    color: str
    """Of its track; a CSS variable."""
    time: Packed
    """Times of the rows, s: the horizontal axis, unless the way is chosen."""
    way: Packed | None = None
    """How far along the path it was at each time, m; None where it cannot be compared."""
    states: list[StateSpan] = []
    ticks: list[Ticks] = []
    events: list[PageEvent] = []
    events_left_out: int = 0
    track: Track | None = None


class Page(msgspec.Struct, kw_only=True, frozen=True):
    """Everything that the JavaScript shows."""

    name: str
    """Beginning of the names of files that are saved."""
    drives: list[Drive]
    plots: list[Plot]
    has_way: bool
    """Whether the way can be the horizontal axis."""
