"""Judges a soak by what was seen at both ends of its bad cable, stretch by stretch, in memory that does not grow.

At the loop's end every frame is seen that the loop has sent, and every one that reached it; at the vehicle's end the
same of the vehicle. So it is known what the cable did to each frame, what the loop could know when it sent a command,
and what a receiver by the bus contract has to drop, and why. Nothing of this asks the program.
"""

from bisect import bisect, bisect_left
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from vehicle_bus_contract.judge import (
    JITTER_NS,
    LEAST_LOSS_NS,
    OLDEST_ANSWERED_NS,
    SAMPLE_WINDOW_NS,
    SETTLING_NS,
    Pair,
    examine,
)
from vehicle_bus_contract.reference import CONTROLLER_SENDS, FAULT, GREATEST_STEP, MS, REFERENCE, DecodedFrame, Frame, S
from vehicle_bus_contract.socketcan import ReceivedFrame

VEHICLE_SENDS = tuple(name for name in REFERENCE.messages if name not in CONTROLLER_SENDS)
ROUTINE = {"NOMINAL", "NOT_ENGAGED", "STATE_STALE", "SHUTDOWN", "VEHICLE_FAULT"}
"""What a command may say: driving, before and after it, samples that stayed away, a vehicle whose watchdog acted."""
STALL_NS = 30 * MS
"""A vehicle that sends every 10 ms, and has sent nothing for so long, got no time."""
LOST = "lost"
ACCEPTED = ("", LOST)
MOST_WIDENED = 4
"""Damaged frames that widen the next step of a counter."""
HOLD_NS = 250 * MS
"""A stop for samples that did not come goes on for 0.2 s after they have come again."""
SILENT_NS = 100 * MS
"""So long without a command is long enough for the vehicle's watchdog."""
OVERLAP_NS = 1 * S
"""A stretch is judged once more with the next one, so that nothing is missed between them."""
REOPENED_NS = 300 * MS
"""After the link is up again, frames come for so long that the loop may not hear: it tries at 10 Hz."""
OLDEST_NS = 200 * MS
"""No frame is on its way for longer: one that is was kept back by somebody."""
UNANSWERED = "is not answered"
MOST_UNANSWERED = 0.005
"""Of the samples; more of them is a loop that is too slow."""
RECENT = 8
"""Flaps that may lie in what is being judged."""
MOST_WRONG = 1000


class LinkOutage(NamedTuple):
    """The link was down, wall clock."""

    down_ns: int
    up_ns: int


class SoakLog:
    """Events of the soak by the wall clock, which is the clock of the stamps."""

    def __init__(self, begin_ns: int) -> None:
        self.begin_ns = begin_ns
        self.outages: list[LinkOutage] = []
        """When the loop's link was down."""
        self.armings_ns = [begin_ns]
        """The loop is armed from its start."""
        self.first_ns: int | None = None
        """When the loop sent its first frame."""
        self.end_ns: int | None = None
        """When the loop was told to end."""
        self.stalls: list[tuple[int, int]] = []
        """Begin and end of each time without a frame of the vehicle: the machine stood still."""

    def is_link_down(self, at_ns: int) -> bool:
        """Whether the link is down then, or not yet open again."""
        return any(flap.down_ns - JITTER_NS <= at_ns <= flap.up_ns + REOPENED_NS for flap in self.outages[-RECENT:])

    def is_excused(self, at_ns: int) -> bool:
        """Whether an outage or a stall explains what happens then."""
        place = bisect(self.stalls, (at_ns + JITTER_NS, at_ns + JITTER_NS))
        return self.is_link_down(at_ns) or (place > 0 and at_ns <= self.stalls[place - 1][1] + SETTLING_NS)

    def last_down_ns(self, before_ns: int) -> int:
        """When the link went down last before that, ns; 0 if it never did."""
        return next((flap.down_ns for flap in reversed(self.outages) if flap.down_ns < before_ns), 0)

    def is_blind(self, at_ns: int) -> bool:
        """Whether it is unknown what the loop receives then."""
        is_outside = self.first_ns is None or at_ns < self.first_ns or (self.end_ns is not None and at_ns > self.end_ns)
        return is_outside or self.is_link_down(at_ns)

    def armed_since(self, since_ns: int, until_ns: int) -> bool:
        """Whether the loop was armed in that time."""
        return bisect(self.armings_ns, until_ns) > bisect(self.armings_ns, since_ns)

    def at(self, stamp_ns: int) -> str:
        """Seconds since the beginning."""
        return f"{(stamp_ns - self.begin_ns) / S:.3f} s"


