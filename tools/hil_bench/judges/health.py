"""That the device runs, drives when the injection begins, and recovers after it."""

from collections.abc import Sequence

from vehicle_bus_contract.reference import AUTONOMOUS, S

from hil_bench.case import Case, Then
from hil_bench.expect import Observation, check
from hil_bench.judges.protocol import HEALTHY_S, MOVING_MPS, what_follows
from hil_bench.result import Check
from hil_bench.rig import Rig

ENGAGES = "the device engages"
DRIVES_AT = "it drives at"
DRIVES_AFTERWARDS = "it drives afterwards, without a fault"
ENDS = "it ends when requested, and leaves no process"
ENOUGH = 0.9
"""Share of the commands of a period of time that must have come."""
HOLDS_S = 0.3
LATCHED = 4
"""Exit status of a device that ends with a latched fault."""
SLOWER_MPS = 0.3
"""Tolerance of the speed at the injection."""


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
        return [check(ENGAGES, [] if is_driven else ["it never engaged"])]
    before = [instant for instant in observed.history if instant.at_ns <= rig.touched_ns][-1:]
    wrong = []
    if not before or before[0].mode != AUTONOMOUS:
        wrong.append("it was not engaged")
    elif abs(before[0].speed_mps) < case.at_mps - SLOWER_MPS * rig.wire.speed_share:
        wrong.append(f"{observed.at_s(rig.touched_ns):.3f} s: {before[0].speed_mps:.2f} m/s")
    found = [check(f"{DRIVES_AT} {case.at_mps:.3g} m/s when the injection begins", wrong)]
    if case.samples:
        ticks = sum(rig.inject_ns <= i.at_ns <= rig.end_ns and i.mode == AUTONOMOUS for i in observed.history)
        driven = ticks // rig.wire.ticks_per_sample
        found.append(check(f"{case.samples} samples of driving", [f"{driven}"] if driven < case.samples else []))
    return found


def check_health(case: Case, observed: Observation, rig: Rig, killed: Sequence[str]) -> list[Check]:
    """The device drives, holds or ends as it should after the case, and leaves no process."""
    checks = []
    then = what_follows(case, observed)
    if then in (Then.GOES_ON, Then.REARM, Then.MAY_GO_ON):
        end_ns = observed.then_ns if then is Then.GOES_ON else rig.healthy_ns
        last = observed.between(end_ns - round(HEALTHY_S * S), end_ns)
        wrong = sorted(
            {f"{pair.reason}, ENABLE {pair.is_enabled:d}" for pair in last if pair.is_stop or not pair.is_enabled}
        )
        if len(last) < ENOUGH * HEALTHY_S / rig.wire.command_period_s:
            wrong.append(f"{len(last)} commands in the last {HEALTHY_S} s")
        at_end = [instant for instant in observed.history if instant.at_ns <= end_ns][-1:]
        if not at_end or at_end[0].mode != AUTONOMOUS or abs(at_end[0].speed_mps) < MOVING_MPS:
            wrong.append("the vehicle is not moving")
        checks.append(check(DRIVES_AFTERWARDS, wrong))
    if case.then is Then.HOLDS:
        last = observed.between(observed.then_ns - round(HOLDS_S * S), observed.then_ns)
        wrong = sorted({f"{p.reason}, ENABLE {p.is_enabled:d}" for p in last if not p.is_stop or not p.is_enabled})
        is_left_at_rest = case.may_fall_silent and not last and _is_left_at_rest(observed)
        checks.append(check("the stop is held", wrong if last or is_left_at_rest else ["no command at all"]))
    if observed.exit_status is not None or case.exit_status:
        wrong = list(killed)
        if observed.exit_status is not None and observed.exit_ns < observed.then_ns and case.then is not Then.ENDED:
            wrong.append(f"{observed.at_s(observed.exit_ns):.3f} s: it exited unexpectedly")
        # Where no command tells its reason, a stop that latches is as good: the vehicle may contradict itself first.
        latches = case.then is Then.HOLDS and not rig.wire.tells_reasons
        allowed = (*case.exit_status, LATCHED) if latches else case.exit_status
        if observed.exit_status is not None and observed.exit_status not in allowed:
            wrong.append(f"exit status {observed.exit_status}, not {' or '.join(map(str, allowed))}")
        checks.append(check(ENDS, wrong))
    return checks


def _is_left_at_rest(observed: Observation) -> bool:
    """True if the last command before the operator acts was a stop, and the vehicle stood from then on."""
    before = observed.between(observed.inject_ns, observed.then_ns)
    if not before or not (before[-1].is_stop and before[-1].is_enabled):
        return False
    after = [instant for instant in observed.history if before[-1].stamp_ns <= instant.at_ns < observed.then_ns]
    return bool(after) and all(abs(instant.speed_mps) < MOVING_MPS for instant in after)
