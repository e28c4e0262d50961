"""The fields of the device's report against what the bus shows: place on the route, time, missed deadlines."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from vehicle_bus_contract.judge import SILENCE_NS, Pair, Record
from vehicle_bus_contract.reference import AUTONOMOUS, ENGAGED, DecodedFrame, S

from hil_bench.routes import Route
from hil_bench.vehicle import Instant
from hil_bench.wire import Wire

SPATIAL, TEMPORAL, MISSES = "REF_SPATIAL_INDEX", "REF_TEMPORAL_INDEX", "DEADLINE_MISSES"
NEAR_M, NEAR_S = 1.0, 0.5
"""Tolerances of the place: along the route, and in its time."""
AGE_S = 0.1
"""How old the state of a report may be."""
SEEN_M = 15.0
"""The route's points that the vehicle may be beside lie within this of the named one."""
UNCOUNTED = 3
"""Missed deadlines that device and bus may see differently, and half of the others."""
SURE, DOUBTFUL = 2.0, 0.5
"""Periods: a later answer is missed by any clock, an earlier one by none."""


def find_wrong_reports(wire: Wire, record: Record, route: Route, history: Sequence[Instant]) -> Iterable[str]:
    """Every report that contradicts the bus. A device may begin at 0 again when it engages again."""
    reports = record.of("CONTROLLER_STATUS")
    if not reports:
        return
    for drive in _drives(record):
        told = [one for one in reports if drive[0].stamp_ns <= one.stamp_ns <= drive[-1].stamp_ns]
        yield from _steps_back(told, record)
        yield from _wrong_place(wire, told, record, route, history)
        yield from _wrong_time(told, record, route)
        yield from _wrong_misses(wire, told, record)


def _drives(record: Record) -> Iterable[list[Pair]]:
    """Stretches of enabled commands without a gap."""
    drive: list[Pair] = []
    for pair in record.pairs:
        if drive and (not pair.is_enabled or pair.stamp_ns - drive[-1].stamp_ns > SILENCE_NS):
            yield drive
            drive = []
        if pair.is_enabled:
            drive.append(pair)
    if drive:
        yield drive


def _steps_back(told: Sequence[DecodedFrame], record: Record) -> Iterable[str]:
    for before, after in pairwise(told):
        for name in (SPATIAL, TEMPORAL, MISSES):
            if name in after.signals and after[name] < before[name]:
                yield f"{_at(after, record)} {name} goes back from {before[name]:.0f} to {after[name]:.0f}"


def _wrong_place(
    wire: Wire, told: Sequence[DecodedFrame], record: Record, route: Route, history: Sequence[Instant]
) -> Iterable[str]:
    """While it drives, the named point is no further from the vehicle than the nearest one, plus a tolerance."""
    place = 0
    for one in told:
        while place + 1 < len(history) and history[place + 1].at_ns <= one.stamp_ns:
            place += 1
        if SPATIAL not in one.signals or one.signals.get("STATE") != ENGAGED or not history:
            continue
        index, at = round(one[SPATIAL]), history[place]
        if at.mode != AUTONOMOUS or index >= _greatest(wire):
            continue
        if index >= len(route.x_m):
            yield f"{_at(one, record)} {SPATIAL} is {index}, and the route has {len(route.x_m)} points"
            continue
        apart_m = math.hypot(route.x_m[index] - at.x_m, route.y_m[index] - at.y_m)
        nearest_m = _nearest_m(route, index, at)
        spacing_m = _spacing_m(route, index)
        if apart_m > nearest_m + NEAR_M + spacing_m + AGE_S * abs(at.speed_mps):
            yield f"{_at(one, record)} {SPATIAL} is {index}, {apart_m:.2f} m from the vehicle"


def _nearest_m(route: Route, index: int, at: Instant) -> float:
    """Distance of the vehicle from the nearest point of the route about the named one."""
    best = math.inf
    for step in (1, -1):
        i, left_m = index, SEEN_M
        while 0 <= i < len(route.x_m) and left_m > 0.0:
            best = min(best, math.hypot(route.x_m[i] - at.x_m, route.y_m[i] - at.y_m))
            left_m -= max(1e-3, _spacing_m(route, i))
            i += step
    return best


def _spacing_m(route: Route, index: int) -> float:
    a, b = max(0, min(index, len(route.x_m) - 2)), max(1, min(index + 1, len(route.x_m) - 1))
    return math.hypot(route.x_m[b] - route.x_m[a], route.y_m[b] - route.y_m[a])


def _wrong_time(told: Sequence[DecodedFrame], record: Record, route: Route) -> Iterable[str]:
    """From the first report of a drive on, the times of the named points pass as the time does."""
    moving = [one for one in told if TEMPORAL in one.signals and one.signals.get("STATE") == ENGAGED]
    if len(moving) < 2:
        return
    first = moving[0]
    for one in moving[1:]:
        begin, index = round(first[TEMPORAL]), round(one[TEMPORAL])
        if not (0 <= begin < len(route.time_s) - 1 and 0 <= index < len(route.time_s) - 1):
            continue
        passed_s = (one.stamp_ns - first.stamp_ns) / S
        slack_s = NEAR_S + max(route.time_s[i + 1] - route.time_s[i] for i in (begin, index))
        if abs(route.time_s[index] - route.time_s[begin] - passed_s) > slack_s:
            yield (
                f"{_at(one, record)} {TEMPORAL} goes from {begin} to {index} in {passed_s:.2f} s, "
                f"which is {route.time_s[index] - route.time_s[begin]:.2f} s of the route"
            )


def _wrong_misses(wire: Wire, told: Sequence[DecodedFrame], record: Record) -> Iterable[str]:
    """More misses than late or missing answers, or much fewer. At its greatest value the count stays."""
    if len(told) < 2 or MISSES not in told[-1].signals or told[-1][MISSES] >= 255:
        return
    begin_ns, end_ns = told[0].stamp_ns, told[-1].stamp_ns
    answers = [((p.stamp_ns - at_ns) / S, p) for at_ns, p in record.answers if begin_ns <= p.stamp_ns <= end_ns]
    period_s = wire.command_period_s
    most = sum(late_s > DOUBTFUL * period_s for late_s, _ in answers) + len(record.unanswered)
    # A stop may be sent at its own time, without the sample that it is counted for here.
    least = sum(late_s > SURE * period_s for late_s, pair in answers if not pair.is_stop)
    counted = told[-1][MISSES] - told[0][MISSES]
    if counted > most + UNCOUNTED:
        yield f"{_at(told[-1], record)} {MISSES} rose by {counted:.0f}, and {most} answers were late or missing"
    if counted < 0.5 * least - UNCOUNTED:
        yield f"{_at(told[-1], record)} {MISSES} rose by {counted:.0f}, and {least} answers came after two periods"


def _greatest(wire: Wire) -> int:
    return 65535 if "CONTROLLER_STATUS" in wire.reports else 1 << 31


def _at(one: DecodedFrame, record: Record) -> str:
    return f"{(one.stamp_ns - record.begin_ns) / S:.3f} s:"
