"""How regularly the device sends: its answers after their samples, its other messages in their periods."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

from vehicle_bus_contract.judge import SILENCE_NS, Record
from vehicle_bus_contract.reference import S

from hil_bench.expect import check
from hil_bench.result import Check
from hil_bench.wire import Wire

JITTER_SHARE = 0.2
"""Of a period: a message may be so much earlier or later than usual, but for `STRAY_SHARE` of them."""
STRAY_SHARE = 0.1
MEAN_SHARE = 0.1
"""Of a period: tolerance of its mean. A message that is sent with a command may also wait for that command."""
FEWEST = 50
"""Answers from which a share can be told."""
EQUALLY_LATE = "90 % of the answers come equally late, within a fifth of a period"
BLOCK = 20
"""Periods that are judged together."""


def check_jitter(wire: Wire, latencies_s: Sequence[float], periods_s: Sequence[float]) -> list[Check]:
    """90 % of the answers come equally late, within a fifth of a period; of slow commands, their periods are equal."""
    if len(latencies_s) < FEWEST or len(periods_s) < FEWEST:
        return []
    if wire.command_period_s > wire.period_s * 1.01:
        text = "90 % of the command periods are right, within a fifth and a sample's period"
        limit_s = JITTER_SHARE * wire.command_period_s + wire.period_s
        return [check(text, [], _most(periods_s, wire.command_period_s), limit_s)]
    usual_s = sorted(latencies_s)[len(latencies_s) // 2]
    return [check(EQUALLY_LATE, [], _most(latencies_s, usual_s), JITTER_SHARE * wire.period_s)]


def find_irregular(wire: Wire, record: Record) -> Iterable[str]:
    """Messages besides commands whose periods, 20 after one another, are wrong on average or scatter."""
    for name, period_s in wire.besides_s.items():
        sent_ns = [decoded.stamp_ns for decoded in record.of(name)]
        for begin_ns, end_ns in _stretches(record):
            inside = [stamp_ns for stamp_ns in sent_ns if begin_ns <= stamp_ns <= end_ns]
            for first in range(0, len(inside) - BLOCK, BLOCK):
                yield from _irregular(wire, record, name, period_s, inside[first : first + BLOCK + 1])


def _irregular(wire: Wire, record: Record, name: str, period_s: float, stamps_ns: Sequence[int]) -> Iterable[str]:
    mean_s = (stamps_ns[-1] - stamps_ns[0]) / (len(stamps_ns) - 1) / S
    worst_ns = max(pairwise(stamps_ns), key=lambda gap: abs((gap[1] - gap[0]) / S - period_s))[1]
    at = f"{(worst_ns - record.begin_ns) / S:.3f} s:"
    waits_s = wire.command_period_s
    if not (1.0 - MEAN_SHARE) * period_s <= mean_s <= (1.0 + MEAN_SHARE) * period_s + waits_s:
        yield f"{at} {name} every {mean_s * 1e3:.1f} ms, where its period is {period_s * 1e3:.0f} ms"
    gaps = [(b - a) / S for a, b in pairwise(stamps_ns)]
    wrong = [gap_s for gap_s in gaps if abs(gap_s - period_s) > JITTER_SHARE * period_s + waits_s]
    if len(wrong) > STRAY_SHARE * len(gaps):
        yield (
            f"{at} {name} in periods of {min(gaps) * 1e3:.1f} to {max(gaps) * 1e3:.1f} ms, "
            f"{len(wrong)} of {len(gaps)} not about {period_s * 1e3:.0f} ms"
        )


def _most(values_s: Sequence[float], usual_s: float) -> float:
    """How far the values are from the usual one, but for the `STRAY_SHARE` that are furthest."""
    apart_s = sorted(abs(value - usual_s) for value in values_s)
    return apart_s[round((1.0 - STRAY_SHARE) * (len(apart_s) - 1))]


def _stretches(record: Record) -> Iterable[tuple[int, int]]:
    """Begin and end of each stretch of commands without a gap, ns."""
    if not record.pairs:
        return
    begin_ns = record.pairs[0].stamp_ns
    for before, after in pairwise(record.pairs):
        if after.stamp_ns - before.stamp_ns > SILENCE_NS:
            yield begin_ns, before.stamp_ns
            begin_ns = after.stamp_ns
    yield begin_ns, record.pairs[-1].stamp_ns
