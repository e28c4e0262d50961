"""What no device may do in any case, and what is measured in every case.

The protocol is judged by the bus contract, the values by the profile's limits, the case by its expectations.
"""

import math
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise

from vehicle_bus_contract.judge import Pair, Record, lateral_errors_m
from vehicle_bus_contract.reference import AUTONOMOUS, MS, S

from hil_bench import dynamics, figures, pacing
from hil_bench.case import Case, Then
from hil_bench.expect import Observation, check, not_applicable
from hil_bench.result import Check, Distribution, Path2D, Verdict
from hil_bench.rig import Rig
from hil_bench.routes import Route
from hil_bench.vehicle import Instant

KINDS = {
    "damaged": "every frame of the device is sound: kind, length, checksum",
    "counter": "its counters advance by one, with each new frame only",
    "unanswered": "every complete sample is answered",
    "doubled": "one pair of commands for each sample, and no more",
    "silence": "no gap of 200 ms between commands",
    "command": "every value is within the limits, and signals agree with each other",
    "dynamics": "steering, lateral acceleration, braking and jerk keep the profile's limits at the measured speed",
    "brakes": "a stop brakes: at least half the safe deceleration from 250 ms until it is slow",
    "burst": "no burst: at most 1.2 commands per period, plus one, in 250 ms",
    "periods": "lights and report are sent in their periods, and the report's reason is the command's",
}
"""Kind of finding → what must hold instead."""
CONTENT = ("damaged", "counter", "command", "dynamics")
"""Findings in the content of frames: lateness of the bench cannot explain them."""

ON_BUS_S = 0.005
"""Until an answer is on the bus; the profile says how old its sample may be."""
THINNED_M = 0.2
HEALTHY_S = 0.6
ENOUGH = 0.9
"""Share of the commands of a period of time that must have come."""
HOLDS_S = 0.3
MOVING_MPS = 0.05
SLOWER_MPS = 0.3
"""Tolerance of the speed at the injection."""
SLACK_AFTER_S = 0.35
OWED = 10
"""Answers lost on a bad cable count as unanswered until too old: at most this many after the cable is good again."""
CROWD_S = 0.05
"""A burst of samples follows a gap that is shorter than this."""
JUST_BEFORE_S = 0.05
"""An unanswered sample is dated by the last time at which none was pending."""


def check_protocol(case: Case, rig: Rig, record: Record, observed: Observation) -> list[Check]:
    """One check for each of `KINDS`. What a case allows is allowed only during its injection."""

    def of_device(texts: Iterable[str]) -> list[str]:
        return [text for text in texts if text.split()[0] in rig.wire.of_device]

    found: dict[str, Sequence[str]] = {
        "damaged": of_device([*record.crc_errors, *record.malformed]),
        "counter": of_device(record.counter_gaps),
        "unanswered": record.unanswered,
        "doubled": record.doubled,
        "silence": [f"{(a - record.begin_ns) / S:.3f} s: silence of {(b - a) / S:.3f} s" for a, b in record.silences],
        "command": record.violations,
        "dynamics": list(dynamics.find_faults(rig.wire, record)),
        "brakes": list(dynamics.unbraked(rig.wire, record, observed.history)),
        "burst": list(pacing.find_bursts(rig.wire, record)),
        "periods": [*pacing.find_wrong_periods(rig.wire, record), *pacing.find_contradictions(record)],
    }
    from_s = (rig.touched_ns - record.begin_ns) / S - JUST_BEFORE_S if rig.touched_ns else math.inf
    until_ns = {
        Then.REARM: rig.healthy_ns - round(HEALTHY_S * S),
        Then.GOES_ON: observed.end_ns,
    }.get(case.then, observed.then_ns or observed.end_ns)
    to_s = (until_ns - record.begin_ns) / S + SLACK_AFTER_S
    checks = []
    lacking = rig.wire.unjudged
    for kind, must in KINDS.items():
        if kind in lacking:
            checks.append(not_applicable(must, lacking[kind]))
            continue
        wrong = found[kind]
        if kind in case.allow:
            wrong = [text for text in wrong if not from_s <= _time_in(text) <= to_s]
        if kind == "unanswered":
            wrong = _without_crowded(wrong, pacing.find_crowded(rig.wire, record))
        if kind == "unanswered" and case.on_vxcan and len(wrong) <= OWED:
            wrong = [text for text in wrong if _time_in(text) < from_s]
        checks.append(check(must, wrong))
    return checks


