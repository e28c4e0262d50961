"""Fields that come from several signals, and conditions on signals: closed lists of forms, not languages."""

import re
from collections.abc import Iterator
from typing import Annotated

import msgspec

SignalName = str
"""MESSAGE.SIGNAL. Checked in `check`: msgspec 0.22 corrupts memory over a pattern inside a union."""
SIGNAL_NAME = re.compile(r"(?:\w+:)?\w+\.\w+")
"""Pattern of a signal's name; the name of a bus may precede that of the message."""
SignalNames = SignalName | tuple[SignalName, ...]
"""One signal, or several that carry the same value."""


class ConditionTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Either `signal` with one comparison, or one of `all`, `any` and `not`.

    Numbers are compared in SI units, or in the signal's own unit where that is not known. A signal without a value
    satisfies no comparison.
    """

    signal: SignalName | None = None
    equals: float | str | None = None
    """A number, or a name of the signal's table."""
    among: tuple[float | str, ...] | None = msgspec.field(name="in", default=None)
    above: float | None = None
    below: float | None = None
    magnitude: bool = False
    """Compare the signal's magnitude."""
    all: "tuple[Condition, ...] | None" = None
    any: "tuple[Condition, ...] | None" = None
    negated: "Condition | None" = msgspec.field(name="not", default=None)


Condition = SignalName | ConditionTable
"""A signal (is it other than 0?), or a table."""

Signals = Annotated[tuple[SignalName, ...], msgspec.Meta(min_length=1)]


class FieldForm(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One of: the mean of signals, their sum, or a value whose sign another signal carries."""

    mean: Signals | None = None
    sum: Signals | None = None
    value: SignalName | None = None
    negative_if: Condition | None = None
    """Condition under which `value` is negative."""


FieldSource = SignalName | FieldForm
"""Source of a received field."""


_COMPARISONS = ("equals", "among", "above", "below")


def signals_of(form: object) -> Iterator[SignalName]:
    """Return the names of all signals in a form, a condition, or a tuple of names."""
    if isinstance(form, str):
        yield form
    elif isinstance(form, tuple):
        for part in form:
            yield from signals_of(part)
    elif isinstance(form, FieldForm):
        yield from signals_of((form.mean or (), form.sum or (), form.value, form.negative_if))
    elif isinstance(form, ConditionTable):
        yield from signals_of((form.signal, form.all or (), form.any or (), form.negated))


def value_of(form: object) -> object:
    """Return the form without the condition on its sign; anything else unchanged."""
    return msgspec.structs.replace(form, negative_if=None) if isinstance(form, FieldForm) else form


def check_form(form: object, place: str) -> Iterator[str]:
    """Check what the types of a form cannot express; each fault as `place: text`."""
    if isinstance(form, FieldForm):
        kinds = [name for name in ("mean", "sum", "value") if getattr(form, name) is not None]
        if len(kinds) != 1:
            yield f"{place}: must have one of mean, sum and value"
        if form.negative_if is not None and form.value is None:
            yield f"{place}.negative_if: must stand beside value"
        yield from check_form(form.negative_if, f"{place}.negative_if")
    elif isinstance(form, ConditionTable):
        kinds = [name for name in ("signal", "all", "any", "negated") if getattr(form, name) is not None]
        compared = [name for name in _COMPARISONS if getattr(form, name) is not None]
        if len(kinds) != 1:
            yield f"{place}: must have one of signal, all, any and not"
        elif form.signal is None and (compared or form.magnitude):
            yield f"{place}: a comparison must stand beside signal"
        elif form.signal is not None and len(compared) != 1:
            yield f"{place}: must have one of equals, in, above and below"
        for part in (*(form.all or ()), *(form.any or ()), form.negated):
            yield from check_form(part, place)
