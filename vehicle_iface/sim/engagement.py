"""Engagement of the simulated vehicle: a table of modes, and when a commander gains or loses control."""

from collections import Counter
from collections.abc import Mapping
from enum import Enum, auto

from vehicle_iface.status import VehicleMode

WATCHDOG_PERIODS = 10
"""Commands are lost after this many periods of a kind without an intact one: 100 ms where they come every 10 ms."""
PAIRS_TO_ENGAGE = 3
"""Consecutive intact pairs with ENABLE = 1 that a commander needs."""


class Event(Enum):
    """Events that may change the mode."""

    PAIRS_RECEIVED = auto()
    """`PAIRS_TO_ENGAGE` intact pairs were received, and the driver is not active."""
    RELEASED = auto()
    """An intact command with ENABLE = 0 was received."""
    OVERRIDE = auto()
    """The driver brakes, accelerates or steers."""
    COMMANDS_LOST = auto()
    """The watchdog has expired."""
    FAULT = auto()
    """The vehicle itself has a fault."""
    EMERGENCY_STOP = auto()
    """The emergency stop button was pressed."""
    MADE_READY = auto()
    """The driver hands over control."""
    RESET = auto()
    """The driver acknowledges a fault or releases the emergency stop button."""


_MANUAL, _READY, _AUTONOMOUS, _FAULT, _EMERGENCY_STOP = (
    VehicleMode.MANUAL,
    VehicleMode.READY,
    VehicleMode.AUTONOMOUS,
    VehicleMode.FAULT,
    VehicleMode.EMERGENCY_STOP,
)

TRANSITIONS = {
    (_MANUAL, Event.MADE_READY): _READY,
    (_MANUAL, Event.FAULT): _FAULT,
    (_MANUAL, Event.EMERGENCY_STOP): _EMERGENCY_STOP,
    (_READY, Event.PAIRS_RECEIVED): _AUTONOMOUS,
    (_READY, Event.FAULT): _FAULT,
    (_READY, Event.EMERGENCY_STOP): _EMERGENCY_STOP,
    (_AUTONOMOUS, Event.RELEASED): _READY,
    (_AUTONOMOUS, Event.OVERRIDE): _MANUAL,
    (_AUTONOMOUS, Event.COMMANDS_LOST): _FAULT,
    (_AUTONOMOUS, Event.FAULT): _FAULT,
    (_AUTONOMOUS, Event.EMERGENCY_STOP): _EMERGENCY_STOP,
    (_FAULT, Event.RESET): _MANUAL,
    (_FAULT, Event.EMERGENCY_STOP): _EMERGENCY_STOP,
    (_EMERGENCY_STOP, Event.RESET): _MANUAL,
}
"""Next mode; without an entry the mode stays."""


class CommandWatch:
    """Counts consecutive intact pairs and notices when commands stop.

    A pair is one command of each kind, in any order; two of one kind without the other between them end the streak
    (more of a kind that is sent more often), and so do a damaged one, one with ENABLE = 0 and a gap as long as the
    watchdog's. "No intact command of either kind" is read strictly: each kind by itself must stay fresh,
    since a vehicle that is still steered but no longer braked, or the other way round, is not being driven.
    """

    def __init__(self, periods_ns: Mapping[str, int]) -> None:
        """`periods_ns`: period of each command message; a pair has the slowest once."""
        slowest_ns = max(periods_ns.values(), default=0)
        self._most_per_pair = {kind: round(slowest_ns / period_ns) for kind, period_ns in periods_ns.items()}
        self._patience_ns = {kind: WATCHDOG_PERIODS * period_ns for kind, period_ns in periods_ns.items()}
        self._last_ns: dict[str, int] = {}
        self._half: Counter[str] = Counter()
        self.pairs = 0
        """Complete pairs in the current streak."""

    def note(self, kind: str, *, enabled: bool, seen_ns: int) -> None:
        """Record an intact command of `kind`, on the bus at `seen_ns`."""
        last_ns = self._last_ns.get(kind)
        if last_ns is not None and seen_ns - last_ns >= self._patience_ns[kind]:
            self.reset_streak()
            self._last_ns.clear()  # one gap ends one streak, though the other kind shows it too
        self._last_ns[kind] = seen_ns
        if not enabled or self._half[kind] >= self._most_per_pair[kind]:
            self.reset_streak()
        if enabled:
            self._half[kind] += 1
        if self._half.keys() >= self._patience_ns.keys():
            self._half.clear()
            self.pairs += 1

    def extend_watchdog(self, pause_ns: int) -> None:
        """Extend the deadline: no command could be received for `pause_ns`."""
        self._last_ns = {kind: last_ns + pause_ns for kind, last_ns in self._last_ns.items()}

    def reset_streak(self) -> None:
        """Start counting pairs again."""
        self._half.clear()
        self.pairs = 0

    @property
    def expires_ns(self) -> int | None:
        """Time at which the commands count as lost unless more are received; None before the first of each kind."""
        if not self._patience_ns or len(self._last_ns) < len(self._patience_ns):
            return None
        return min([last_ns + self._patience_ns[kind] for kind, last_ns in self._last_ns.items()])
