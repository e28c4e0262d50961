"""What is never to be seen of a device, whatever is done to it, and what is measured in every case.

The protocol is judged by `bus_contract_judge`, the values by the profile's limits, the whole case by what it expects.
"""

import math
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise

from bus_contract import AUTONOMOUS, MS, Frame, S
from bus_contract_judge import SILENCE_NS, Pair, Record, examine, lateral_errors_m

from hil import dynamics
from hil.case import Case, Then
from hil.expect import Seen, check
from hil.result import Check, Distribution, Event, EventKind, Path2D, Plot, Series, Verdict
from hil.rig import Rig
from hil.routes import Route
from hil.vehicle import Instant
from hil.wire import Wire

KINDS = {
    "damaged": "every frame of the device's is whole: kind, length, checksum",
    "counter": "its counters step by one, and only with a new frame",
    "unanswered": "every complete sample is answered",
    "doubled": "one pair of commands for each sample, and none besides",
    "silence": "no gap of 200 ms between commands",
    "command": "every value within the limits, and signals that agree with each other",
    "dynamics": "steering, lateral acceleration, braking and jerk as the profile allows at the measured speed",
    "brakes": "a stop brakes: half the safe deceleration within 250 ms, and until it is slow",
    "burst": "no burst: in 250 ms no more than 1.2 commands for each period, and one",
    "periods": "lights and report in their period, and the report's reason is the command's",
}
"""Never to be seen → what must hold instead."""
CERTAIN = ("damaged", "counter", "command", "dynamics")
"""Found in what a frame says, whenever it came: no lateness of the bench's explains it."""

ANSWER_P50_S = 0.010
"""The contract's period: an answer that usually comes after the next sample is late."""
ANSWER_P99_S = 0.020
ANSWER_MAX_S = 0.105
"""An answer is never given to a sample older than 100 ms; some more until it is on the bus."""
PLOT_POINTS = 300
THINNED_M = 0.2
HEALTHY_S = 0.6
HOLDS_S = 0.3
MOVING_MPS = 0.05
SLOWER_MPS = 0.3
"""As fast as it was to be, or nearly."""
SLACK_AFTER_S = 0.35
OWED = 10
"""Answers that a bad cable lost are owed until they are too old: so many may be called in after it was mended."""
JUST_BEFORE_S = 0.05
"""An unanswered sample is told by when all was answered the last time."""
WINDOW_NS = 250 * MS


def protocol(case: Case, rig: Rig, record: Record, seen: Seen) -> list[Check]:
    """One check for each of `KINDS`. What a case allows is allowed only while its injection works."""

    def of_device(texts: Iterable[str]) -> list[str]:
        return [text for text in texts if text.split()[0] in rig.wire.of_device]

    found: dict[str, Sequence[str]] = {
        "damaged": of_device([*record.crc_errors, *record.malformed]),
        "counter": of_device(record.counter_gaps),
        "unanswered": record.unanswered,
        "doubled": record.doubled,
        "silence": [f"{(a - record.begin_ns) / S:.3f} s: silence of {(b - a) / S:.3f} s" for a, b in record.silences],
        "command": record.violations,
        "dynamics": [
            *dynamics.beyond(rig.wire, record),
            *dynamics.swerving(rig.wire, record),
            *dynamics.led_away(rig.wire, record),
            *dynamics.jerky(rig.wire, record),
            *dynamics.rash(rig.wire, record),
        ],
        "brakes": list(dynamics.unbraked(rig.wire, record, seen.history)),
        "burst": list(_bursts(rig.wire, record)),
        "periods": [*_out_of_period(rig.wire, record), *_lies(record)],
    }
    from_s = (rig.touched_ns - record.begin_ns) / S - JUST_BEFORE_S if rig.touched_ns else math.inf
    until_ns = {
        Then.REARM: rig.healthy_ns - round(HEALTHY_S * S),
        Then.GOES_ON: seen.end_ns,
    }.get(case.then, seen.then_ns or seen.end_ns)
    to_s = (until_ns - record.begin_ns) / S + SLACK_AFTER_S
    checks = []
    for kind, must in KINDS.items():
        wrong = found[kind]
        if kind in case.allow:
            wrong = [text for text in wrong if not from_s <= _time_in(text) <= to_s]
        if kind == "unanswered" and case.on_vxcan and len(wrong) <= OWED:
            wrong = [text for text in wrong if _time_in(text) < from_s]
        checks.append(check(must, wrong))
    return checks


