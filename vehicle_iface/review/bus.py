"""Checks of the frames themselves: periods, gaps, lengths, ranges, counters and checksums."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vehicle_iface.codec.binding import PERIODS, SENT_ROLES, Role
from vehicle_iface.codec.checksums import BitPlace
from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.codec.protection_rules import count_states, find_places, find_rule
from vehicle_iface.review.checksum_search import ChecksumFit, SearchedMessage, choose_fits, search_checksum
from vehicle_iface.review.findings import Finding, Level
from vehicle_iface.review.series import MessageFrames, RecordedDrive

GOOD_SHARE = 0.99
"""Share of the frames that must fit a rule. A bus loses and damages some."""
_PERIOD_TOLERANCE = 0.15
_GAP_PERIODS = 5.0
_FEWEST = 20
"""Minimum number of frames of a message for a finding."""
_FEWEST_INTACT = 0.5
_CHECKSUM_NAMES = ("crc", "checksum", "chksum", "chk", "cks", "csum")
_COUNTER_NAMES = ("counter", "cntr", "count", "cnt", "alive", "rolling", "sequence", "seq")


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageTiming:
    """Timing of the frames of one message."""

    name: str
    role: str
    count: int
    stated_ms: float | None
    """The period by profile or DBC."""
    period_ms: float | None
    """The median; None with fewer than two frames."""
    jitter_ms: float | None
    """Difference between the 1st and the 99th percentile of the periods."""
    longest_gap_ms: float | None
    gaps: int
    """Number of pauses of more than five periods."""
    out_of_range: int
    protection: str
    """Text on counter and checksum."""


def review_bus(drive: RecordedDrive) -> tuple[list[MessageTiming], list[Finding]]:
    """Return the timing of each bound message, and findings about the messages."""
    messages = (*drive.database.received, *drive.database.sent)
    protections = [_Protection(drive, message) for message in messages]
    chosen = choose_fits([protection.fits for protection in protections])
    timings, findings = [], []
    for message, protection, fit in zip(messages, protections, chosen, strict=True):
        frames = drive.frames[message.name]
        found, text = protection.describe(fit)
        timings.append(_measure_timing(drive, message, frames, text))
        findings += [*_find_timing_faults(drive, message, timings[-1]), *found]
    return timings, findings


def _measure_timing(drive: RecordedDrive, message: BoundMessage, frames: MessageFrames, text: str) -> MessageTiming:
    periods_ms = np.diff(np.array(frames.times_s)) * 1000.0
    is_known = len(periods_ms) > 0
    period_ms = float(np.median(periods_ms)) if is_known else None
    low, high = np.percentile(periods_ms, (1.0, 99.0)) if is_known else (0.0, 0.0)
    key = _period_key(drive, message)
    stated_ms = drive.binding.cycle_ms(message.name)
    if stated_ms is None and key:
        stated_ms = 1000.0 * float(getattr(drive.database.profile.timing, key))
    return MessageTiming(
        name=message.name,
        role=message.role.value,
        count=len(frames.times_s),
        stated_ms=stated_ms,
        period_ms=period_ms,
        jitter_ms=float(high - low) if is_known else None,
        longest_gap_ms=float(periods_ms.max()) if is_known else None,
        gaps=int(np.sum(periods_ms > _GAP_PERIODS * (period_ms or 1.0))),
        out_of_range=frames.out_of_range,
        protection=text,
    )


def _period_key(drive: RecordedDrive, message: BoundMessage) -> str:
    """Return the key of the profile's timing for a message; empty where several messages have periods of their own."""
    state, is_counted = drive.database.profile.state, drive.database.is_counted
    if message.role is Role.SAMPLE and not is_counted and message.name != (state.trigger or state.sample[0]):
        return ""
    if message.role is Role.STATUS and len(drive.binding.status_messages) > 1:
        return ""
    return PERIODS.get(message.role, "")


