"""How late the answers to the vehicle's samples are."""

from itertools import pairwise

from vehicle_bus_contract.judge import Pair, Record
from vehicle_bus_contract.reference import MS, S

from hil_bench import figures
from hil_bench.case import Case
from hil_bench.expect import Observation, check
from hil_bench.judges import regularity
from hil_bench.judges.protocol import SLACK_AFTER_S
from hil_bench.result import Check, Distribution
from hil_bench.rig import Rig

ON_BUS_S = 0.005
"""Until an answer is on the bus; the profile says how old its sample may be."""
HALF_ARE_PROMPT = "half of the answers come within one period"
NEARLY_ALL_ARE_PROMPT = "99 % of the answers come within two periods"
NONE_IS_TOO_LATE = "every answer comes before its sample is too old"


def check_answers(
    case: Case, record: Record, observed: Observation, rig: Rig
) -> tuple[list[Check], list[Distribution]]:
    """Latency of the answers and jitter of the commands, outside or during the injection."""
    hardware = _hardware_stamps(rig)

    def counts(pair: Pair) -> bool:
        return case.inject is None or _is_injected(observed, pair) is case.is_measured

    # Where a message of its own says that commands are not enabled, it comes in a period of its own.
    always = rig.wire.enable_period_s <= rig.wire.command_period_s
    latencies = [_latency_s(begin_ns, pair, hardware) for begin_ns, pair in record.answers if counts(pair)]
    periods = [
        (b.drive.stamp_ns - a.drive.stamp_ns) / S
        for a, b in pairwise(record.pairs)
        if b.drive.stamp_ns - a.drive.stamp_ns < 200 * MS and counts(b) and (always or (a.is_enabled and b.is_enabled))
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
        checks += regularity.check_jitter(rig.wire, latencies, periods)
        checks.append(check(HALF_ARE_PROMPT, [], latency.p50 / 1e3, period_s))
        if "unanswered" not in case.allow or case.is_measured:
            checks.append(check(NEARLY_ALL_ARE_PROMPT, [], latency.p99 / 1e3, 2.0 * period_s))
            checks.append(check(NONE_IS_TOO_LATE, [], latency.max / 1e3, oldest_s))
    return checks, [latency, jitter]


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
