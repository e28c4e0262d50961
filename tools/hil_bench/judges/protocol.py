"""One check for each kind of finding that no device may cause in any case."""

import math
import re
from collections.abc import Iterable, Sequence

from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import S

from hil_bench.case import Case, Then
from hil_bench.expect import Observation, check, not_applicable
from hil_bench.judges import dynamics, pacing, regularity, report, stops
from hil_bench.result import Check
from hil_bench.rig import Rig
from hil_bench.vocabulary import Wait

KINDS = {
    "damaged": "every frame of the device is sound: kind, length, checksum",
    "counter": "its counters advance by one, with each new frame only",
    "unanswered": "every complete sample is answered",
    "doubled": "one pair of commands for each sample, and no more",
    "silence": "no gap of 200 ms between commands",
    "command": "every value is within the limits, and signals agree with each other",
    "dynamics": "steering, lateral acceleration, braking and jerk keep the profile's limits at the measured speed",
    "brakes": "a stop brakes: 90 % of the safe deceleration, as soon as its jerk allows, until it is slow",
    "stop_steering": "a stop turns the wheels straight, or holds them, as the profile says",
    "release": "a moving vehicle is released to its driver only",
    "unarmed": "nobody drives after an override or a fault of the vehicle, until the device is armed",
    "report": "the report's reason, place, time and missed deadlines are those that the bus shows",
    "burst": "no burst: at most 1.2 commands per period, plus one, in 250 ms",
    "periods": "lights, report and whatever else is periodic are sent in their periods",
}
"""Kind of finding → what must hold instead."""
HEALTHY_S = 0.6
SLACK_AFTER_S = 0.35
OWED = 10
"""Answers lost on a bad cable count as unanswered until too old: at most this many after the cable is good again."""
CROWD_S = 0.05
"""A burst of samples follows a gap that is shorter than this."""
MOVING_MPS, RESTS_S = 0.05, 0.3
"""A vehicle that is slower has come to rest; so soon after an injection no stop has ended."""
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
        "brakes": list(stops.find_weak_brakes(rig.wire, record, observed.history)),
        "stop_steering": list(stops.find_wrong_steering(rig.wire, record)),
        "release": list(stops.find_released(rig.wire, record, observed.history)),
        "unarmed": list(stops.find_unarmed(record, observed.history, observed.armed_ns, observed.later_s(Wait.STATUS))),
        "report": [
            *pacing.find_contradictions(record),
            *report.find_wrong_reports(rig.wire, record, observed.route, observed.history),
        ],
        "burst": list(pacing.find_bursts(rig.wire, record)),
        "periods": [
            *pacing.find_wrong_periods(rig.wire, record),
            *regularity.find_irregular(rig.wire, record),
        ],
    }
    from_s = (rig.touched_ns - record.begin_ns) / S - JUST_BEFORE_S if rig.touched_ns else math.inf
    until_ns = {
        Then.MAY_GO_ON: rig.healthy_ns - round(HEALTHY_S * S),
        Then.REARM: rig.healthy_ns - round(HEALTHY_S * S),
        Then.GOES_ON: observed.end_ns,
    }.get(what_follows(case, observed), observed.then_ns or observed.end_ns)
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


def what_follows(case: Case, observed: Observation) -> Then:
    """`Case.then`, decided by whether the vehicle came to rest before it could be driven on."""
    if case.then is not Then.GOES_ON_IF_MOVING:
        return case.then
    until_ns = observed.end_ns + round(RESTS_S * S)
    during = (instant for instant in observed.history if observed.inject_ns <= instant.at_ns < until_ns)
    rested = any(abs(instant.speed_mps) < MOVING_MPS for instant in during)
    return Then.MAY_GO_ON if rested else Then.GOES_ON


def _without_crowded(unanswered: Sequence[str], crowded_s: Sequence[float]) -> list[str]:
    """Those beyond the number of samples in bursts, or before the first of these: answers are counted, not matched."""
    early = [text for text in unanswered if not crowded_s or _time_in(text) < crowded_s[0] - JUST_BEFORE_S - CROWD_S]
    late = [text for text in unanswered if text not in early]
    return [*early, *late[len(crowded_s) :]]


def _time_in(text: str) -> float:
    """The first time in a finding's text, s."""
    match = re.search(r"(-?\d+\.\d+) s", text)
    return float(match.group(1)) if match else -math.inf
