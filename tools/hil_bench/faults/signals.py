"""Faults of signals: wrong values in sound frames."""

import itertools
from collections.abc import Callable, Collection, Iterable
from contextlib import AbstractContextManager

from hil_bench.contradictions import OPPONENTS
from hil_bench.faults.base import ALWAYS, Injection, NotApplicableError, with_fault
from hil_bench.rig import Rig
from hil_bench.vehicle import Fault, SignalValues
from hil_bench.wrong_fields import WrongFields


class _ChangedSignals(Fault):
    """Passes the signals of the next `count` samples through a function that changes them in place.

    A tick in which none of the messages is sent is no sample.
    """

    def __init__(self, rig: Rig, messages: Collection[str], count: int, change: Callable[[SignalValues], None]) -> None:
        self._vehicle, self._messages, self._left, self._change = rig.vehicle, messages, count, change

    def values(self, values: SignalValues) -> None:
        if self._left > 0 and any(map(self._vehicle.is_due, self._messages)):
            self._left -= 1
            self._change(values)


def _messages_of(rig: Rig, names: Iterable[str]) -> set[str]:
    return {rig.wire.part_of(name) for name in names}


def _change_each(rig: Rig, count: int, change: Callable[[str, float], float], *names: str) -> _ChangedSignals:
    """Pass name and value of each named signal through a function."""

    def change_all(values: SignalValues) -> None:
        for name in names:
            message = values[rig.wire.part_of(name)]
            message[name] = change(name, message[name])

    return _ChangedSignals(rig, _messages_of(rig, names), count, change_all)


def name_value(signal_name: str, value_name: str) -> Injection:
    """Give a signal the number that has this name in the vehicle's DBC."""
    return lambda rig: set_signals(**{signal_name: float(rig.wire.number(signal_name, value_name))})(rig)


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


def swing_signals(**by: float) -> Injection:
    """Add to signals in one sample, and subtract in the next."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        signs = itertools.cycle((1.0, -1.0))

        def change(values: SignalValues) -> None:
            sign = next(signs)
            for name, value in by.items():
                values[rig.wire.part_of(name)][name] += sign * value

        return with_fault(rig, _ChangedSignals(rig, _messages_of(rig, by), ALWAYS, change))

    return inject


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


def tell_wrong(wrong: WrongFields) -> Injection:
    """Tell fields of the state otherwise than they are."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        first: dict[str, float] = {}

        def change(values: SignalValues) -> None:
            true = {name: values[rig.wire.part_of(name)][name] for name in OPPONENTS if rig.wire.has(name)}
            first.update({} if first else true)
            for name, value in wrong.change(true, first).items():
                values[rig.wire.part_of(name)][name] = value

        return with_fault(rig, _ChangedSignals(rig, _messages_of(rig, wrong.fields), ALWAYS, change))

    return inject


def alternate_signals(every: int, **to: float) -> Injection:
    """Give signals these values in every n-th sample."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        ticks = itertools.count()

        def change(values: SignalValues) -> None:
            if next(ticks) % every == 0:
                for name, value in to.items():
                    values[rig.wire.part_of(name)][name] = value

        return with_fault(rig, _ChangedSignals(rig, _messages_of(rig, to), ALWAYS, change))

    return inject


def freeze_sample() -> Injection:
    """Keep all signals of the sample at their present values, under a live counter, while the vehicle moves."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        kept: SignalValues = {}

        def change(values: SignalValues) -> None:
            for name in rig.wire.sample:
                kept.setdefault(name, dict(values[name]))
                values[name].update(kept[name])

        return with_fault(rig, _ChangedSignals(rig, rig.wire.sample, ALWAYS, change))

    return inject
