"""Which mode and which driver's actions a vehicle reports, and what it must send to report them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from vehicle_bus_contract.reference import AUTONOMOUS, EMERGENCY_STOP, FAULT, MANUAL, READY

from hil_bench.peer.conditions import Condition, holds, numbers_of, satisfy_all, signals_of
from hil_bench.peer.signals import PeerSignal

ORDER = {
    "emergency_stop": EMERGENCY_STOP,
    "fault": FAULT,
    "manual": MANUAL,
    "autonomous": AUTONOMOUS,
    "ready": READY,
}
"""The first condition of `[status.when]` that holds is the mode."""
NEXT_BEST = {
    MANUAL: (MANUAL, READY),
    READY: (READY, MANUAL),
    AUTONOMOUS: (AUTONOMOUS,),
    FAULT: (FAULT, EMERGENCY_STOP, MANUAL, READY),
    EMERGENCY_STOP: (EMERGENCY_STOP, FAULT, MANUAL, READY),
}
"""The modes by which a vehicle may say in which it is; the first that it can express."""
ACTIONS = ("brake", "throttle", "steering")


@dataclass(frozen=True)
class Conditions:
    """The conditions of a profile: `[status.when]`, `[status.driver]`, `valid` and the signs of fields."""

    profile: Mapping[str, Any]
    signals: Mapping[str, PeerSignal]
    _chosen: dict[tuple[object, ...], dict[str, float]] = field(default_factory=dict)

    @property
    def when(self) -> Mapping[str, Condition]:
        """Mode → condition."""
        table: Mapping[str, Condition] = self.profile.get("status", {}).get("when", {})
        return table

    @property
    def driver(self) -> Mapping[str, Condition]:
        """Action → condition."""
        table: Mapping[str, Condition] = self.profile.get("status", {}).get("driver", {})
        return table

    @property
    def valid(self) -> Condition | None:
        """While it holds, the pose may be used."""
        condition: Condition | None = self.profile["state"].get("pose", {}).get("valid")
        return condition

    @cached_property
    def signs(self) -> list[tuple[str, Condition]]:
        """Field → the condition that makes it negative."""
        forms = self.profile["state"]["signals"].items()
        return [
            (name, form["negative_if"]) for name, form in forms if isinstance(form, Mapping) and "negative_if" in form
        ]

    def mode_of(self, values: Mapping[str, float]) -> int:
        """The mode that these values report."""
        return next(
            (mode for name, mode in ORDER.items() if name in self.when and self.holds(self.when[name], values)), 0
        )

    def holds(self, condition: Condition, values: Mapping[str, float]) -> bool:
        """Whether a condition holds."""
        return holds(condition, values, self._number)

    def can_report(self, mode: int) -> bool:
        """Whether some values report exactly this mode."""
        goals = self._mode_goals(mode)
        return goals is not None and next(satisfy_all(goals, {}, self._candidates, self._number), None) is not None

    def choose(
        self, mode: int, actions: Sequence[bool], *, is_valid: bool, signs: Sequence[bool], given: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Values of all signals in conditions; the driver's actions first, then the mode, then the pose."""
        key = (mode, tuple(actions), is_valid, tuple(signs), tuple(sorted(given.items())))
        if key not in self._chosen:
            driver = [(self.driver[name], on) for name, on in zip(ACTIONS, actions, strict=True) if name in self.driver]
            modes = NEXT_BEST[mode] if self.when else ()
            ways = [goals for one in modes if (goals := self._mode_goals(one)) is not None] or [[]]
            more = [(self.valid, is_valid)] if self.valid is not None else []
            more += [(condition, on) for (_, condition), on in zip(self.signs, signs, strict=True)]
            ready = [(self.when["ready"], True)] if mode == AUTONOMOUS and "ready" in self.when else []
            wishes = [
                *([*driver, *way, *more, *ready] for way in ways)
            ]  # an autonomous vehicle is ready, too, if it can
            wishes += [*([*driver, *way, *more] for way in ways), driver, []]
            found = (next(satisfy_all(goals, given, self._candidates, self._number), None) for goals in wishes)
            self._chosen[key] = next(values for values in found if values is not None)
        return self._chosen[key]

    @cached_property
    def names(self) -> frozenset[str]:
        """All signals in conditions."""
        every = [*self.when.values(), *self.driver.values(), *(sign for _, sign in self.signs), self.valid]
        return frozenset(signal for condition in every for signal in signals_of(condition))

    def _mode_goals(self, mode: int) -> list[tuple[Condition, bool]] | None:
        goals: list[tuple[Condition, bool]] = []
        for name, one in ORDER.items():
            if name not in self.when:
                continue
            goals.append((self.when[name], one == mode))
            if one == mode:
                return goals
        return goals if mode == MANUAL else None

    def _number(self, signal: str, number: object) -> float:
        one = self.signals[signal]
        return float(one.names[number] if isinstance(number, str) else number) * one.number_size  # type: ignore[arg-type]

    def _candidates(self, signal: str) -> list[float]:
        """Values on either side of every comparison, of those that the signal can carry."""
        one = self.signals[signal]
        every = [*self.when.values(), *self.driver.values(), *(sign for _, sign in self.signs), self.valid]
        numbers = [number for condition in every for number in numbers_of(condition, signal, self._number)]
        wished = {0.0, one.count, 1.0, -1.0, *map(float, one.names.values())}
        for number in numbers:
            wished |= {sign * (number + way * one.count) for sign in (1.0, -1.0) for way in (-1.0, 0.0, 1.0)}
        carried = {value for value in wished if one.can_carry(value)}
        return sorted(carried, key=lambda value: (abs(value), -value))