def _without_crowded(unanswered: Sequence[str], crowded_s: Sequence[float]) -> list[str]:
    """Those beyond the number of samples in bursts, or before the first of these: answers are counted, not matched."""
    early = [text for text in unanswered if not crowded_s or _time_in(text) < crowded_s[0] - JUST_BEFORE_S - CROWD_S]
    late = [text for text in unanswered if text not in early]
    return [*early, *late[len(crowded_s) :]]


def select_unexcused(failed: Sequence[Check]) -> list[Check]:
    """The failed checks that a late bench cannot explain. It can explain wrong rates, computed from stamps."""
    texts = {KINDS[kind] for kind in CONTENT}
    return [c for c in failed if c.text in texts and not all(re.search("faster|swerve", text) for text in c.found)]


def check_alive(case: Case, observed: Observation, rig: Rig) -> list[Check]:
    """Fail with the last line of the device's log if it ended before its first frame but should drive."""
    if (
        case.then is Then.ENDED
        or observed.frames
        or observed.exit_status is None
        or observed.exit_ns >= observed.then_ns
    ):
        return []
    last = (rig.device.log.read_text(errors="replace").strip() or "nothing").splitlines()[-1]
    return [
        check(
            "the device runs",
            [f"it ended with status {observed.exit_status} before its first frame; its last line: {last}"],
        )
    ]


def check_preparation(case: Case, observed: Observation, rig: Rig) -> list[Check]:
    """The device engaged, and the vehicle was driven as fast and for as long as the case requires."""
    if case.at_mps < 0.0:
        return []
    if case.inject is None:
        is_driven = any(instant.mode == AUTONOMOUS for instant in observed.history)
        return [check("the device engages", [] if is_driven else ["it never engaged"])]
    before = [instant for instant in observed.history if instant.at_ns <= rig.touched_ns][-1:]
    wrong = []
    if not before or before[0].mode != AUTONOMOUS:
        wrong.append("it was not engaged")
    elif abs(before[0].speed_mps) < case.at_mps - SLOWER_MPS * rig.wire.speed_share:
        wrong.append(f"{observed.at_s(rig.touched_ns):.3f} s: {before[0].speed_mps:.2f} m/s")
    found = [check(f"it drives at {case.at_mps:.3g} m/s when the injection begins", wrong)]
    if case.samples:
        ticks = sum(rig.inject_ns <= i.at_ns <= rig.end_ns and i.mode == AUTONOMOUS for i in observed.history)
        driven = ticks // rig.wire.ticks_per_sample
        found.append(check(f"{case.samples} samples of driving", [f"{driven}"] if driven < case.samples else []))
    return found


def check_answers(
    case: Case, record: Record, observed: Observation, rig: Rig
) -> tuple[list[Check], list[Distribution]]:
    """Latency of the answers and jitter of the commands, outside or during the injection."""
    hardware = _hardware_stamps(rig)

    def counts(pair: Pair) -> bool:
        return case.inject is None or _is_injected(observed, pair) is case.is_measured

    latencies = [_latency_s(begin_ns, pair, hardware) for begin_ns, pair in record.answers if counts(pair)]
    periods = [
        (b.drive.stamp_ns - a.drive.stamp_ns) / S
        for a, b in pairwise(record.pairs)
        if b.drive.stamp_ns - a.drive.stamp_ns < 200 * MS and counts(b)
    ]
    if not latencies or not periods:
        return [], []
    stamps = "hardware stamps" if hardware else "kernel stamps"
    period_s, oldest_s = rig.wire.period_s, float(rig.wire.profile["timing"]["max_command_age_s"]) + ON_BUS_S
    latency = figures.describe_distribution(
        f"state to command ({stamps})", [value * 1e3 for value in latencies], period_s * 1e3
    )
    jitter = figures.describe_distribution(
        "jitter of the command period", [abs(value - rig.wire.command_period_s) * 1e3 for value in periods]
    )
    checks = []
    if case.answers_in_time:
        checks.append(check("half of the answers come within one period", [], latency.p50 / 1e3, period_s))
        if "unanswered" not in case.allow or case.is_measured:
            checks.append(check("99 % of the answers come within two periods", [], latency.p99 / 1e3, 2.0 * period_s))
            checks.append(check("every answer comes before its sample is too old", [], latency.max / 1e3, oldest_s))
    return checks, [latency, jitter]