def certain(failed: Sequence[Check]) -> list[Check]:
    """Of checks that failed, those that did not because the bench was late. Rates are made of stamps, and may have."""
    texts = {KINDS[kind] for kind in CERTAIN}
    return [c for c in failed if c.text in texts and not all(re.search("faster|swerve", text) for text in c.found)]


def alive(case: Case, seen: Seen, rig: Rig) -> list[Check]:
    """That the device did not end before it had said anything, where it should drive: its own words say why."""
    if case.then is Then.ENDED or seen.frames or seen.exit_status is None or seen.exit_ns >= seen.then_ns:
        return []
    last = (rig.device.log.read_text(errors="replace").strip() or "nothing").splitlines()[-1]
    return [
        check("the device lives", [f"it ended with status {seen.exit_status} before its first frame; it said: {last}"])
    ]


def prepared(case: Case, seen: Seen, rig: Rig) -> list[Check]:
    """That there was something to be broken: a vehicle that is driven, as fast and as long as the case has it."""
    if case.inject is None or case.at_mps < 0.0:
        return []
    before = [instant for instant in seen.history if instant.at_ns <= rig.touched_ns][-1:]
    wrong = []
    if not before or before[0].mode != AUTONOMOUS:
        wrong.append("it was not engaged")
    elif abs(before[0].speed_mps) < case.at_mps - SLOWER_MPS:
        wrong.append(f"{seen.at_s(rig.touched_ns):.3f} s: {before[0].speed_mps:.2f} m/s")
    found = [check(f"it drives at {case.at_mps} m/s when the injection begins", wrong)]
    if case.samples:
        driven = sum(rig.inject_ns <= i.at_ns <= rig.end_ns and i.mode == AUTONOMOUS for i in seen.history)
        found.append(check(f"{case.samples} samples of driving", [f"{driven}"] if driven < case.samples else []))
    return found


def answers(case: Case, record: Record, seen: Seen, rig: Rig) -> tuple[list[Check], list[Distribution]]:
    """How long the device took for an answer, and how regular its commands were, outside the injection or within it."""
    hardware = _hardware_stamps(rig)

    def counts(pair: Pair) -> bool:
        return case.inject is None or _is_injected(seen, pair) is case.is_measured

    latencies = [_latency_s(begin_ns, pair, hardware) for begin_ns, pair in record.answers if counts(pair)]
    periods = [
        (b.drive.stamp_ns - a.drive.stamp_ns) / S
        for a, b in pairwise(record.pairs)
        if b.drive.stamp_ns - a.drive.stamp_ns < 200 * MS and counts(b)
    ]
    if not latencies or not periods:
        return [], []
    stamps = "hardware stamps" if hardware else "kernel stamps"
    latency = distribution(f"state to command ({stamps})", [value * 1e3 for value in latencies], ANSWER_P50_S * 1e3)
    jitter = distribution("jitter of the command period", [abs(value - 0.01) * 1e3 for value in periods])
    checks = []
    if case.answers_in_time:
        checks.append(check("half of the answers within the sample period", [], latency.p50 / 1e3, ANSWER_P50_S))
        if "unanswered" not in case.allow or case.is_measured:
            checks.append(check("99 of 100 answers within two periods", [], latency.p99 / 1e3, ANSWER_P99_S))
            checks.append(check("every answer before its sample is too old", [], latency.max / 1e3, ANSWER_MAX_S))
    return checks, [latency, jitter]


