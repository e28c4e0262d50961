"""Conditions of a profile: whether they hold, and values of signals that make them hold."""

from collections.abc import Callable, Iterator, Mapping, Sequence

Condition = str | Mapping[str, object]
"""MESSAGE.SIGNAL, or a table of the profile."""
Values = Mapping[str, float]
"""MESSAGE.SIGNAL → value."""
FindNumber = Callable[[str, object], float]
"""Signal, and a number or a name of its table → the number."""
FindCandidates = Callable[[str], Sequence[float]]
"""Values that a signal can carry, the most ordinary one first."""


def signals_of(condition: object) -> Iterator[str]:
    """All signals that a condition looks at."""
    if isinstance(condition, str):
        yield condition
    elif isinstance(condition, Mapping):
        if "signal" in condition:
            yield str(condition["signal"])
        for part in _parts(condition):
            yield from signals_of(part)


def numbers_of(condition: object, signal: str, find: FindNumber) -> Iterator[float]:
    """The numbers that a condition compares a signal with."""
    if not isinstance(condition, Mapping):
        return
    if condition.get("signal") == signal:
        for number in _compared(condition):
            yield find(signal, number)
    for part in _parts(condition):
        yield from numbers_of(part, signal, find)


def holds(condition: Condition, values: Values, find: FindNumber) -> bool:
    """Whether it holds. A signal without a value fulfils no comparison."""
    if isinstance(condition, str):
        return values.get(condition, 0.0) != 0.0
    if "signal" not in condition:
        found = [holds(part, values, find) for part in _parts(condition)]
        return not found[0] if "not" in condition else (all if "all" in condition else any)(found)
    signal = str(condition["signal"])
    value = values.get(signal)
    if value is None:
        return False
    value = abs(value) if condition.get("magnitude") else value
    if "above" in condition:
        return value > find(signal, condition["above"])
    if "below" in condition:
        return value < find(signal, condition["below"])
    return any(abs(value - find(signal, number)) < 1e-9 for number in _compared(condition))


def satisfy(
    condition: Condition, wanted: bool, given: Values, candidates: FindCandidates, find: FindNumber
) -> Iterator[dict[str, float]]:
    """Every way to make a condition true or false that keeps the given values."""
    is_all = isinstance(condition, Mapping) and "all" in condition
    if isinstance(condition, str) or "signal" in condition:
        signal = condition if isinstance(condition, str) else str(condition["signal"])
        for value in (given[signal],) if signal in given else candidates(signal):
            tried = {**given, signal: value}
            if holds(condition, tried, find) is wanted:
                yield tried
    elif "not" in condition:
        yield from satisfy(_parts(condition)[0], not wanted, given, candidates, find)
    elif is_all is wanted:
        yield from satisfy_all([(part, wanted) for part in _parts(condition)], given, candidates, find)
    else:
        for part in _parts(condition):
            yield from satisfy(part, wanted, given, candidates, find)


def satisfy_all(
    goals: Sequence[tuple[Condition, bool]], given: Values, candidates: FindCandidates, find: FindNumber
) -> Iterator[dict[str, float]]:
    """Every way to meet all goals."""
    if not goals:
        yield dict(given)
        return
    (condition, wanted), *rest = goals
    for values in satisfy(condition, wanted, given, candidates, find):
        yield from satisfy_all(rest, values, candidates, find)


def _parts(condition: Mapping[str, object]) -> list[Condition]:
    found = condition.get("all", condition.get("any"))
    if isinstance(found, list):
        return found
    return [condition["not"]] if "not" in condition else []  # type: ignore[list-item]


def _compared(condition: Mapping[str, object]) -> list[object]:
    among = condition.get("in", ())
    single = [condition[word] for word in ("equals", "above", "below") if word in condition]
    return [*single, *(among if isinstance(among, list) else ())]
