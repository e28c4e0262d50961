"""Judges a record of frames by a profile, with the same result as the bus contract's judge of the reference vehicle."""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import pairwise

from vehicle_bus_contract.judge import Pair, Record, Sample, judge_answers, judge_wheel_rates
from vehicle_bus_contract.reference import AUTONOMOUS, NO_REQUEST, REVERSE, DecodedFrame, Frame, S

from hil_bench.peer.besides import Besides
from hil_bench.peer.infer import InferredStop
from hil_bench.peer.wire import PeerWire

MOVES_MPS = 0.05
SPREAD_NS = round(0.05 * S)
"""Parts of one sample lie within this time."""
MISSED_PERIODS = 2.5
CLOSE_PERIODS = 0.4
TOGETHER = 0.8
"""Share of the command's period within which the messages of one command come."""
DRIVING = ("throttle", "drive_mps2", "speed_mps", "accel_mps2")
RESTING_SLACK = 1e-6
ENABLE_SLACK_S = 0.02


def examine_peer(wire: PeerWire, frames: Iterable[Frame]) -> Record:
    """Frames are taken in the order of their stamps."""
    examination = _Examination(wire)
    in_order = sorted(frames, key=lambda frame: frame.stamp_ns)
    if in_order:
        examination.record.begin_ns, examination.record.end_ns = in_order[0].stamp_ns, in_order[-1].stamp_ns
    for frame in in_order:
        examination.take(frame)
    record = examination.record
    if wire.command_period_s <= wire.period_s * 1.01:
        judge_answers(record)
    else:
        _judge_slow_answers(wire, record)
    if wire.commands_angle:
        judge_wheel_rates(record, wire.limits, 1e-4 + wire.wheel_slack_rad(wire.limits.steer_rate_radps))
    _add_releases(examination.releases, record)
    return record


def _add_releases(releases: list[Pair], record: Record) -> None:
    """Where another message than the commands releases the vehicle, commands may end with it."""
    stamps = [release.stamp_ns for release in releases]
    record.silences = [
        (begin_ns, end_ns)
        for begin_ns, end_ns in record.silences
        if not any(begin_ns <= stamp_ns <= end_ns for stamp_ns in stamps)
    ]
    record.pairs = sorted([*record.pairs, *releases], key=lambda pair: pair.stamp_ns)


