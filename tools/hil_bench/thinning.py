"""Thins a curve: what is left differs nowhere by more than a tolerance, and every corner keeps its instant."""

from collections.abc import Sequence

from hil_bench.result import Series

MOST_POINTS = 600
"""Of a curve; beyond it the tolerance is doubled."""


def thin_series(name: str, at_s: Sequence[float], values: Sequence[float | None], tolerance: float) -> Series:
    """A curve with as few points as `tolerance` (in the unit of the values) allows. None is a gap and stays one."""
    kept = _select(at_s, values, tolerance)
    while len(kept) > MOST_POINTS and tolerance < 1e6:
        tolerance *= 2.0
        kept = _select(at_s, values, tolerance)
    return Series(
        name=name,
        at_s=[round(at_s[i], 3) for i in kept],
        values=[None if (value := values[i]) is None else round(value, 4) for i in kept],
    )


def _select(at_s: Sequence[float], values: Sequence[float | None], tolerance: float) -> list[int]:
    """Indices of the points to keep: a line from the last one stays within the tolerance until the next one."""
    kept: list[int] = []
    anchor, low, high = -1, float("-inf"), float("inf")
    for i, value in enumerate(values):
        before = values[i - 1] if i else None
        if value is None or before is None or anchor < 0:
            if i and before is not None and kept[-1] != i - 1:
                kept.append(i - 1)
            if value is not None or (i and before is not None):
                kept.append(i)
            anchor, low, high = (i if value is not None else -1), float("-inf"), float("inf")
            continue
        start = values[anchor]
        step_s = at_s[i] - at_s[anchor]
        if start is None or step_s <= 0.0:
            continue
        slope = (value - start) / step_s
        if i - 1 > anchor and not low <= slope <= high:
            anchor, low, high = i - 1, float("-inf"), float("inf")
            kept.append(anchor)
            step_s = max(at_s[i] - at_s[anchor], 1e-9)
            start = before
        low, high = max(low, (value - tolerance - start) / step_s), min(high, (value + tolerance - start) / step_s)
    if values and values[-1] is not None and kept[-1:] != [len(values) - 1]:
        kept.append(len(values) - 1)
    return kept
