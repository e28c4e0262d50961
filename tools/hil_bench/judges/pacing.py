"""When commands, lights and reports are sent: in their period, in no burst, and in agreement."""

from collections.abc import Iterable
from itertools import pairwise

from vehicle_bus_contract.judge import SILENCE_NS, Record, find_pairs_beside
from vehicle_bus_contract.reference import MS, S

from hil_bench.wire import Wire

WINDOW_NS = 250 * MS
CROWDED = 0.8
"""Of a period: a vehicle's frames arrive unevenly."""


def find_bursts(wire: Wire, record: Record) -> Iterable[str]:
    """Too many commands in one window. After a gap, pending answers may come at once if they are not too old."""
    timing = wire.profile["timing"]
    period_ns = round(timing["command_period_s"] * S)
    for name in wire.command:
        stamps = [decoded.stamp_ns for decoded in record.of(name)]
        first = 0
        for place, stamp_ns in enumerate(stamps):
            while stamps[first] <= stamp_ns - WINDOW_NS:
                first += 1
            gap_ns = stamps[first] - stamps[first - 1] if first else 0
            owed = min(gap_ns, round(timing["max_command_age_s"] * S)) // period_ns
            if place - first + 1 > 1.2 * WINDOW_NS / period_ns + 1 + max(0, owed - 1):
                yield f"{(stamp_ns - record.begin_ns) / S:.3f} s: {place - first + 1} {name} in 250 ms"


def find_crowded(wire: Wire, record: Record) -> list[float]:
    """When samples came as the third or a later one within a period, s: a device may take them for old ones (S10)."""
    period_ns = CROWDED * wire.period_s * S
    stamps = [sample.stamp_ns for sample in record.samples]
    return [(c - record.begin_ns) / S for a, c in zip(stamps, stamps[2:], strict=False) if c - a < period_ns]


def find_wrong_periods(wire: Wire, record: Record) -> Iterable[str]:
    """BODY_COMMAND and CONTROLLER_STATUS too rarely or too often while there are commands."""
    stretches: list[list[int]] = []
    for pair in record.pairs:
        if not stretches or pair.stamp_ns - stretches[-1][-1] > SILENCE_NS:
            stretches.append([])
        stretches[-1].append(pair.stamp_ns)
    for name, period in (("BODY_COMMAND", "body_period_s"), ("CONTROLLER_STATUS", "report_period_s")):
        if name not in wire.ids:
            continue
        period_ns = round(wire.profile["timing"][period] * S)
        sent_ns = [decoded.stamp_ns for decoded in record.of(name)]
        for stretch in stretches:
            inside = [stamp_ns for stamp_ns in sent_ns if stretch[0] <= stamp_ns <= stretch[-1]]
            for a_ns, b_ns in pairwise([stretch[0], *inside, stretch[-1]]):
                if b_ns - a_ns > 2.5 * period_ns:
                    yield f"{(a_ns - record.begin_ns) / S:.3f} s: no {name} for {(b_ns - a_ns) / S:.3f} s"
        for a_ns, b_ns in zip(sent_ns, sent_ns[4:], strict=False):
            if b_ns - a_ns < 2.5 * period_ns:
                yield f"{(a_ns - record.begin_ns) / S:.3f} s: five {name} within {(b_ns - a_ns) / S:.3f} s"


def find_contradictions(record: Record) -> Iterable[str]:
    """Reports whose reason is not that of a command at the same time."""
    for report in record.of("CONTROLLER_STATUS"):
        beside = {pair.reason for pair in find_pairs_beside(record.pairs, report.stamp_ns)}
        if beside and "REASON" in report.signals and report.reason not in beside:
            at = f"{(report.stamp_ns - record.begin_ns) / S:.3f} s:"
            yield f"{at} CONTROLLER_STATUS has {report.reason}, the commands {' and '.join(sorted(beside))}"