def _find_timing_faults(drive: RecordedDrive, message: BoundMessage, timing: MessageTiming) -> Iterator[Finding]:
    frames = drive.frames[message.name]
    name, is_sent = message.name, message.role in SENT_ROLES
    if not frames.times_s and not frames.wrong_lengths:
        level, who = (Level.NOTE, "nobody sent") if is_sent else (Level.CONTRADICTION, "the vehicle never sent")
        yield Finding(level=level, about=name, text=f"{who} {name} in this log")
        return
    total = timing.count + frames.wrong_lengths
    if frames.wrong_lengths > (1.0 - GOOD_SHARE) * total:
        text = f"{frames.wrong_lengths} of {total} frames of {name} do not have the DBC's {message.length} bytes"
        yield Finding(level=Level.CONTRADICTION, about=name, text=text)
    if timing.out_of_range > (1.0 - GOOD_SHARE) * max(1, timing.count):
        text = f"{timing.out_of_range} of {timing.count} frames of {name} are out of range: {frames.example}"
        yield Finding(level=Level.CONTRADICTION, about=name, text=text)
    if timing.count < _FEWEST or timing.period_ms is None:
        return
    if timing.stated_ms is not None and abs(timing.period_ms / timing.stated_ms - 1.0) > _PERIOD_TOLERANCE:
        text = f"{name} comes every {timing.period_ms:.3g} ms, not every {timing.stated_ms:.3g} ms"
        fix, key = f"[messages.{name}]\ncycle_ms = {timing.period_ms:.3g}", _period_key(drive, message)
        fix += f"\n[timing]\n{key} = {timing.period_ms / 1000.0:.3g}" if key else ""
        yield Finding(level=Level.CONTRADICTION, about=name, text=text, fix=fix)
    if timing.gaps and message.role is not Role.COMMAND:
        longest_s = (timing.longest_gap_ms or 0.0) / 1000.0
        text = f"{name} paused for more than 5 periods {_times(timing.gaps)}, for {longest_s:.2f} s at most"
        yield Finding(level=Level.DOUBT, about=name, text=text)