def health(case: Case, seen: Seen, rig: Rig, killed: Sequence[str]) -> list[Check]:
    """That the case left a device behind that is well, and nothing else."""
    checks = []
    if case.then in (Then.GOES_ON, Then.REARM):
        end_ns = seen.then_ns if case.then is Then.GOES_ON else rig.healthy_ns
        last = seen.between(end_ns - round(HEALTHY_S * S), end_ns)
        wrong = sorted(
            {f"{pair.reason}, ENABLE {pair.is_enabled:d}" for pair in last if pair.is_stop or not pair.is_enabled}
        )
        if len(last) < HEALTHY_S * 90:
            wrong.append(f"{len(last)} commands in the last {HEALTHY_S} s")
        at_end = [instant for instant in seen.history if instant.at_ns <= end_ns][-1:]
        if not at_end or at_end[0].mode != AUTONOMOUS or abs(at_end[0].speed_mps) < MOVING_MPS:
            wrong.append("the vehicle does not move")
        checks.append(check("afterwards it drives, without a fault", wrong))
    if case.then is Then.HOLDS:
        last = seen.between(seen.then_ns - round(HOLDS_S * S), seen.then_ns)
        wrong = sorted({f"{p.reason}, ENABLE {p.is_enabled:d}" for p in last if not p.is_stop or not p.is_enabled})
        checks.append(check("the stop is held", wrong if last else ["no command at all"]))
    if seen.exit_status is not None or case.exit_status:
        wrong = list(killed)
        if seen.exit_status is not None and seen.exit_ns < seen.then_ns and case.then is not Then.ENDED:
            wrong.append(f"{seen.at_s(seen.exit_ns):.3f} s: it ended by itself")
        if seen.exit_status is not None and seen.exit_status not in case.exit_status:
            wrong.append(f"exit status {seen.exit_status}, not {' or '.join(map(str, case.exit_status))}")
        checks.append(check("it ends when told, and nothing is left running", wrong))
    return checks


