"""Judges a record of frames by the bus contract: decodes it and lists what is wrong with it."""

import math
from bisect import bisect_left, bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

from vehicle_bus_contract.reference import (
    DRIVE,
    ENGAGED,
    ENGAGING,
    GREATEST_STEP,
    MS,
    NO_REQUEST,
    REASONS,
    REFERENCE,
    REVERSE,
    STOPPING,
    DecodedFrame,
    Frame,
    Limits,
    S,
)

SAMPLE_WINDOW_NS = 50 * MS
"""Parts of one sample that lie further apart belong to different rounds of the counter; and so long without a complete
sample means a stop."""
OLDEST_ANSWERED_NS = 100 * MS
CATCH_UP_NS = 500 * MS
"""Debts that are not worked off in this time are no lateness: their samples were missed."""
SILENCE_NS = 200 * MS
"""A longer gap between two command pairs is silence, and what comes after it a new beginning."""
SETTLING_NS = 200 * MS
"""At a beginning, frames may have queued up before the first answer."""

AT_ONCE_NS = MS
"""What comes within this time has no order."""
LEAST_LOSS_NS = 40 * MS
"""After so long without a sample, as the observer sees it, a stop needs none."""
JITTER_NS = 20 * MS
"""Between the instant for which a command was computed and its stamp on the wire."""
STOP_NS = 0
"""So long after its beginning a stop brakes; until then the acceleration may be on its way down."""
END_OF_TRAJECTORY = ("PAST_END_SPACE", "PAST_END_TIME")


class Judged(Protocol):
    """What must be known of a bus to judge what was on it."""

    @property
    def names(self) -> Mapping[int, str]: ...
    @property
    def sample(self) -> tuple[str, ...]: ...
    @property
    def command(self) -> tuple[str, ...]: ...
    @property
    def counters(self) -> int: ...
    @property
    def limits(self) -> Limits: ...
    def is_well_formed(self, frame: Frame) -> bool: ...
    def intact(self, frame: Frame) -> DecodedFrame | None: ...


@dataclass(frozen=True, slots=True)
class Sample:
    """One complete state sample."""

    stamp_ns: int
    """Of the frame that completed it."""
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Pair:
    """One DRIVE_COMMAND with the STEER_COMMAND that belongs to it; on CAN FD the COMMAND that is both."""

    drive: DecodedFrame
    steer: DecodedFrame

    @property
    def stamp_ns(self) -> int:
        """When it was whole."""
        return max(self.drive.stamp_ns, self.steer.stamp_ns)

    @property
    def is_enabled(self) -> bool:
        """Whether the vehicle is to obey."""
        return bool(self.drive["ENABLE"])

    @property
    def is_stop(self) -> bool:
        """Whether it stops the vehicle."""
        return bool(self.drive["SAFE_STOP"])

    @property
    def reason(self) -> str:
        """Why it is as it is."""
        return self.drive.reason


@dataclass(slots=True)
class Record:
    """What a record of frames came to."""

    frames: Counter[str] = field(default_factory=Counter)
    """By message name; others by their identifier."""
    crc_errors: list[str] = field(default_factory=list)
    damaged: list[tuple[str, int]] = field(default_factory=list)
    """Name and stamp of each frame with a wrong checksum."""
    malformed: list[str] = field(default_factory=list)
    """Frames with an identifier of the contract and another kind or length."""
    counter_gaps: list[str] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    pairs: list[Pair] = field(default_factory=list)
    answers: list[tuple[int, Pair]] = field(default_factory=list)
    """When a sample was complete, ns, and the pair that answers it."""
    unanswered: list[str] = field(default_factory=list)
    doubled: list[str] = field(default_factory=list)
    """Pairs, or halves of pairs, that answer nothing."""
    stale_stops: int = 0
    """Stops that were sent because no sample came."""
    silences: list[tuple[int, int]] = field(default_factory=list)
    """Gaps between command pairs, ns."""
    violations: list[str] = field(default_factory=list)
    """Command values that the contract does not allow."""
    decoded: list[DecodedFrame] = field(default_factory=list)
    """Everything intact, in order."""
    begin_ns: int = 0
    end_ns: int = 0

    def of(self, name: str) -> list[DecodedFrame]:
        """All intact frames of one message."""
        return [decoded for decoded in self.decoded if decoded.name == name]

    def faults(self) -> list[str]:
        """All that is wrong; empty when the record is as the contract wants it."""
        return [
            *(f"CRC: {text}" for text in self.crc_errors),
            *(f"malformed: {text}" for text in self.malformed),
            *(f"counter: {text}" for text in self.counter_gaps),
            *(f"unanswered: {text}" for text in self.unanswered),
            *(f"doubled: {text}" for text in self.doubled),
            *(f"silence: {_at(a, self.begin_ns)} to {_at(b, self.begin_ns)}" for a, b in self.silences),
            *(f"command: {text}" for text in self.violations),
        ]