class _Protection:
    """Counter and checksum of one message: those of its rule, and those that its signals look like."""

    def __init__(self, drive: RecordedDrive, message: BoundMessage) -> None:
        self._message, self._profile = message, drive.database.profile
        frames = drive.frames[message.name]
        self._data = frames.payloads
        dbc = drive.binding.messages[message.name]
        self._signals = {signal.name: signal for signal in dbc.signals}
        self._places = find_places(dbc)
        self._rule = find_rule(self._profile, message.name)
        self._fields = set(drive.binding.signals_used(message.name))
        self._intact = self._count_intact()
        self.fits: list[ChecksumFit] = []
        self._checksum_name = self._find_checksum_name()
        if self._checksum_name and len(self._data) >= _FEWEST and self._intact < GOOD_SHARE:
            searched = SearchedMessage(
                can_id=message.can_id,
                is_extended=message.is_extended,
                length=message.length,
                place=self._places[self._checksum_name],
            )
            self.fits = search_checksum(searched, self._data, GOOD_SHARE)

    def describe(self, fit: ChecksumFit | None) -> tuple[list[Finding], str]:
        """Return findings about the protection, and a short text for the table."""
        if len(self._data) < _FEWEST:
            return [], ""
        checksum_findings, checksum = self._describe_checksum(fit)
        counter_findings, counter = self._describe_counter()
        texts = [text for text in (checksum, counter) if text]
        return [*checksum_findings, *counter_findings], "; ".join(texts) or "none"

    def _count_intact(self) -> float:
        """Return the share of frames whose checksum matches the profile's rule; 0 without a rule."""
        if self._rule is None or self._rule.checksum is None or self._message.protection is None or not self._data:
            return 0.0
        intact = self._message.protection.intact
        return sum(map(intact, self._data)) / len(self._data)

    def _find_checksum_name(self) -> str:
        if self._rule is not None and self._rule.checksum is not None:
            return self._rule.checksum.signal
        return self._find_name(_CHECKSUM_NAMES, 4)

    def _find_name(self, words: Sequence[str], least_bits: int) -> str:
        """Return the first signal with such a name that the profile does not use for anything else."""
        for name, signal in self._signals.items():
            plain = name.lower()
            is_called = any(word in plain for word in words) or plain.split("_")[-1] in ("cs",)
            if is_called and name not in self._fields and least_bits <= signal.length <= 16 and not signal.is_float:
                return name
        return ""

    def _describe_checksum(self, fit: ChecksumFit | None) -> tuple[list[Finding], str]:
        name = self._checksum_name
        dotted = f"{self._message.name}.{name}"
        is_stated = self._rule is not None and self._rule.checksum is not None
        if not name:
            return [], ""
        if self._intact >= GOOD_SHARE and self._rule is not None and self._rule.checksum is not None:
            return [], f"{name} is {self._rule.checksum.kind}, as stated"
        if fit is None:
            if not is_stated:
                text = f"{dotted} fits no checksum that is known here"
                return [Finding(level=Level.NOTE, about=dotted, text=text)], f"{name} fits nothing known"
            kind = self._rule.checksum.kind if self._rule is not None and self._rule.checksum is not None else ""
            text = (
                f"{dotted} is not {kind} as stated (fits {100 * self._intact:.0f} % of the frames), nor anything known"
            )
            level = Level.CONTRADICTION if self._intact < _FEWEST_INTACT else Level.DOUBT
            return [Finding(level=level, about=dotted, text=text)], f"{name} fits {100 * self._intact:.0f} %"
        says = f"{dotted} fits {fit.describe()}"
        if is_stated:
            text = f"{says}, not the rule of the profile (which fits {100 * self._intact:.0f} % of the frames)"
            level = Level.CONTRADICTION
        else:
            text, level = f"{says}; the profile does not check it", Level.NOTE
        counter = self._rule.counter.signal if self._rule is not None and self._rule.counter is not None else ""
        fix = fit.write_rule(self._message.name, name, counter)
        if self._profile.e2e is not None and self._message.name in self._profile.e2e.data_ids:
            fix += (
                f'\n# and {self._message.name} no more in [e2e.data_ids]; in a sample by counter, assemble = "counter"'
            )
        finding = Finding(level=level, about=dotted, text=text, fix=fix)
        return [finding], f"{name} fits {fit.describe()}"

    def _describe_counter(self) -> tuple[list[Finding], str]:
        is_stated = self._rule is not None and self._rule.counter is not None
        name = self._rule.counter.signal if self._rule is not None and self._rule.counter is not None else ""
        name = name or self._find_name(_COUNTER_NAMES, 2)
        if not name or name not in self._places:
            return [], ""
        counts = _read_all(self._places[name], self._data)
        dotted, states = f"{self._message.name}.{name}", count_states(self._signals[name])
        if is_stated and self._message.protection is not None:
            states = self._message.protection.counter_states
        steps = np.diff(counts)
        true_states = int(counts.max()) + 1
        share = float(np.mean(steps % states == 1)) if states > 1 else 0.0
        if share >= GOOD_SHARE:
            if is_stated:
                return [], f"{name} counts"
            text = f"{dotted} counts from 0 to {states - 1}; the profile does not check it"
            rule = f'[protection.counted]\ncounter = {{ signal = "{name}" }}'
            rule += f'\n[protection.messages]\n{self._message.name} = "counted"'
            return [Finding(level=Level.NOTE, about=dotted, text=text, fix=rule)], f"{name} counts, unchecked"
        if not is_stated:
            return [], ""
        if not np.any(steps):
            text = f"{dotted} does not count: it is always {counts[0]}"
        elif true_states > 1 and float(np.mean(steps % true_states == 1)) >= GOOD_SHARE:
            text = f"{dotted} counts from 0 to {true_states - 1}, not to {states - 1}"
        else:
            step, times = np.unique(steps % states, return_counts=True)
            usual = int(step[np.argmax(times)])
            often = 100.0 * times.max() / len(steps)
            if usual == 1:
                text = f"{dotted} steps by 1 in only {100 * share:.0f} % of the frames: frames are missing"
                return [Finding(level=Level.DOUBT, about=dotted, text=text)], f"{name} counts with gaps"
            text = f"{dotted} steps by {usual}, not by 1, in {often:.0f} % of the frames"
        return [Finding(level=Level.CONTRADICTION, about=dotted, text=text)], f"{name} does not count as stated"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _read_all(place: BitPlace, data: Sequence[bytes]) -> "np.typing.NDArray[np.int64]":
    return np.array([place.read(one) for one in data], np.int64)