def check_health(case: Case, observed: Observation, rig: Rig, killed: Sequence[str]) -> list[Check]:
    """The device drives, holds or ends as it should after the case, and leaves no process."""
    checks = []
    if case.then in (Then.GOES_ON, Then.REARM):
        end_ns = observed.then_ns if case.then is Then.GOES_ON else rig.healthy_ns
        last = observed.between(end_ns - round(HEALTHY_S * S), end_ns)
        wrong = sorted(
            {f"{pair.reason}, ENABLE {pair.is_enabled:d}" for pair in last if pair.is_stop or not pair.is_enabled}
        )
        if len(last) < ENOUGH * HEALTHY_S / rig.wire.command_period_s:
            wrong.append(f"{len(last)} commands in the last {HEALTHY_S} s")
        at_end = [instant for instant in observed.history if instant.at_ns <= end_ns][-1:]
        if not at_end or at_end[0].mode != AUTONOMOUS or abs(at_end[0].speed_mps) < MOVING_MPS:
            wrong.append("the vehicle is not moving")
        checks.append(check("it drives afterwards, without a fault", wrong))
    if case.then is Then.HOLDS:
        last = observed.between(observed.then_ns - round(HOLDS_S * S), observed.then_ns)
        wrong = sorted({f"{p.reason}, ENABLE {p.is_enabled:d}" for p in last if not p.is_stop or not p.is_enabled})
        is_left_at_rest = case.may_fall_silent and not last and _is_left_at_rest(observed)
        checks.append(check("the stop is held", wrong if last or is_left_at_rest else ["no command at all"]))
    if observed.exit_status is not None or case.exit_status:
        wrong = list(killed)
        if observed.exit_status is not None and observed.exit_ns < observed.then_ns and case.then is not Then.ENDED:
            wrong.append(f"{observed.at_s(observed.exit_ns):.3f} s: it exited unexpectedly")
        if observed.exit_status is not None and observed.exit_status not in case.exit_status:
            wrong.append(f"exit status {observed.exit_status}, not {' or '.join(map(str, case.exit_status))}")
        checks.append(check("it ends when requested, and leaves no process", wrong))
    return checks


def _is_left_at_rest(observed: Observation) -> bool:
    """True if the last command before the operator acts was a stop, and the vehicle stood from then on."""
    before = observed.between(observed.inject_ns, observed.then_ns)
    if not before or not (before[-1].is_stop and before[-1].is_enabled):
        return False
    after = [instant for instant in observed.history if before[-1].stamp_ns <= instant.at_ns < observed.then_ns]
    return bool(after) and all(abs(instant.speed_mps) < MOVING_MPS for instant in after)


def check_path(case: Case, route: Route, history: Sequence[Instant]) -> tuple[list[Check], Path2D]:
    """Lateral distance of the vehicle from its route, by the plant's true position."""
    moving = [i for i in history if i.mode == AUTONOMOUS]
    drawn = figures.draw_path(route, moving)
    if case.max_path_error_m is None:
        return [], drawn
    if not moving:
        return [check("stays near its path", ["it was never driven"])], drawn
    errors = lateral_errors_m(moving, *_thin_out(route))  # type: ignore[arg-type]
    worst = max(errors)
    verdict = Verdict.PASS if worst <= case.max_path_error_m else Verdict.FAIL
    limit = case.max_path_error_m
    text = "stays near its path"
    return [Check(text=text, verdict=verdict, measured=round(worst, 3), limit=limit, unit="m")], drawn


def _thin_out(route: Route) -> tuple[list[float], list[float]]:
    """Points of the route at least `THINNED_M` apart; no corner of a path is sharper than that."""
    x_m, y_m = [route.x_m[0]], [route.y_m[0]]
    for x, y in zip(route.x_m, route.y_m, strict=True):
        if math.hypot(x - x_m[-1], y - y_m[-1]) >= THINNED_M:
            x_m.append(x)
            y_m.append(y)
    return [*x_m, route.x_m[-1]], [*y_m, route.y_m[-1]]


def _is_injected(observed: Observation, pair: Pair) -> bool:
    return bool(observed.inject_ns) and observed.inject_ns <= pair.stamp_ns <= observed.end_ns + round(
        SLACK_AFTER_S * S
    )


def _hardware_stamps(rig: Rig) -> dict[int, int]:
    """Kernel stamp → hardware stamp; empty unless every frame has one."""
    stamps = {rx.frame.stamp_ns: rx.hardware_ns for rx in rig.received}
    return stamps if stamps and all(stamps.values()) else {}


def _latency_s(begin_ns: int, pair: Pair, hardware: dict[int, int]) -> float:
    end_ns = pair.stamp_ns
    if begin_ns in hardware and end_ns in hardware:
        return (hardware[end_ns] - hardware[begin_ns]) / S
    return (end_ns - begin_ns) / S


def _time_in(text: str) -> float:
    """The first time in a finding's text, s."""
    match = re.search(r"(-?\d+\.\d+) s", text)
    return float(match.group(1)) if match else -math.inf