def examine(frames: Iterable[Frame], contract: Judged = REFERENCE) -> Record:
    """Judge a record. Frames are taken in the order of their stamps."""
    record = Record()
    in_order = sorted(frames, key=lambda frame: frame.stamp_ns)
    if in_order:
        record.begin_ns, record.end_ns = in_order[0].stamp_ns, in_order[-1].stamp_ns
    for frame in in_order:
        decoded = _judge_frame(frame, contract, record)
        if decoded is not None:
            record.decoded.append(decoded)
    accepted = _judge_counters(contract, record)
    _find_samples(accepted, contract, record)
    _find_pairs(contract, record)
    judge_answers(record)
    _judge_values(record, contract.limits)
    judge_wheel_rates(record, contract.limits)
    _judge_lights_and_reports(record)
    return record


def lateral_errors_m(samples: Sequence[Sample], x_m: Sequence[float], y_m: Sequence[float]) -> list[float]:
    """Distance of each sample from a path of points, followed along the path so that a crossing misleads nobody.

    A path that ends where it begins is taken to go on from its beginning.
    """
    count = len(x_m)
    closed = math.hypot(x_m[0] - x_m[-1], y_m[0] - y_m[-1]) < 0.01
    errors: list[float] = []
    place = -1
    for sample in samples:
        if place < 0:
            place = min(range(count - 1), key=lambda i: _start_cost(sample, x_m, y_m, i))
            window: Iterable[int] = (place,)
        else:
            window = range(place - 4, place + 13)
        best = math.inf
        for i in window:
            segment = i % (count - 1) if closed else min(max(i, 0), count - 2)
            distance = _distance_m(sample, x_m, y_m, segment)
            if distance < best:
                best, place = distance, segment
        errors.append(best)
    return errors


def _start_cost(sample: Sample, x_m: Sequence[float], y_m: Sequence[float], i: int) -> float:
    """Distance to a segment, and how badly its direction fits."""
    heading_rad = math.atan2(y_m[i + 1] - y_m[i], x_m[i + 1] - x_m[i])
    turned_rad = math.remainder(heading_rad - sample.heading_rad, math.tau)
    return _distance_m(sample, x_m, y_m, i) + abs(turned_rad)


def _distance_m(sample: Sample, x_m: Sequence[float], y_m: Sequence[float], i: int) -> float:
    dx, dy = x_m[i + 1] - x_m[i], y_m[i + 1] - y_m[i]
    px, py = sample.x_m - x_m[i], sample.y_m - y_m[i]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square else 0.0
    return math.hypot(px - share * dx, py - share * dy)


def _at(stamp_ns: int, begin_ns: int) -> str:
    return f"{(stamp_ns - begin_ns) / S:.3f} s"


def _judge_frame(frame: Frame, contract: Judged, record: Record) -> DecodedFrame | None:
    name = contract.names.get(frame.can_id)
    if name is None:
        record.frames[f"0x{frame.can_id:03X}"] += 1
        return None
    record.frames[name] += 1
    where = f"{name} at {_at(frame.stamp_ns, record.begin_ns)}"
    if not contract.is_well_formed(frame):
        record.malformed.append(where)
        return None
    decoded = contract.intact(frame)
    if decoded is None:
        record.crc_errors.append(where)
        record.damaged.append((name, frame.stamp_ns))
    return decoded