class FramePath:
    """One direction of the cable: frames sent, frames arrived, and what a receiver counts."""

    def __init__(self, names: Sequence[str], log: SoakLog) -> None:
        self._names, self._log = names, log
        self._sent: defaultdict[tuple[int, bytes], list[int]] = defaultdict(list)
        self._last: dict[str, int] = {}
        self._damaged: Counter[str] = Counter()
        self._down_ns = 0
        self.sent = 0
        self.came = 0
        self.clear: Counter[str] = Counter()
        """`repeated POSE`, `lost MOTION`, …: what the receiver must have counted."""
        self.blurred: Counter[str] = Counter()
        """The same, while it is unknown whether the receiver was open."""
        self.longest_ns = 0
        self.wrong: list[str] = []

    def add_sent(self, frame: Frame) -> None:
        """A frame was sent."""
        self.sent += 1
        self._sent[frame.can_id, frame.data].append(frame.stamp_ns)

    def add_arrived(self, frame: Frame) -> DecodedFrame | None:
        """A frame has arrived; its content if a receiver accepts it."""
        name = REFERENCE.names.get(frame.can_id)
        if name not in self._names or name is None:
            return None
        self.came += 1
        down_ns = self._log.last_down_ns(frame.stamp_ns)
        if down_ns > self._down_ns:
            self._down_ns = down_ns
            self._last.clear()
            self._damaged.clear()
        decoded = REFERENCE.intact(frame)
        cause, count = self._judged(frame, name, decoded)
        if count:
            counts = self.blurred if self._log.is_blind(frame.stamp_ns) else self.clear
            counts[f"{cause} {name}"] += count
        if decoded is not None:
            self._judge_age(frame, name)
        return decoded if cause in ACCEPTED else None

    def forget_before(self, stamp_ns: int) -> None:
        """Drop the frames sent before that: they have arrived or are lost."""
        for key in list(self._sent):
            self._sent[key] = [each for each in self._sent[key] if each >= stamp_ns]
            if not self._sent[key]:
                del self._sent[key]

    def _judged(self, frame: Frame, name: str, decoded: DecodedFrame | None) -> tuple[str, int]:
        """What a receiver counts, and how many."""
        if decoded is None:
            if frame.is_extended or frame.is_remote or frame.is_fd:
                return "wrong type", 1
            if not REFERENCE.is_well_formed(frame):
                return "wrong length", 1
            self._damaged[name] = min(self._damaged[name] + 1, MOST_WIDENED)
            return "bad CRC", 1
        before, self._last[name] = self._last.get(name), decoded.counter
        if before is None:
            return "", 0
        step = (decoded.counter - before) % REFERENCE.counters
        if step == 0:
            return "repeated", 1
        widest = GREATEST_STEP + self._damaged.pop(name, 0)
        return ("wrong sequence", 1) if step > widest else (LOST, step - 1)

    def _judge_age(self, frame: Frame, name: str) -> None:
        stamps = self._sent.get((frame.can_id, frame.data), [])
        place = bisect(stamps, frame.stamp_ns + JITTER_NS)  # what is not delayed may come before it is seen to leave
        if not place:
            self.wrong.append(f"{self._log.at(frame.stamp_ns)}: an intact {name} arrives that was not sent")
            return
        age_ns = frame.stamp_ns - stamps[place - 1]
        self.longest_ns = max(self.longest_ns, age_ns)
        if age_ns > OLDEST_NS and not self._log.is_excused(frame.stamp_ns):
            self.wrong.append(f"{self._log.at(frame.stamp_ns)}: {name} arrives {age_ns / MS:.0f} ms after it was sent")


class Sample(NamedTuple):
    """A state sample that reached the loop whole."""

    first_ns: int
    """When its first frame came: it is as old as that."""
    stamp_ns: int
    """When it was complete."""


