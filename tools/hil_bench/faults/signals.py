"""Faults of signals: wrong values in sound frames."""

import itertools
from collections.abc import Callable
from contextlib import AbstractContextManager

from hil_bench.faults.base import ALWAYS, Injection, NotApplicableError, with_fault
from hil_bench.rig import Rig
from hil_bench.vehicle import Fault, SignalValues


class _ChangedSignals(Fault):
    """Passes the signals of the next `count` samples through a function that changes them in place."""

    def __init__(self, count: int, change: Callable[[SignalValues], None]) -> None:
        self._left, self._change = count, change

    def values(self, values: SignalValues) -> None:
        if self._left > 0:
            self._left -= 1
            self._change(values)


def _change_each(rig: Rig, count: int, change: Callable[[str, float], float], *names: str) -> _ChangedSignals:
    """Pass name and value of each named signal through a function."""

    def change_all(values: SignalValues) -> None:
        for name in names:
            message = values[rig.wire.part_of(name)]
            message[name] = change(name, message[name])

    return _ChangedSignals(count, change_all)


def set_signals(**to: float) -> Injection:
    """Give signals these values."""
    return lambda rig: with_fault(rig, _change_each(rig, ALWAYS, lambda name, _: to[name], *to))


def exceed_range(name: str) -> Injection:
    """Give a signal a value above the DBC's maximum, as far as its bits allow."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        most, most_of_bits = rig.wire.greatest(name)
        if most_of_bits <= most:
            raise NotApplicableError(f"{name} of this vehicle cannot encode a value beyond its range")
        return set_signals(**{name: min(most_of_bits, most + max(1.0, abs(most)) / 5.0)})(rig)

    return inject


def offset_signals(count: int = ALWAYS, **by: float) -> Injection:
    """Add to signals of the next `count` samples."""
    return lambda rig: with_fault(rig, _change_each(rig, count, lambda name, value: value + by[name], *by))


def scale_signals(**by: float) -> Injection:
    """Multiply signals."""
    return lambda rig: with_fault(rig, _change_each(rig, ALWAYS, lambda name, value: value * by[name], *by))


def freeze_signal(name: str) -> Injection:
    """Keep one signal at its present value."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        first: list[float] = []

        def change(_name: str, value: float) -> float:
            first.append(value)
            return first[0]

        return with_fault(rig, _change_each(rig, ALWAYS, change, name))

    return inject


def alternate_signals(every: int, **to: float) -> Injection:
    """Give signals these values in every n-th sample."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        ticks = itertools.count()

        def change(values: SignalValues) -> None:
            if next(ticks) % every == 0:
                for name, value in to.items():
                    values[rig.wire.part_of(name)][name] = value

        return with_fault(rig, _ChangedSignals(ALWAYS, change))

    return inject


def freeze_sample() -> Injection:
    """Keep all signals of the sample at their present values, under a live counter, while the vehicle moves."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        kept: SignalValues = {}

        def change(values: SignalValues) -> None:
            for name in rig.wire.sample:
                kept.setdefault(name, dict(values[name]))
                values[name].update(kept[name])

        return with_fault(rig, _ChangedSignals(ALWAYS, change))

    return inject
