"""Tables of a profile, read between their rows."""

from collections.abc import Sequence


def interpolate(table: Sequence[tuple[float, float]], at: float) -> float:
    """The value at `at`, of rows whose first numbers rise: linear between rows, constant beyond them."""
    lower, before = table[0]
    if at <= lower:
        return before
    for upper, after in table:
        if at < upper:
            return before + (after - before) * (at - lower) / (upper - lower)
        lower, before = upper, after
    return before