def _judge_counters(contract: Judged, record: Record) -> list[DecodedFrame]:
    """Notes every step that is not 1; returns what a receiver accepts: steps of 1 to 3, and one more for each
    frame of the message that was damaged on the way (AUTOSAR profile 1)."""
    last: dict[str, int] = {}
    last_ns: dict[str, int] = {}
    accepted = []
    for decoded in record.decoded:
        where = f"{decoded.name} at {_at(decoded.stamp_ns, record.begin_ns)}"
        if decoded.counter >= contract.counters:
            record.counter_gaps.append(f"{where}: {decoded.counter} is no counter")
            continue
        before, last[decoded.name] = last.get(decoded.name), decoded.counter
        step = (decoded.counter - before) % contract.counters if before is not None else 1
        if step != 1:
            record.counter_gaps.append(f"{where}: {before} to {decoded.counter}")
        since_ns, last_ns[decoded.name] = last_ns.get(decoded.name, 0), decoded.stamp_ns
        damaged = sum(name == decoded.name and since_ns < at_ns < decoded.stamp_ns for name, at_ns in record.damaged)
        if 1 <= step <= GREATEST_STEP + damaged:
            accepted.append(decoded)
    return accepted


def _find_samples(accepted: Iterable[DecodedFrame], contract: Judged, record: Record) -> None:
    pending: dict[int, dict[str, DecodedFrame]] = {}
    for decoded in accepted:
        if decoded.name not in contract.sample:
            continue
        parts = pending.setdefault(decoded.counter, {})
        if parts and decoded.stamp_ns - min(part.stamp_ns for part in parts.values()) > SAMPLE_WINDOW_NS:
            parts.clear()
        parts[decoded.name] = decoded
        if len(parts) == len(contract.sample):
            del pending[decoded.counter]
            signals = {name: value for part in parts.values() for name, value in part.signals.items()}
            place = (signals["POS_X"], signals["POS_Y"], signals["HEADING"])
            record.samples.append(Sample(decoded.stamp_ns, *place, signals["SPEED"]))


def _find_pairs(contract: Judged, record: Record) -> None:
    """A DRIVE_COMMAND and the next STEER_COMMAND, or the other way round; a half without its other is reported.

    Where the record begins or ends, the other may be beyond it. A COMMAND on CAN FD is both.
    """
    if len(contract.command) == 1:
        record.pairs += [Pair(decoded, decoded) for decoded in record.decoded if decoded.name in contract.command]
        return
    halves = [decoded for decoded in record.decoded if decoded.name in contract.command]
    first = _said_first(halves, contract)
    half: DecodedFrame | None = None
    for decoded in halves:
        if decoded.name != first and half is not None:
            drive, steer = (half, decoded) if first == contract.command[0] else (decoded, half)
            record.pairs.append(Pair(drive, steer))
            half = None
            continue
        alone = half if decoded.name == first else decoded
        is_cut = alone is halves[0] and alone.name != first and alone.stamp_ns - record.begin_ns < JITTER_NS
        if alone is not None and not is_cut:
            record.doubled.append(f"{alone.name} alone at {_at(alone.stamp_ns, record.begin_ns)}")
        half = decoded if decoded.name == first else None
    if half is not None and record.end_ns - half.stamp_ns > JITTER_NS:
        record.doubled.append(f"{half.name} alone at {_at(half.stamp_ns, record.begin_ns)}")