class Samples:
    """Assembles samples from the frames that reached the loop: one counter value, within 50 ms."""

    def __init__(self) -> None:
        self._pending: dict[int, tuple[int, set[str]]] = {}
        """By counter: when the first frame came, and which have come."""
        self._complete: dict[int, int] = {}
        self._first_ns = 0
        self.complete = 0
        self.overtaken = 0
        """Samples that are older than the one before: they need no answer."""

    def take(self, decoded: DecodedFrame) -> Sample | None:
        """The sample that this frame completes, if it does."""
        counter, at_ns = decoded.counter, decoded.stamp_ns
        if at_ns - self._complete.get(counter, 0) <= SAMPLE_WINDOW_NS:
            return None
        first_ns, names = self._pending.pop(counter, (at_ns, set()))
        if at_ns - first_ns > SAMPLE_WINDOW_NS:
            first_ns, names = at_ns, set()
        names.add(decoded.name)
        if len(names) < len(REFERENCE.sample):
            self._pending[counter] = first_ns, names
            return None
        self._complete[counter] = at_ns
        self.complete += 1
        if first_ns < self._first_ns:
            self.overtaken += 1
            return None
        self._first_ns = first_ns
        return Sample(first_ns, at_ns)


class Judge:
    """Judges the frames at both ends, a stretch at a time."""

    def __init__(self, log: SoakLog) -> None:
        self.log = log
        self.to_loop, self.to_vehicle = FramePath(VEHICLE_SENDS, log), FramePath(CONTROLLER_SENDS, log)
        self.wrong: dict[str, None] = {}
        """Everything that is wrong, each once, in order."""
        self.reasons: Counter[str] = Counter()
        self.delays_ms: Counter[float] = Counter()
        """From a sample's completion to its answer, in bins of 0.1 ms."""
        self.sent: Counter[str] = Counter()
        """Intact frames of the loop by message."""
        self.samples = Samples()
        self.pairs = self.stale_stops = self.foreign = 0
        self.stale_commands = self.repeated_commands = self.counter_gaps = self.explained_gaps = 0
        self._kept: list[ReceivedFrame] = []
        self._last: dict[str, DecodedFrame] = {}
        self._drive: DecodedFrame | None = None
        """The first half of the pair that is being sent."""
        self._pair_ns = self._settled_ns = self._crossed_ns = 0
        self._debts: deque[Sample] = deque()
        """Samples that wait for their answers."""
        self._held_until_ns = 0
        self._left: deque[tuple[int, int]] = deque(maxlen=100)
        """How many still waited after each of the last pairs: its stamp, and their number."""
        self._newest = self._before = Sample(0, 0)
        self._enabled_ns: int | None = None
        """Of the last command that was enabled."""
        self._is_out = False
        self._vehicle_ns = 0
        self._causes_ns: list[int] = []

    def report(self, *texts: str) -> None:
        """Add to what is wrong, up to a limit."""
        for text in texts:
            if len(self.wrong) < MOST_WRONG:
                self.wrong[text] = None

    def _report_unless_excused(self, at_ns: int, text: str) -> None:
        """The same, unless an outage or a stall explains it."""
        if not self.log.is_excused(at_ns):
            self.report(f"{self.log.at(at_ns)}: {text}")

    def take(self, at_loop: Sequence[ReceivedFrame], at_vehicle: Sequence[ReceivedFrame]) -> None:
        """The next stretch, each end in the order of its stamps."""
        if self.log.first_ns is None:
            self.log.first_ns = next((seen.frame.stamp_ns for seen in at_loop if seen.is_own), None)
        self._look_for_stalls(at_vehicle)
        self._add_sent(at_loop, at_vehicle)
        for seen in at_loop:
            frame = seen.frame
            if seen.is_own:
                self._judge_own(frame)
            else:
                self._look_for_causes(frame)
                self._take_arrival(self.to_loop.add_arrived(frame))
        for seen in at_vehicle:
            if not seen.is_own:
                self.to_vehicle.add_arrived(seen.frame)
        for way in (self.to_loop, self.to_vehicle):
            self.report(*way.wrong)
            way.wrong.clear()
        self._judge_values([*self._kept, *at_loop])

    def finish(self) -> None:
        """Nothing more comes."""
        if self._enabled_ns is not None and not self._is_out:
            self._leave()
        if not self.pairs:
            self.report("no drive: not one command pair")

    def as_dict(self) -> dict[str, Any]:
        """What was found, for programs; `wrong` lists all that is wrong."""
        return {
            "samples": self.samples.complete,
            "samples_overtaken": self.samples.overtaken,
            "pairs": self.pairs,
            "pairs_by_reason": dict(self.reasons),
            "repeated_commands": self.repeated_commands,
            "stale_commands": self.stale_commands,
            "stale_stops": self.stale_stops,
            "counter_gaps": self.counter_gaps,
            "counter_gaps_at_flaps": self.explained_gaps,
            "foreign_commands": self.foreign,
            "answer_delay_ms": {f"p{share}": self._delay_ms(share / 100) for share in (50, 99)}
            | {"max": max(self.delays_ms, default=None)},
            "to_loop": _figures_of(self.to_loop),
            "to_vehicle": _figures_of(self.to_vehicle),
        }

    def _look_for_stalls(self, at_vehicle: Sequence[ReceivedFrame]) -> None:
        for seen in at_vehicle:
            if seen.is_own:
                at_ns, before_ns = seen.frame.stamp_ns, self._vehicle_ns or seen.frame.stamp_ns
                self._vehicle_ns = at_ns
                if at_ns - before_ns > STALL_NS:
                    self.log.stalls.append((before_ns, at_ns))

    def _add_sent(self, at_loop: Sequence[ReceivedFrame], at_vehicle: Sequence[ReceivedFrame]) -> None:
        for way, seen_there in ((self.to_loop, at_vehicle), (self.to_vehicle, at_loop)):
            for seen in seen_there:
                if seen.is_own:
                    way.add_sent(seen.frame)
            if seen_there:
                way.forget_before(seen_there[0].frame.stamp_ns - S)

    def _look_for_causes(self, frame: Frame) -> None:
        """What may end the commanding: the loop's identifiers from elsewhere, a vehicle that says it has a fault."""
        name = REFERENCE.names.get(frame.can_id)
        if frame.is_extended:
            return
        if name in CONTROLLER_SENDS:
            self.foreign += 1
            self._causes_ns.append(frame.stamp_ns)
        elif name == "VEHICLE_STATUS":
            decoded = REFERENCE.intact(frame)
            if decoded is not None and decoded["MODE"] == FAULT:
                self._causes_ns.append(frame.stamp_ns)

    def _take_arrival(self, decoded: DecodedFrame | None) -> None:
        if decoded is None or decoded.name not in REFERENCE.sample:
            return
        sample = self.samples.take(decoded)
        if sample is not None:
            self._before, self._newest = self._newest, sample
            self._debts.append(sample)

    def _judge_own(self, frame: Frame) -> None:
        """One frame of the loop: whole, with the next counter, and not while it has to be silent."""
        decoded, at = REFERENCE.intact(frame), self.log.at(frame.stamp_ns)
        if decoded is None:
            self.report(f"{at}: the loop sent 0x{frame.can_id:03X}#{frame.data.hex()}, no intact message")
            return
        self.sent[decoded.name] += 1
        down_ns = self.log.last_down_ns(frame.stamp_ns - JITTER_NS)
        if down_ns and not self.log.armed_since(down_ns, frame.stamp_ns):
            self.report(f"{at}: {decoded.name} after the link was down, and nobody had armed the loop again")
        self._judge_counter(decoded, at)
        self._judge_half(decoded, at)

    def _judge_counter(self, decoded: DecodedFrame, at: str) -> None:
        """Each frame steps its message's counter by one."""
        before, self._last[decoded.name] = self._last.get(decoded.name), decoded
        if before is None:
            return
        step = (decoded.counter - before.counter) % REFERENCE.counters
        if step == 0:
            self.repeated_commands += 1
            self.report(f"{at}: {decoded.name} with the counter of the one before it, {decoded.counter}")
        elif step != 1 and any(self.log.is_link_down(each.stamp_ns) for each in (before, decoded)):
            self.explained_gaps += 1
        elif step != 1:
            self.counter_gaps += 1
            self.report(f"{at}: {decoded.name} counts from {before.counter} to {decoded.counter}")

    def _judge_half(self, decoded: DecodedFrame, at: str) -> None:
        """A DRIVE_COMMAND, and then the STEER_COMMAND that belongs to it."""
        if decoded.name not in REFERENCE.command:
            return
        is_first, drive = decoded.name == REFERENCE.command[0], self._drive
        if is_first is not (drive is None) and not self.log.is_excused(decoded.stamp_ns):
            self.report(f"{at}: half a pair before this {decoded.name}")
        self._drive = decoded if is_first else None
        if not is_first and drive is not None:
            self._judge_pair(Pair(drive, decoded), at)

    def _judge_pair(self, pair: Pair, at: str) -> None:
        self.pairs += 1
        self.reasons[f"{pair.reason}, {'enabled' if pair.is_enabled else 'released'}"] += 1
        if pair.reason not in ROUTINE:
            self._report_unless_excused(pair.stamp_ns, f"a command that says {pair.reason}")
        waited_ns = pair.drive.stamp_ns - self._newest.first_ns
        if pair.is_enabled and not pair.is_stop and waited_ns > OLDEST_ANSWERED_NS:
            self.stale_commands += 1
            self.report(f"{at}: driven on without a sample for {waited_ns / MS:.0f} ms")
        self._judge_answer(pair)
        self._judge_commanding(pair)

    def _judge_answer(self, pair: Pair) -> None:
        """Each sample opens a debt, each pair pays the oldest one, or is a stop because no sample came.

        Such a stop may cross the late sample on the wire; then the sample's own answer comes right after it.
        """
        if pair.stamp_ns - self._pair_ns > SILENT_NS or self.log.armed_since(self._pair_ns, pair.stamp_ns):
            self._settled_ns = pair.stamp_ns + SETTLING_NS
        self._pair_ns = pair.stamp_ns
        if pair.stamp_ns < self._settled_ns:
            self._debts.clear()
            self._left.clear()
            return
        sent_ns = pair.drive.stamp_ns
        while self._debts and sent_ns - self._debts[0].stamp_ns > OLDEST_ANSWERED_NS:
            self._report_unless_excused(self._debts.popleft().stamp_ns, f"a sample that {UNANSWERED}")
        never_paid = min((count for _, count in self._left), default=0) if len(self._left) == self._left.maxlen else 0
        for _ in range(min(never_paid, len(self._debts))):
            self._debts.popleft()
            self._report_unless_excused(self._left[0][0], f"a sample shortly before this {UNANSWERED}")
        if never_paid:
            self._left.clear()
        is_stale = sent_ns - self._newest.first_ns > LEAST_LOSS_NS
        is_crossing = self._newest.first_ns - self._before.first_ns > LEAST_LOSS_NS
        if pair.reason == "STATE_STALE" and pair.is_enabled:
            self.stale_stops += 1
            if is_stale or is_crossing or self.log.is_excused(pair.stamp_ns):
                self._held_until_ns = pair.stamp_ns + HOLD_NS
            elif pair.stamp_ns > self._held_until_ns:
                self._report_unless_excused(pair.stamp_ns, "a stop for STATE_STALE, and the newest sample is not old")
        if self._debts:
            delay_ns = pair.stamp_ns - self._debts.popleft().stamp_ns
            self.delays_ms[round(delay_ns / MS, 1)] += 1
            self._left.append((pair.stamp_ns, len(self._debts)))
            self._crossed_ns = pair.stamp_ns if pair.is_stop and is_crossing else self._crossed_ns
        elif pair.is_stop and is_stale:
            return
        elif pair.stamp_ns - self._crossed_ns < JITTER_NS:
            self._crossed_ns = 0
        else:
            self._report_unless_excused(pair.stamp_ns, f"a pair that answers nothing, {pair.reason}")

    def _judge_commanding(self, pair: Pair) -> None:
        """Commanding ends for a cause, and begins again only after an arming."""
        enabled_ns = self._enabled_ns
        is_over = enabled_ns is not None and (not pair.is_enabled or pair.stamp_ns - enabled_ns > SILENT_NS)
        if is_over and not self._is_out and not (pair.is_enabled and self.log.is_excused(pair.stamp_ns)):
            self._leave()
        if not pair.is_enabled:
            return
        if self._is_out and enabled_ns is not None and not self.log.armed_since(enabled_ns, pair.stamp_ns):
            self.report(f"{self.log.at(pair.stamp_ns)}: commands again, and nobody had armed the loop again")
        self._enabled_ns, self._is_out = pair.stamp_ns, False

    def _leave(self) -> None:
        assert self._enabled_ns is not None
        self._is_out = True
        at_ns = self._enabled_ns
        place = bisect_left(self._causes_ns, at_ns - SILENT_NS)
        is_caused = place < len(self._causes_ns) and self._causes_ns[place] <= at_ns + SILENT_NS
        is_ending = self.log.end_ns is not None and at_ns > self.log.end_ns
        if not (is_caused or is_ending or self.log.is_excused(at_ns + JITTER_NS)):
            self.report(f"{self.log.at(at_ns)}: the last command of a drive that had no cause to end")
        del self._causes_ns[:place]

    def _judge_values(self, stretch: Sequence[ReceivedFrame]) -> None:
        """Ranges, rates, and signals that must agree with each other."""
        arrived = (
            seen.frame for seen in stretch if seen.is_own or REFERENCE.names.get(seen.frame.can_id) in VEHICLE_SENDS
        )
        record = examine([Frame(self.log.begin_ns, 0x7FF, b""), *arrived])  # so its times are those of the soak
        self.report(*record.violations)
        if stretch:
            self._keep(stretch, stretch[-1].frame.stamp_ns - OVERLAP_NS)

    def _delay_ms(self, share: float) -> float | None:
        rank, total = 0, sum(self.delays_ms.values())
        for delay_ms in sorted(self.delays_ms):
            rank += self.delays_ms[delay_ms]
            if rank >= share * total:
                return delay_ms
        return None

    def _keep(self, stretch: Sequence[ReceivedFrame], since_ns: int) -> None:
        """The last second, from a command's first frame on: half a pair would be taken for another one's half."""
        first = REFERENCE.messages[REFERENCE.command[0]][0]
        recent = [seen for seen in stretch if seen.frame.stamp_ns >= since_ns]
        begin = next((i for i, seen in enumerate(recent) if seen.is_own and seen.frame.can_id == first), 0)
        self._kept = recent[begin:]


