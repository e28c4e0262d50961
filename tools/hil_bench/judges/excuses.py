"""Which failed checks a late bench or a slow host can explain. The content of frames it never can."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import S

from hil_bench.judges.answers import HALF_ARE_PROMPT, NEARLY_ALL_ARE_PROMPT, NONE_IS_TOO_LATE
from hil_bench.judges.health import DRIVES_AFTERWARDS, DRIVES_AT, ENDS, ENGAGES
from hil_bench.judges.protocol import KINDS
from hil_bench.judges.regularity import EQUALLY_LATE
from hil_bench.lateness import Lateness
from hil_bench.result import Check, Verdict

CONTENT = ("damaged", "counter", "command", "dynamics", "brakes", "stop_steering", "release", "unarmed", "report")
"""Findings in the content of frames: no lateness can explain them."""
RATES = re.compile("faster|swerve|later than its jerk|DEADLINE_MISSES rose")
"""But it can explain wrong rates, which are computed from stamps."""
LATE_ANSWERS = (HALF_ARE_PROMPT, EQUALLY_LATE, NEARLY_ALL_ARE_PROMPT, NONE_IS_TOO_LATE, KINDS["burst"])
"""Checks that a sound device on a slow host fails first."""
HOST_DEPENDENT = (*LATE_ANSWERS, KINDS["unanswered"], KINDS["silence"], ENGAGES, DRIVES_AT)
"""Beginnings of all checks that a slow host can fail, even where the bench measured no delay of its own."""
ONE_DELAY = (DRIVES_AFTERWARDS, ENDS)
"""Checks that a single delay of the host may fail: they count if they fail twice in a row."""
HOST_TOO_SLOW = "host too slow"
BEFORE_S, AFTER_S = 0.15, 1.0
"""A finding may follow from a delay that is so near: a stop lasts until the state has been good again for a while."""
VOID_S = 0.1
"""A delay as long as this may latch a device or end its drive: whatever came of it, only content counts."""
SHARE = 0.5
"""Of all the time by which answers were later than the quickest: what the host must have caused."""
QUICK = 0.05


@dataclass(frozen=True, kw_only=True)
class Failed:
    """The failed checks of a case, by what they are about."""

    state: Sequence[Check] = ()
    """Whether the device runs, engages, drives, holds, and ends: what a delay may have led to much later."""
    expected: Sequence[Check] = ()
    """The expectations of the case."""
    answers: Sequence[Check] = ()
    """Latency and jitter."""
    protocol: Sequence[Check] = ()
    others: Sequence[Check] = ()
    content: Sequence[Check] = ()
    """What no lateness explains, besides the protocol's own."""
    start: Sequence[Check] = ()
    """That the device ran, but had not engaged when its time was over."""

    @property
    def all(self) -> list[Check]:
        """In the order in which they are reported."""
        return [*self.start, *self.state, *self.expected, *self.others, *self.content, *self.answers, *self.protocol]


def select_unexplained(failed: Failed, lateness: Lateness, record: Record) -> list[Check]:
    """The failed checks that the lateness does not explain.

    What a device should have done is not judged after a delay because of which it may not have driven at all. If it did
    not engage in its time, any delay since its start may be why.
    """
    if failed.start and lateness.delays:
        return [*failed.content, *select_content(failed.protocol)]
    is_void = lateness.worst is not None and lateness.worst.by_s >= VOID_S
    found = [] if lateness.delays else [*failed.start, *failed.state]
    if not is_void and (found or not failed.state):
        found += [one for one in failed.expected if not _is_explained(one, lateness)]
    if not is_void:
        found += failed.others
    found += failed.content
    is_slow = _is_slow(lateness, record)
    if not (is_void or is_slow):
        found += [one for one in failed.answers if not _is_explained(one, lateness, only_worst=True)]
    content = select_content(failed.protocol)
    for one in failed.protocol:
        if is_slow and one.text == KINDS["periods"]:
            continue
        if one in content or not (is_void or _is_explained(one, lateness)):
            found.append(one)
    return found


def select_content(failed: Sequence[Check]) -> list[Check]:
    """The failed checks of what frames contain: no lateness explains them, except of rates."""
    texts = {KINDS[kind] for kind in CONTENT}
    return [one for one in failed if one.text in texts and not all(RATES.search(text) for text in one.found)]


def decide(failed: Failed, lateness: Lateness, record: Record) -> tuple[Verdict, str]:
    """The verdict of a case and, unless it passed, the reason: the first check that failed, and what may explain it."""
    if not failed.all:
        return Verdict.PASS, ""
    unexplained = select_unexplained(failed, lateness, record)
    first = (unexplained or failed.all)[0]
    why = f"{first.text}: {'; '.join(first.found[:1])}"
    if unexplained:
        return Verdict.FAIL, why
    return Verdict.NOT_EXECUTED, f"{HOST_TOO_SLOW}: {lateness.describe()}, which may explain the finding: {why}"


def _is_explained(one: Check, lateness: Lateness, *, only_worst: bool = False) -> bool:
    """True if a delay is as long as what is missing, and near whatever else was found.

    `only_worst`: of a distribution a single delay explains the greatest value, no quantile.
    """
    worst = lateness.worst
    if worst is None or (only_worst and "every" not in one.text):
        return False
    found = list(one.found)
    if one.measured is not None and one.limit is not None and one.measured > one.limit:
        if (one.measured - one.limit) / 1e3 > worst.by_s:
            return False
        found = found[1:]
    return all(_is_near(text, lateness) for text in found)


def _is_near(text: str, lateness: Lateness) -> bool:
    match = re.search(r"(-?\d+\.\d+) s", text)
    at_s = float(match[1]) if match else math.inf
    return any(one.at_s - one.by_s - BEFORE_S <= at_s <= one.at_s + AFTER_S for one in lateness.delays)


def _is_slow(lateness: Lateness, record: Record) -> bool:
    """True if the host caused at least half of what the answers came later than the quickest of them."""
    late_s = sorted((pair.stamp_ns - begin_ns) / S for begin_ns, pair in record.answers)
    if not late_s:
        return False
    quick_s = late_s[int(QUICK * len(late_s))]
    excess_s = sum(max(0.0, value - quick_s) for value in late_s)
    caused_s = lateness.usual_s * len(late_s) + sum(one.by_s for one in lateness.delays)
    return caused_s > 0.0 and caused_s >= SHARE * excess_s