def _said_first(halves: Sequence[DecodedFrame], contract: Judged) -> str:
    """The half that begins a pair: the one after which the other usually comes sooner."""
    waits: dict[str, list[int]] = {name: [] for name in contract.command}
    for before, after in pairwise(halves):
        if before.name != after.name:
            waits[before.name].append(after.stamp_ns - before.stamp_ns)
    usual = {name: sorted(gaps)[len(gaps) // 2] for name, gaps in waits.items() if gaps}
    return min(usual, key=lambda name: usual[name], default=contract.command[0])


def judge_answers(record: Record) -> None:
    """One pair for each complete sample, in each stretch of commanding."""
    pairs = record.pairs
    begin = 0
    for i in range(1, len(pairs) + 1):
        if i < len(pairs) and pairs[i].stamp_ns - pairs[i - 1].stamp_ns <= SILENCE_NS:
            continue
        _judge_stretch(pairs[begin:i], record)
        if i < len(pairs):
            record.silences.append((pairs[i - 1].stamp_ns, pairs[i].stamp_ns))
        begin = i


def _judge_stretch(pairs: Sequence[Pair], record: Record) -> None:
    """Each sample opens a debt, each pair pays the oldest one that was not missed.

    A sample was missed if the debts that it is among are not worked off within `CATCH_UP_NS`: then its answer does not
    come, and the later ones are those of later samples. A stop that is sent because no sample came may cross the late
    sample on the wire; then the sample's own answer comes right after it.
    """
    if not pairs:
        return
    settled_ns = pairs[0].stamp_ns + SETTLING_NS
    stamps = [s.stamp_ns for s in record.samples if pairs[0].stamp_ns <= s.stamp_ns <= pairs[-1].stamp_ns]
    begun = [bisect_right(stamps, pair.drive.stamp_ns) for pair in pairs]
    debts: deque[int] = deque()
    newest_ns = before_ns = pairs[0].stamp_ns
    crossed_ns = 0
    debt_free_ns, left = settled_ns, deque[int](maxlen=100)
    for place, pair in enumerate(pairs[1:], 1):
        for stamp_ns in stamps[begun[place - 1] : begun[place]]:
            before_ns, newest_ns = newest_ns, stamp_ns
            debts.append(newest_ns)
        if pair.stamp_ns < settled_ns:
            debts.clear()
            continue
        while debts and pair.drive.stamp_ns - debts[0] > OLDEST_ANSWERED_NS:
            record.unanswered.append(f"sample at {_at(debts.popleft(), record.begin_ns)}")
        for _ in range(_count_missed(len(debts), pairs, begun, place)):
            record.unanswered.append(f"sample at {_at(debts.popleft(), record.begin_ns)}")
        if debts:
            record.answers.append((debts.popleft(), pair))
            if pair.is_stop and pair.drive.stamp_ns - before_ns > LEAST_LOSS_NS:
                crossed_ns = pair.stamp_ns
        elif pair.is_stop and pair.drive.stamp_ns - newest_ns > LEAST_LOSS_NS:
            record.stale_stops += 1
        elif pair.stamp_ns - crossed_ns < JITTER_NS:
            record.stale_stops += 1
            crossed_ns = 0
        else:
            record.doubled.append(f"pair at {_at(pair.stamp_ns, record.begin_ns)}, {pair.reason}")
        left.append(len(debts))
        if not debts:
            debt_free_ns = pair.stamp_ns
    for _ in range(min(left, default=0)):
        record.unanswered.append(f"a sample after {_at(debt_free_ns, record.begin_ns)}")


def _count_missed(debts: int, pairs: Sequence[Pair], begun: Sequence[int], place: int) -> int:
    """How many of the debts at a pair remain after every pair within `CATCH_UP_NS`; 0 just before the end."""
    left = least = debts - 1
    for later in range(place + 1, len(pairs)):
        if least <= 0:
            return 0
        if pairs[later].stamp_ns - pairs[place].stamp_ns > CATCH_UP_NS:
            return least
        left = max(0, left + begun[later] - begun[later - 1] - 1)
        least = min(least, left)
    return least if pairs[-1].stamp_ns - pairs[place].stamp_ns > OLDEST_ANSWERED_NS else 0


def _judge_values(record: Record, limits: Limits) -> None:
    """Ranges, and signals that must agree with each other."""
    samples = deque(record.samples)
    speed_mps, driven_ns = 0.0, 0
    for pair in record.pairs:
        while samples and samples[0].stamp_ns <= pair.drive.stamp_ns:
            speed_mps = samples.popleft().speed_mps
        driven_ns = driven_ns if pair.is_stop and driven_ns else pair.stamp_ns
        is_firm = pair.stamp_ns - driven_ns > STOP_NS
        for wrong in _wrong_values(pair, speed_mps, limits, is_firm=is_firm):
            record.violations.append(f"{_at(pair.stamp_ns, record.begin_ns)}: {wrong}")


def _wrong_values(pair: Pair, speed_mps: float, limits: Limits, *, is_firm: bool) -> Iterable[str]:
    drive, steer = pair.drive, pair.steer
    lowest, highest = limits.accel_range_mps2
    gear = drive.signals.get("GEAR_REQUEST", NO_REQUEST)
    if speed_mps < -0.05 or drive.signals.get("SPEED_REQUEST", 0.0) < 0.0 or gear == REVERSE:
        lowest, highest = -highest, -lowest
    accel, angle = drive["ACCEL_REQUEST"], steer["FRONT_WHEEL_ANGLE_REQUEST"]
    if not lowest - 1e-9 <= accel <= highest + 1e-9:
        yield f"ACCEL_REQUEST {accel:.3f} m/s²"
    if abs(angle) > limits.steer_rad + 1e-9:
        yield f"FRONT_WHEEL_ANGLE_REQUEST {angle:.4f} rad"
    if drive["REASON"] >= len(REASONS):
        yield f"{pair.reason} is none"
    if drive["ENABLE"] != steer["ENABLE"]:
        yield f"ENABLE {drive['ENABLE']:.0f} and {steer['ENABLE']:.0f} in one pair"
    if pair.is_enabled and pair.is_stop != (pair.reason != "NOMINAL"):
        yield f"SAFE_STOP {drive['SAFE_STOP']:.0f} with {pair.reason}"
    if not pair.is_enabled and pair.reason == "NOMINAL":
        yield "ENABLE 0 with NOMINAL"
    # Where the state is invalid, the speed signal may be what is wrong, its sign included.
    if is_firm and pair.reason != "STATE_INVALID" and accel * speed_mps > 1e-9 and abs(speed_mps) > 0.05:
        yield f"a stop accelerates by {accel:.3f} m/s² at {speed_mps:.2f} m/s"
    if gear not in (REVERSE, DRIVE, NO_REQUEST):
        yield f"GEAR_REQUEST {gear:.0f}"
    if gear != NO_REQUEST and abs(speed_mps) >= limits.gear_change_mps + 0.05:
        yield f"GEAR_REQUEST {gear:.0f} at {speed_mps:.2f} m/s"


def judge_wheel_rates(record: Record, limits: Limits, more_rad: float = 1e-4) -> None:
    """The wheels' rate over every stretch of enabled commands, however short or long, not only from frame to frame."""
    rate_radps = limits.steer_rate_radps
    slack_rad = rate_radps * JITTER_NS / S + more_rad
    lowest, highest, before_ns = math.inf, -math.inf, 0
    for pair in record.pairs:
        t_s = (pair.steer.stamp_ns - record.begin_ns) / S
        angle = pair.steer["FRONT_WHEEL_ANGLE_REQUEST"]
        if not pair.is_enabled or pair.stamp_ns - before_ns > SILENCE_NS:
            lowest, highest = math.inf, -math.inf
        before_ns = pair.stamp_ns
        if not pair.is_enabled:
            continue
        rising, falling = angle - rate_radps * t_s, angle + rate_radps * t_s
        if rising > lowest + slack_rad or falling < highest - slack_rad:
            record.violations.append(f"{t_s:.3f} s: wheels faster than {rate_radps} rad/s, to {angle:.4f} rad")
            lowest, highest = math.inf, -math.inf
        lowest, highest = min(lowest, rising), max(highest, falling)


def find_pairs_beside(pairs: Sequence[Pair], stamp_ns: int) -> Sequence[Pair]:
    """The pair before and the pair after a time, and all that came at that time.

    After a pause of the machine frames have one stamp that were sent one after another.
    """
    after = bisect_right(pairs, stamp_ns, key=_stamp_ns)
    at_once = bisect_left(pairs, stamp_ns - AT_ONCE_NS, key=_stamp_ns)
    return pairs[max(0, min(at_once, after - 1)) : after + 1]


def _stamp_ns(pair: Pair) -> int:
    return pair.stamp_ns


def _judge_lights_and_reports(record: Record) -> None:
    """Hazard lights and CONTROLLER_STATUS fit a pair beside them."""
    for decoded in record.decoded:
        if decoded.name not in ("BODY_COMMAND", "CONTROLLER_STATUS"):
            continue
        near = find_pairs_beside(record.pairs, decoded.stamp_ns)
        fits = _lights_fit if decoded.name == "BODY_COMMAND" else _report_fits
        if near and not any(fits(decoded, pair) for pair in near):
            what = ", ".join(f"{name} {value:.0f}" for name, value in decoded.signals.items() if name != "COUNTER")
            beside = " and ".join(f"ENABLE {pair.drive['ENABLE']:.0f} {pair.reason}" for pair in near)
            record.violations.append(f"{_at(decoded.stamp_ns, record.begin_ns)}: {decoded.name} {what} beside {beside}")


def _lights_fit(body: DecodedFrame, pair: Pair) -> bool:
    stops = pair.is_enabled and pair.is_stop and pair.reason not in END_OF_TRAJECTORY
    return bool(body["HAZARD_LIGHTS"]) == stops


def _report_fits(report: DecodedFrame, pair: Pair) -> bool:
    state = report.signals.get("STATE")
    if state is None:
        return True
    if state == ENGAGED:
        return pair.is_enabled and not pair.is_stop
    if state == STOPPING:
        return pair.is_enabled and pair.is_stop
    return pair.is_enabled == (state == ENGAGING)