def path(case: Case, route: Route, history: Sequence[Instant]) -> tuple[list[Check], Path2D]:
    """How far the vehicle was from its route, by the plant's own truth."""
    moving = [i for i in history if i.mode == 2]
    few = moving[:: max(1, len(moving) // PLOT_POINTS)]
    wanted = range(0, len(route.x_m), max(1, len(route.x_m) // PLOT_POINTS))
    drawn = Path2D(
        wanted_x_m=[route.x_m[i] for i in wanted],
        wanted_y_m=[route.y_m[i] for i in wanted],
        driven_x_m=[round(i.x_m, 3) for i in few],
        driven_y_m=[round(i.y_m, 3) for i in few],
    )
    if case.most_path_error_m is None:
        return [], drawn
    if not moving:
        return [check("stays near its path", ["it was never driven"])], drawn
    errors = lateral_errors_m(moving, *_thinned(route))  # type: ignore[arg-type]
    worst = max(errors)
    verdict = Verdict.PASS if worst <= case.most_path_error_m else Verdict.FAIL
    limit = case.most_path_error_m
    text = "stays near its path"
    return [Check(text=text, verdict=verdict, measured=round(worst, 3), limit=limit, unit="m")], drawn


def _thinned(route: Route) -> tuple[list[float], list[float]]:
    """Points far enough apart to be followed from sample to sample; no corner of a path is sharper than that."""
    x_m, y_m = [route.x_m[0]], [route.y_m[0]]
    for x, y in zip(route.x_m, route.y_m, strict=True):
        if math.hypot(x - x_m[-1], y - y_m[-1]) >= THINNED_M:
            x_m.append(x)
            y_m.append(y)
    return [*x_m, route.x_m[-1]], [*y_m, route.y_m[-1]]


def plots(wire: Wire, seen: Seen) -> list[Plot]:
    """Commands against their limits, beside what the vehicle did."""
    pairs = [p for p in seen.pairs if p.is_enabled]
    few = pairs[:: max(1, len(pairs) // PLOT_POINTS)]
    told_s = [round(seen.at_s(p.stamp_ns), 3) for p in few]
    history = seen.history[:: max(1, len(seen.history) // PLOT_POINTS)]
    is_s = [round(seen.at_s(i.at_ns), 3) for i in history]
    lowest, highest = wire.limits.accel_range_mps2
    return [
        Plot(
            title="Speed",
            unit="m/s",
            series=[Series(name="vehicle", at_s=is_s, values=[round(i.speed_mps, 3) for i in history])],
        ),
        Plot(
            title="Acceleration",
            unit="m/s²",
            lowest=lowest,
            highest=highest,
            series=[
                Series(name="commanded", at_s=told_s, values=[p.drive["ACCEL_REQUEST"] for p in few]),
                Series(name="vehicle", at_s=is_s, values=[round(i.accel_mps2, 3) for i in history]),
            ],
        ),
        Plot(
            title="Front wheels",
            unit="rad",
            lowest=-wire.limits.steer_rad,
            highest=wire.limits.steer_rad,
            series=[
                Series(name="commanded", at_s=told_s, values=[p.steer["FRONT_WHEEL_ANGLE_REQUEST"] for p in few]),
                Series(name="vehicle", at_s=is_s, values=[round(i.wheel_rad, 4) for i in history]),
            ],
        ),
    ]


def examined(rig: Rig) -> Record:
    """The whole record by the bus contract."""
    return examine(rig.judged_frames(), rig.wire)


def counts(record: Record, rig: Rig, frames: Sequence[Frame]) -> dict[str, int]:
    """What there was, in numbers."""
    return {
        "frames on the bus": len(rig.heard),
        "frames of the device": len(frames),
        "complete samples": len(record.samples),
        "command pairs": len(record.pairs),
        "answered samples": len(record.answers),
        "unanswered samples": len(record.unanswered),
        "doubled commands": len(record.doubled),
        "stops for lack of state": record.stale_stops,
        "counter gaps": sum(text.split()[0] in rig.wire.of_device for text in record.counter_gaps),
        "late ticks of the bench": len(rig.late),
        "frames the bench could not send": rig.bus.refused,
    }


def distribution(name: str, values: Sequence[float], limit: float | None = None) -> Distribution:
    """Of measurements in ms."""
    ordered = sorted(values)

    def at(share: float) -> float:
        return round(ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)], 4)

    top = max(1e-3, ordered[-1])
    width = next(w for w in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 1e3, 1e6) if top / w <= 60)
    bins = math.floor(top / width) + 1
    numbers = [0] * bins
    for value in ordered:
        numbers[min(bins - 1, int(value / width))] += 1
    edges = [round(width * i, 6) for i in range(bins + 1)]
    return Distribution(
        name=name,
        unit="ms",
        count=len(ordered),
        p50=at(0.5),
        p95=at(0.95),
        p99=at(0.99),
        max=round(ordered[-1], 4),
        edges=edges,
        counts=numbers,
        limit=limit,
    )


def timeline(case: Case, rig: Rig, seen: Seen, events: Iterable[Event]) -> list[Event]:
    """All events in order, each once."""
    own = list(rig.events)
    if seen.inject_ns and case.inject is not None:
        own.append(Event(at_s=seen.at_s(seen.inject_ns), kind=EventKind.INJECTION, text=case.injected))
        own.append(Event(at_s=seen.at_s(seen.end_ns), kind=EventKind.END_OF_INJECTION, text="injection over"))
    unique = {(event.at_s, event.kind, event.text): event for event in (*own, *events)}
    return sorted(unique.values(), key=lambda event: event.at_s)


def _bursts(wire: Wire, record: Record) -> Iterable[str]:
    """Too many commands in one window. After a gap, what a device owes may come at once, if it is not too old."""
    timing = wire.profile["timing"]
    period_ns = round(timing["command_period_s"] * S)
    for name in wire.command:
        stamps = [told.stamp_ns for told in record.told if told.name == name]
        first = 0
        for place, stamp_ns in enumerate(stamps):
            while stamps[first] <= stamp_ns - WINDOW_NS:
                first += 1
            gap_ns = stamps[first] - stamps[first - 1] if first else 0
            owed = min(gap_ns, round(timing["answer_age_s"] * S)) // period_ns
            if place - first + 1 > 1.2 * WINDOW_NS / period_ns + 1 + max(0, owed - 1):
                yield f"{(stamp_ns - record.begin_ns) / S:.3f} s: {place - first + 1} {name} in 250 ms"


def _out_of_period(wire: Wire, record: Record) -> Iterable[str]:
    """BODY_COMMAND and CONTROLLER_STATUS while there are commands; a stretch too short for one needs none."""
    stretches: list[list[int]] = []
    for pair in record.pairs:
        if not stretches or pair.stamp_ns - stretches[-1][-1] > SILENCE_NS:
            stretches.append([])
        stretches[-1].append(pair.stamp_ns)
    for name, period in (("BODY_COMMAND", "body_period_s"), ("CONTROLLER_STATUS", "report_period_s")):
        if name not in wire.ids:
            continue
        period_ns = round(wire.profile["timing"][period] * S)
        told_ns = [told.stamp_ns for told in record.of(name)]
        for stretch in stretches:
            inside = [stamp_ns for stamp_ns in told_ns if stretch[0] <= stamp_ns <= stretch[-1]]
            for a_ns, b_ns in pairwise([stretch[0], *inside, stretch[-1]]):
                if b_ns - a_ns > 2.5 * period_ns:
                    yield f"{(a_ns - record.begin_ns) / S:.3f} s: no {name} for {(b_ns - a_ns) / S:.3f} s"
        for a_ns, b_ns in zip(told_ns, told_ns[4:], strict=False):
            if b_ns - a_ns < 2.5 * period_ns:
                yield f"{(a_ns - record.begin_ns) / S:.3f} s: five {name} within {(b_ns - a_ns) / S:.3f} s"


def _lies(record: Record) -> Iterable[str]:
    """Reports with a reason that no command beside them has."""
    pairs, place = record.pairs, 0
    for report in record.of("CONTROLLER_STATUS"):
        while place < len(pairs) and pairs[place].stamp_ns <= report.stamp_ns:
            place += 1
        beside = {pair.reason for pair in pairs[max(0, place - 1) : place + 1]}
        if beside and "REASON" in report.signals and report.reason not in beside:
            at = f"{(report.stamp_ns - record.begin_ns) / S:.3f} s:"
            yield f"{at} CONTROLLER_STATUS says {report.reason} beside {' and '.join(sorted(beside))}"


def _is_injected(seen: Seen, pair: Pair) -> bool:
    return bool(seen.inject_ns) and seen.inject_ns <= pair.stamp_ns <= seen.end_ns + round(SLACK_AFTER_S * S)


def _hardware_stamps(rig: Rig) -> dict[int, int]:
    """Kernel stamp → the adapter's, where every frame has one."""
    stamps = {heard.frame.stamp_ns: heard.hardware_ns for heard in rig.heard}
    return stamps if stamps and all(stamps.values()) else {}


def _latency_s(begin_ns: int, pair: Pair, hardware: dict[int, int]) -> float:
    end_ns = pair.stamp_ns
    if begin_ns in hardware and end_ns in hardware:
        return (hardware[end_ns] - hardware[begin_ns]) / S
    return (end_ns - begin_ns) / S


def _time_in(text: str) -> float:
    """The first time, s, that a finding names."""
    match = re.search(r"(-?\d+\.\d+) s", text)
    return float(match.group(1)) if match else -math.inf