class _Examination:
    def __init__(self, wire: PeerWire) -> None:
        self.wire, self.record = wire, Record()
        self._newest: dict[str, float] = {}
        self._stamps: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._damaged: Counter[str] = Counter()
        self._parts: dict[int, dict[str, int]] = {}
        self._group: dict[str, DecodedFrame] = {}
        self._besides, self._stop = Besides(wire), InferredStop(wire)
        self._speed_mps, self._direction = 0.0, 1.0
        self.releases: list[Pair] = []
        """Said by messages other than commands."""
        self._both_since_ns: int | None = None
        self._drives_since_ns: int | None = None
        """Commands ask for a drive, although the vehicle is not enabled."""

    def take(self, frame: Frame) -> None:
        """Decode one frame and judge it."""
        record, name = self.record, self.wire.name_of(frame)
        if name is None:
            stray = self.wire.find_stray(frame)
            if stray:
                there, here = self.wire.buses[self.wire.bus_of(stray)], self.wire.buses[frame.bus]
                record.violations.append(
                    f"{self._at(frame.stamp_ns)}: {stray} on the bus {here}; it belongs on {there}"
                )
            record.frames[f"0x{frame.can_id:03X}"] += 1
            return
        record.frames[name] += 1
        where = f"{name} at {self._at(frame.stamp_ns)}"
        if not self.wire.is_well_formed(frame):
            record.malformed.append(where)
            return
        decoded = self.wire.intact(frame)
        if decoded is None:
            record.crc_errors.append(where)
            record.damaged.append((name, frame.stamp_ns))
            self._damaged[name] += 1
            return
        record.decoded.append(decoded)
        if not self._is_in_sequence(decoded, where):
            return
        self._newest.update(decoded.signals)
        self._stamps[name] = frame.stamp_ns
        if name in self.wire.periods_s:
            self._besides.note(decoded)
            self._take_state(decoded)
        else:
            record.violations += [f"{self._at(frame.stamp_ns)}: {text}" for text in self._besides.find_faults(decoded)]
            record.counter_gaps += [f"{where}: {text}" for text in self._besides.find_gaps(decoded)]
            self._take_command(decoded)
            if name not in self.wire.command and name in self.wire.reader.enabling_messages:
                self._take_enable(decoded)

    def _is_in_sequence(self, decoded: DecodedFrame, where: str) -> bool:
        """Note every step that is not 1; True for what a receiver accepts."""
        protection = self.wire.layout.protections[decoded.name]
        if not protection.counters:
            return True
        if decoded.counter >= protection.counters:
            self.record.counter_gaps.append(f"{where}: {decoded.counter} is no counter")
            return False
        before, self._last[decoded.name] = self._last.get(decoded.name), decoded.counter
        step = (decoded.counter - before) % protection.counters if before is not None else 1
        if step != 1:
            self.record.counter_gaps.append(f"{where}: {before} to {decoded.counter}")
        lost, self._damaged[decoded.name] = self._damaged[decoded.name], 0
        return 1 <= step <= protection.max_step + lost

    def _take_state(self, decoded: DecodedFrame) -> None:
        speed_mps = self.wire.fields.read("speed_mps", self._newest)
        if speed_mps is not None:
            self._speed_mps = speed_mps
            if abs(speed_mps) > MOVES_MPS:
                self._direction = 1.0 if speed_mps > 0.0 else -1.0
        if self._is_complete(decoded):
            self.record.samples.append(Sample(decoded.stamp_ns, 0.0, 0.0, 0.0, self._speed_mps))
        is_autonomous = self.wire.mode_of(self._newest) == AUTONOMOUS
        mode = float(self.wire.number("MODE", "AUTONOMOUS")) if is_autonomous else -1.0
        self.record.decoded.append(DecodedFrame(decoded.stamp_ns, "VEHICLE_STATUS", {"MODE": mode}))

    def _is_complete(self, decoded: DecodedFrame) -> bool:
        """True for the frame that completes a sample."""
        wire = self.wire
        if decoded.name not in wire.sample:
            return False
        if not wire.is_counted:
            ages = [decoded.stamp_ns - self._stamps.get(name, -S) for name in wire.sample]
            limits = [round(wire.max_age_s(name) * S) for name in wire.sample]
            is_fresh = all(age_ns <= limit_ns for age_ns, limit_ns in zip(ages, limits, strict=True))
            return decoded.name == wire.trigger and is_fresh
        parts = self._parts.setdefault(decoded.counter, {})
        if parts and decoded.stamp_ns - min(parts.values()) > SPREAD_NS:
            parts.clear()
        parts[decoded.name] = decoded.stamp_ns
        if len(parts) < len(wire.sample):
            return False
        del self._parts[decoded.counter]
        return True

    def _take_command(self, decoded: DecodedFrame) -> None:
        if decoded.name not in self.wire.command:
            return
        began_ns = min((one.stamp_ns for one in self._group.values()), default=decoded.stamp_ns)
        if decoded.name in self._group or decoded.stamp_ns - began_ns > TOGETHER * self.wire.command_period_s * S:
            names = ", ".join(self._group)
            self.record.doubled.append(f"{names} alone at {self._at(began_ns)}")
            self._group.clear()
        self._group[decoded.name] = decoded
        if len(self._group) < len(self.wire.command):
            return
        first_ns = min(one.stamp_ns for one in self._group.values())
        self._group.clear()
        asked = self.wire.reader.read(self._newest, speed_mps=self._speed_mps, direction=self._direction)
        if asked.get("GEAR_REQUEST", NO_REQUEST) != NO_REQUEST and abs(self._speed_mps) <= MOVES_MPS:
            self._direction = -1.0 if asked["GEAR_REQUEST"] == REVERSE else 1.0
        stop = self._stop.is_stop(asked, speed_mps=self._speed_mps, direction=self._direction, at_ns=decoded.stamp_ns)
        asked = {"ACCEL_REQUEST": self._stop.slope_mps2() if "SPEED_REQUEST" in asked else 0.0, **asked}
        asked["SAFE_STOP"] = float(stop)
        pair = Pair(DecodedFrame(first_ns, "COMMAND", asked), DecodedFrame(decoded.stamp_ns, "COMMAND", asked))
        self.record.pairs.append(pair)
        self.record.violations += [f"{self._at(pair.stamp_ns)}: {text}" for text in self._wrong_values(pair)]

    def _take_enable(self, decoded: DecodedFrame) -> None:
        """A message besides the commands says whether these are enabled."""
        if not self.wire.reader.is_enabled(self._newest):
            asked = self.wire.reader.read(self._newest, speed_mps=self._speed_mps, direction=self._direction)
            said = DecodedFrame(decoded.stamp_ns, "COMMAND", {"ACCEL_REQUEST": 0.0, "SAFE_STOP": 0.0, **asked})
            self.releases.append(Pair(said, said))

    def _unasked_drive(self, pair: Pair) -> Iterator[str]:
        """A drive of a vehicle that is not enabled, once the message that enables must have come."""
        carriers = [dotted for field in DRIVING for dotted in self.wire.carriers(field)]
        driving = [dotted for dotted in carriers if abs(self._newest.get(dotted, 0.0)) > RESTING_SLACK]
        if pair.is_enabled or not driving:
            self._drives_since_ns = None
            return
        since_ns = self._drives_since_ns = self._drives_since_ns or pair.stamp_ns
        grace_s = self.wire.enable_period_s + ENABLE_SLACK_S if self.wire.enable_period_s else 0.0
        if pair.stamp_ns - since_ns >= grace_s * S:
            for dotted in driving:
                yield f"{dotted} is {self._newest[dotted]:g} although the vehicle is not enabled"

    def _both_pedals(self, pair: Pair) -> Iterator[str]:
        """Drive and brake at once, for longer than a slower message of one of them takes to follow."""
        opposed = self.wire.opposed
        both = [[self._newest.get(name, 0.0) for name in self.wire.carriers(field)] for field in opposed]
        if not both or not all(any(value > RESTING_SLACK for value in values) for values in both):
            self._both_since_ns = None
            return
        self._both_since_ns = self._both_since_ns or pair.stamp_ns
        hold_s = self.wire.hold_s(*opposed)
        if pair.stamp_ns - self._both_since_ns >= (hold_s + ENABLE_SLACK_S * (hold_s > 0.0)) * S:
            yield f"{' and '.join(opposed)} at once"

    def _wrong_values(self, pair: Pair) -> Iterator[str]:
        wire, asked, limits = self.wire, pair.drive, self.wire.limits
        angle = asked["FRONT_WHEEL_ANGLE_REQUEST"]
        if wire.commands_angle and abs(angle) > limits.steer_rad + wire.wheel_count_rad:
            yield f"front wheels to {angle:.4f} rad"
        yield from self._unasked_drive(pair)
        yield from self._both_pedals(pair)
        enables = {bool(self._newest.get(name, 0.0)) for name in wire.carriers("enable")}
        if len(enables) > 1:
            yield "signals that enable contradict each other"
        if wire.commands_acceleration:
            low, high = limits.accel_range_mps2
            if self._direction < 0.0:
                low, high = -high, -low
            if not low - wire.accel_slack_mps2 <= asked["ACCEL_REQUEST"] <= high + wire.accel_slack_mps2:
                yield f"{asked['ACCEL_REQUEST']:.3f} m/s²"

    def _at(self, stamp_ns: int) -> str:
        return f"{(stamp_ns - self.record.begin_ns) / S:.3f} s"


