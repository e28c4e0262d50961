"""What a vehicle requires in addition to its commands, derived from what its profile sends.

An echo in the profile is a handshake: the vehicle sends one of two values until it comes back, then the other one. A
value that is missing for ten periods means a lost commander. Where no command has an enable, the vehicle is enabled by
what the profile sends while engaging, and released when that ends. Nothing else is required: a profile
does not define what a vehicle expects of other messages.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import msgspec

from vehicle_iface.codec.database import BoundMessage, VehicleDatabase
from vehicle_iface.profile import Profile
from vehicle_iface.profile.sends import ENABLING, ValueTable
from vehicle_iface.sim.condition_solver import zero_and_more
from vehicle_iface.sim.engagement import WATCHDOG_PERIODS
from vehicle_iface.units import ns_from_s

_ROUNDING = 1e-6
TURNS_TO_ENGAGE = 2
"""Number of echoes needed to engage: each value of a handshake once."""


class Handshake(msgspec.Struct, eq=False):
    """One signal of the vehicle that alternates, and a signal of its commander that follows."""

    message: str
    signal: str
    """Signals of the commander."""
    values: tuple[float, float]
    patience_ns: int
    turns: int = 0
    """Number of consecutive values that were echoed in time."""
    since_ns: int | None = None
    """Time of the last echo."""

    @property
    def value(self) -> float:
        """Value that the vehicle sends until it is echoed."""
        return self.values[self.turns % 2]

    @property
    def expires_ns(self) -> int | None:
        """Time at which the commander counts as lost; None before its first echo."""
        return self.since_ns + self.patience_ns if self.since_ns is not None else None

    def note(self, value: float | None, seen_ns: int) -> None:
        """Record a value sent by the commander."""
        if value is None or abs(value - self.value) > _ROUNDING:
            return
        if self.expires_ns is not None and seen_ns >= self.expires_ns:
            self.turns %= 2  # a streak of its own, on the same value
        self.turns += 1
        self.since_ns = seen_ns


class _Value(NamedTuple):
    """A value that depends on the phase of the run."""

    message: str
    signal: str
    value: float
    tolerance: float
    """Half a count of the signal."""
    when: str

    def is_in(self, signals: Mapping[str, float]) -> bool:
        """Return whether a message has the value."""
        return self.signal in signals and abs(signals[self.signal] - self.value) <= self.tolerance


class Demands:
    """Records received messages, and checks them against what a vehicle of the profile requires."""

    def __init__(self, database: VehicleDatabase) -> None:
        profile = database.profile
        self.handshakes = dict(_handshakes(database))
        """Handshakes by the vehicle's MESSAGE.SIGNAL."""
        has_enable = profile.command.signals.enable is not None
        self._values = [] if has_enable else list(_phased_values(database))
        self._enabling = set[str]()
        self._disabling = set[str]()
        if not has_enable:
            self._enabling |= {one.message for one in profile.send if one.when in ENABLING}
            self._disabling |= {one.message for one in profile.send if one.when == "released"}
        self._holds = {one: False for one in self._values if one.when in ENABLING}
        self._came: set[str] = set()

    def note(self, name: str, signals: Mapping[str, float], seen_ns: int) -> bool:
        """Record an intact message by its values that no field fills; return whether it releases the vehicle."""
        for handshake in self.handshakes.values():
            if handshake.message == name:
                handshake.note(signals.get(handshake.signal), seen_ns)
        self._came.add(name)
        releases = name in self._disabling
        for one in self._values:
            if one.message != name:
                continue
            holds = one.is_in(signals)
            releases |= holds is (one.when == "released") and one.when in ("enabled", "released")
            if one in self._holds:
                self._holds[one] = holds
        return releases

    def are_met(self, now_ns: int) -> bool:
        """Return whether everything required to engage was received."""
        is_enabled = self._enabling <= self._came and all(self._holds.values())
        return is_enabled and all(
            one.turns >= TURNS_TO_ENGAGE and one.expires_ns is not None and now_ns < one.expires_ns
            for one in self.handshakes.values()
        )

    @property
    def expires_ns(self) -> int | None:
        """Time at which the commander counts as lost unless a handshake continues; None without a handshake."""
        deadlines_ns = [one.expires_ns for one in self.handshakes.values() if one.expires_ns is not None]
        return min(deadlines_ns, default=None)

    def extend(self, pause_ns: int) -> None:
        """Extend the deadlines: nothing could be received for `pause_ns`."""
        for one in self.handshakes.values():
            one.since_ns = None if one.since_ns is None else one.since_ns + pause_ns

    def forget(self) -> None:
        """Reset on a change of mode: enabling messages must be received again."""
        self._came.clear()


def _handshakes(database: VehicleDatabase) -> Iterator[tuple[str, Handshake]]:
    """List the handshakes: each echoed signal without another meaning, with the first signal that echoes it."""
    received = {message.name: message for message in database.received}
    found: dict[str, Handshake] = {}
    for name, signal, source, period_s in _sent_values(database.profile):
        if not isinstance(source, ValueTable) or source.echo is None or source.echo in found:
            continue
        message, _, echoed = source.echo.partition(".")
        if _is_free(received[message], echoed):
            view = received[message].signals[received[message].codec.names.index(echoed)]
            patience_ns = WATCHDOG_PERIODS * ns_from_s(period_s)
            found[source.echo] = Handshake(name, signal, zero_and_more(view), patience_ns)
    yield from found.items()


def _is_free(message: BoundMessage, signal: str) -> bool:
    """Return whether the simulation may choose the signal's value: it has no other meaning."""
    return not message.fields[message.codec.names.index(signal)]


def _phased_values(database: VehicleDatabase) -> Iterator[_Value]:
    sent = {message.name: message for message in database.sent}
    for name, signal, source, _ in _sent_values(database.profile):
        if isinstance(source, ValueTable) and source.value is not None and source.when is not None:
            view = sent[name].signals[sent[name].codec.names.index(signal)]
            yield _Value(name, signal, source.value, abs(view.signal.scale) / 2 + _ROUNDING, source.when)


def _sent_values(profile: Profile) -> Iterator[tuple[str, str, object, float]]:
    """List message, signal, value and period of all sent signals that no field fills."""
    periods_s: Mapping[str, float] = profile.command.periods
    for dotted, source in profile.command.values.items():
        name, _, signal = dotted.partition(".")
        yield name, signal, source, periods_s.get(name, profile.timing.command_period_s)
    for sent in profile.send:
        for signal, value in sent.values.items():
            yield sent.message, signal, value, sent.period_s or profile.timing.command_period_s