def without_expired(wrong: Iterable[str], summary: dict[str, Any]) -> list[str]:
    """What is wrong, without the few samples that the loop itself counts as expired or held up: it answers none.

    A machine can keep the loop from running without keeping the vehicle from sending, and frames come late in a row.
    """
    found, counts = list(wrong), summary["counts"]
    unanswered = {text for text in found if UNANSWERED in text}
    counted = counts["samples_expired"] + counts["samples_held_up"]
    if len(unanswered) > min(counted, MOST_UNANSWERED * summary["samples"]):
        return found
    return [text for text in found if text not in unanswered]


def wrong_with_counts(judge: Judge, summary: dict[str, Any]) -> list[str]:
    """Where the loop's own counts cannot be those of what reached it."""
    slack, wrong = len(judge.log.outages) + 1, []
    drops, seen = summary["drops"], judge.to_loop
    counted = {**drops, **{f"lost {name}": count for name, count in summary["lost"].items()}}
    for what in sorted(counted.keys() | seen.clear.keys()):
        if what.endswith(VEHICLE_SENDS):
            least, most = seen.clear[what] - slack, seen.clear[what] + seen.blurred[what] + slack
            if not least <= counted.get(what, 0) <= most:
                wrong.append(f"the loop counts {what}: {counted.get(what, 0)}, and {least} to {most} were seen")
    counts = summary["counts"]
    for what, count, observed in (
        ("commands", counts["commands"], judge.pairs),
        ("frames sent", counts["frames_sent"], sum(judge.sent.values())),
        ("foreign commands", counts["foreign_commands"], judge.foreign),
    ):
        if abs(count - observed) > slack:
            wrong.append(f"the loop counts {what}: {count}, and {observed} were seen")
    return wrong


def wrong_with_cable(way: FramePath, name: str, chances: dict[str, float]) -> list[str]:
    """Faults that the cable was to do, and did not, although each was to be expected a dozen times.

    `chances` of a frame: that it is lost, doubled, overtaken or damaged.
    """
    wrong = []
    for cause, chance in chances.items():
        if chance * way.sent >= 12 and not any(what.startswith(cause) for what in way.clear):
            wrong.append(f"the cable {name} did nothing of this kind: {cause}")
    return wrong


def _figures_of(way: FramePath) -> dict[str, Any]:
    causes: Counter[str] = Counter()
    for counts in (way.clear, way.blurred):
        for what, count in counts.items():
            causes[what.rpartition(" ")[0]] += count
    return {"sent": way.sent, "came": way.came, **causes, "longest_on_the_way_ms": round(way.longest_ns / MS, 1)}
