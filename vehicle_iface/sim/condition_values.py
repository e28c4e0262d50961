"""Choose values of signals that only conditions use, so that the reported mode and driver are decoded."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from vehicle_iface.codec.expressions import Place, place_of
from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile
from vehicle_iface.profile.forms import Condition, FieldForm
from vehicle_iface.profile.signals import DriverConditions, ModeConditions
from vehicle_iface.sim.condition_solver import (
    Domains,
    Goal,
    candidates,
    holds,
    leaves_of,
    signal_of,
    solve,
)
from vehicle_iface.status import VehicleMode
from vehicle_iface.value import Value

_MANUAL, _READY, _FAULT = VehicleMode.MANUAL, VehicleMode.READY, VehicleMode.FAULT
NEXT_BEST = {
    _MANUAL: (_MANUAL, _READY),
    _READY: (_READY, _MANUAL),
    VehicleMode.AUTONOMOUS: (VehicleMode.AUTONOMOUS, _MANUAL),
    _FAULT: (_FAULT, VehicleMode.EMERGENCY_STOP, _MANUAL, _READY),
    VehicleMode.EMERGENCY_STOP: (VehicleMode.EMERGENCY_STOP, _FAULT, _MANUAL, _READY),
}
"""Modes to report for each mode; the first that the bus can express is used."""


class RowSignal(Value, frozen=True, kw_only=True):
    """A received signal, and its values in the row."""

    view: SignalView
    from_wire: Mapping[int, int] | None
    """The DBC's number → the row's, of an enumeration that the codec translates."""


class Wanted(NamedTuple):
    """What the receiver shall decode."""

    mode: VehicleMode
    brake: bool
    throttle: bool
    steering: bool
    valid: bool
    """Whether the pose is valid."""
    signs: tuple[bool, ...]
    """Names of the fields with a separate sign signal that are negative."""


class ConditionValues:
    """Chooses the values. Where not everything can be expressed at once, the driver has priority, then the mode."""

    def __init__(self, profile: Profile, signals: Mapping[str, RowSignal], fields: Collection[str]) -> None:
        """`fields` are the signals that are bound to fields and have the fields' values.

        Raises `ConfigError` with a line for each condition that no values satisfy.
        """
        self._signals = signals
        status = profile.status
        self._when = status.when or ModeConditions()
        self._driver = status.driver or DriverConditions()
        self._valid = profile.state.pose.valid
        forms = (getattr(profile.state.signals, field) for field in profile.state.signals.__struct_fields__)
        self.signs = tuple(form.negative_if for form in forms if isinstance(form, FieldForm) and form.negative_if)
        """Conditions of the signs, in the order of `Wanted.signs`."""
        leaves = [leaf for condition in self._conditions() for leaf in leaves_of(condition)]
        names = {name for leaf in leaves if (name := signal_of(leaf)) is not None}
        self._domains: Domains = {name: self._domain(name, leaves) for name in names}
        self.fixed = tuple(sorted(name for name in names if name in fields))
        """Signals in conditions that are bound to fields."""
        self.free = tuple(sorted(names - set(self.fixed)))
        """Other signals in conditions."""
        self._fixed_leaves = [leaf for leaf in leaves if signal_of(leaf) in fields]
        self._chosen: dict[tuple[Wanted, tuple[bool, ...]], Mapping[str, float]] = {}
        faults = [f"{Path(profile.file).name}: {text}" for text in self._describe_faults()]
        if faults:
            raise ConfigError("\n".join(faults))

    def __bool__(self) -> bool:
        return bool(self._domains)

    def choose(self, wanted: Wanted, fixed: Mapping[str, float]) -> Mapping[str, float]:
        """Choose the value of each signal in a condition, as in the row; the signals in `fixed` have their values."""
        key = wanted, tuple(holds(leaf, fixed, self.find) for leaf in self._fixed_leaves)
        if key not in self._chosen:
            domains = {name: (fixed[name],) if name in fixed else domain for name, domain in self._domains.items()}
            met: list[Goal] = []
            for alternatives in self._list_goals(wanted):
                met += next((goals for goals in alternatives if solve([*met, *goals], domains, self.find)), [])
            self._chosen[key] = {name: left[0] for name, left in (solve(met, domains, self.find) or domains).items()}
        return {**self._chosen[key], **fixed}

    def find(self, dotted: str) -> Place:
        """Return what the numbers and names of a signal's conditions mean."""
        signal = self._signals[dotted]
        return place_of(0, signal.view, signal.from_wire)

    def can_express(self, mode: VehicleMode) -> bool:
        """Return whether `[status.when]` has the mode."""
        return getattr(self._when, mode.name.lower()) is not None

    def _conditions(self) -> Iterator[Condition]:
        for table in (self._when, self._driver):
            yield from (one for name in table.__struct_fields__ if (one := getattr(table, name)) is not None)
        yield from self.signs
        if self._valid is not None:
            yield self._valid

    def _domain(self, name: str, leaves: list[Condition]) -> tuple[float, ...]:
        signal = self._signals[name]
        if signal.from_wire is not None:
            return tuple(dict.fromkeys(signal.from_wire.values()))
        return candidates(signal.view, (leaf for leaf in leaves if signal_of(leaf) == name), self.find)

    def _list_goals(self, wanted: Wanted) -> Iterator[list[list[Goal]]]:
        """List what shall be decoded, the most important first; each with its alternatives, the best first."""
        driver = [
            Goal(condition, getattr(wanted, name))
            for name in self._driver.__struct_fields__
            if (condition := getattr(self._driver, name)) is not None
        ]
        yield from ([[goal]] for goal in driver if goal.wanted)
        yield [goals for mode in NEXT_BEST[wanted.mode] for goals in self._build_mode_goals(mode)]
        yield from ([[goal]] for goal in driver if not goal.wanted)
        yield from ([[Goal(condition, wanted.valid)]] for condition in (self._valid,) if condition is not None)
        yield from ([[Goal(sign, is_wanted)]] for sign, is_wanted in zip(self.signs, wanted.signs, strict=True))
        if wanted.mode is VehicleMode.AUTONOMOUS and self._when.ready is not None:
            yield [[Goal(self._when.ready, True)]]  # it stays ready: its messages change one after the other

    def _build_mode_goals(self, mode: VehicleMode) -> Iterator[list[Goal]]:
        """Build the goals of a mode: its condition holds and none before it; MANUAL also where none holds."""
        before: list[Goal] = []
        for name in self._when.__struct_fields__:
            condition = getattr(self._when, name)
            if condition is not None and name == mode.name.lower():
                yield [*before, Goal(condition, True)]
            if condition is not None:
                before = [*before, Goal(condition, False)]
        if mode is _MANUAL:
            yield before

    def _describe_faults(self) -> Iterator[str]:
        """Describe the conditions that no values make true."""
        for mode in VehicleMode:
            name, ways = mode.name.lower(), list(self._build_mode_goals(mode))
            if getattr(self._when, name) is not None and solve(ways[0], self._domains, self.find) is None:
                yield f"$.status.when.{name}: no values of its signals make it true and those before it false"
        places = {f"$.status.driver.{name}": getattr(self._driver, name) for name in self._driver.__struct_fields__}
        for place, condition in (places | {"$.state.pose.valid": self._valid}).items():
            if condition is not None and solve([Goal(condition, True)], self._domains, self.find) is None:
                yield f"{place}: no values of its signals make it true"