def _judge_slow_answers(wire: PeerWire, record: Record) -> None:
    """Where commands are slower than samples: one in each of their periods, and no more."""
    period_ns = wire.command_period_s * S
    sampled_ns = [one.stamp_ns for one in record.samples]
    for before, after in pairwise(record.pairs):
        apart_ns = after.stamp_ns - before.stamp_ns
        if apart_ns > 0.2 * S:
            record.silences.append((before.stamp_ns, after.stamp_ns))
            continue
        samples = sampled_ns[bisect_right(sampled_ns, before.stamp_ns) : bisect_right(sampled_ns, after.stamp_ns)]
        at = f"{(after.stamp_ns - record.begin_ns) / S:.3f} s"
        if apart_ns > MISSED_PERIODS * period_ns and len(samples) > MISSED_PERIODS * period_ns / (wire.period_s * S):
            record.unanswered.append(f"no command for {len(samples)} samples until {at}")
        if samples:
            record.answers.append((samples[-1], after))
    for first, _, third in zip(record.pairs, record.pairs[1:], record.pairs[2:], strict=False):
        if third.stamp_ns - first.stamp_ns < 2.0 * CLOSE_PERIODS * period_ns:
            record.doubled.append(f"three commands before {(third.stamp_ns - record.begin_ns) / S:.3f} s")
