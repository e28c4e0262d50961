"""Counts, times, checks and decodes the frames of all buses. It reads no clock and no socket."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from itertools import pairwise

import msgspec

from vehicle_iface.codec.cantools_classes import Signal
from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.protection import NO_COUNTER
from vehicle_iface.errors import SignalError
from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface.units import NS_PER_S, ns_from_s, s_from_ns
from vehicle_iface_viewer.bus_table.finder import Found, MessageFinder
from vehicle_iface_viewer.bus_table.report import BusReport, MessageRow, SignalValue

WINDOW_NS = 2 * NS_PER_S
"""Rates and jitter are those of this time, or of three periods of a slower message."""
MAX_MESSAGES = 256
"""Identifiers that are listed; frames of further ones are counted only."""
_MAX_STAMPS = 1024


class BusMonitor:
    """All messages on the buses of one vehicle."""

    def __init__(self, finder: MessageFinder) -> None:
        self._finder = finder
        self._decoder = Decoder(finder.bound)
        self._seen: dict[FrameKey, _Seen] = {}
        self._frames = self._error_frames = self._unlisted = 0

    def add(self, frames: Iterable[CanFrame]) -> None:
        """Count, time and check frames, in the order in which they were received."""
        for frame in frames:
            self._frames += 1
            if frame.is_error:
                self._error_frames += 1
                continue
            key = FrameKey(frame.can_id, frame.is_extended, frame.bus)
            seen = self._seen.get(key)
            if seen is None:
                if len(self._seen) >= MAX_MESSAGES:
                    self._unlisted += 1
                    continue
                seen = self._seen[key] = _Seen(key, self._finder.find(key))
            seen.add(frame)
            if seen.bound is not None:
                self._decoder.decode(frame)

    def forget_sequences(self) -> None:
        """Accept any counter next: frames were lost on the way here, not on the bus."""
        self._decoder.reset()

    def report(self, now_ns: int, *, lost: int = 0, problem: str = "") -> BusReport:
        """Return all messages as they are now: the vehicle's by bus and identifier, then the loop's, then unknown
        ones."""
        errors: dict[str, dict[str, int]] = {}
        for (cause, name), count in self._decoder.drops.items():
            errors.setdefault(name, {})[cause.value] = count
        rows = [seen.row(now_ns, errors) for seen in self._seen.values()]
        rows.sort(key=lambda row: (not row.name, row.is_sent, row.bus, len(row.can_id), row.can_id))
        return BusReport(
            rows=rows,
            frames=self._frames,
            error_frames=self._error_frames,
            lost=lost,
            unlisted=self._unlisted,
            problem=problem,
        )


class _Seen:
    """What is known of one identifier."""

    def __init__(self, key: FrameKey, found: Found) -> None:
        bound, message = found.bound, found.message
        self.bound = bound
        self._can_id = f"0x{key.can_id:08X}" if key.is_extended else f"0x{key.can_id:03X}"
        self._bus = found.bus
        self._is_sent = found.is_sent
        self._name = bound.name if bound is not None else message.name if message is not None else ""
        period_s = bound.cycle_s if bound is not None else None
        if period_s is None and message is not None and message.cycle_time:
            period_s = message.cycle_time / 1e3
        self._period_s = period_s
        self._codec = found.compile_codec()
        self._signals = {signal.name: signal for signal in message.signals} if message is not None else {}
        self._shown: dict[str, SignalValue] = {}
        self._frames = 0
        self._stamps: deque[int] = deque(maxlen=_MAX_STAMPS)
        self._data = b""

    def add(self, frame: CanFrame) -> None:
        self._frames += 1
        self._stamps.append(frame.stamp_ns)
        self._data = frame.data

    def row(self, now_ns: int, errors: Mapping[str, dict[str, int]]) -> MessageRow:
        window_ns = max(WINDOW_NS, ns_from_s(3 * (self._period_s or 0.0)))
        while len(self._stamps) > 1 and now_ns - self._stamps[0] > window_ns:
            self._stamps.popleft()
        intervals = [after - before for before, after in pairwise(self._stamps)]
        mean_ns = sum(intervals) / len(intervals) if intervals else 0.0
        return MessageRow(
            bus=self._bus,
            can_id=self._can_id,
            name=self._name,
            is_sent=self._is_sent,
            is_masked=self.bound is not None and self.bound.is_masked,
            is_bound=self.bound is not None,
            frames=self._frames,
            rate_hz=NS_PER_S / mean_ns if mean_ns > 0.0 else 0.0,
            expected_hz=1.0 / self._period_s if self._period_s else None,
            age_s=max(s_from_ns(now_ns - self._stamps[-1]), 0.0),
            jitter_s=max(abs(each - mean_ns) for each in intervals) / NS_PER_S if intervals else None,
            counter=self._counter(),
            errors=dict(errors.get(self._name, {})) if self.bound is not None else {},
            data=self._data.hex(" ").upper(),
            signals=self._values(),
        )

    def _counter(self) -> int | None:
        protection = self.bound.protection if self.bound is not None else None
        if self.bound is None or protection is None or len(self._data) != self.bound.length:
            return None
        counter = protection.read_counter(self._data)
        return None if counter == NO_COUNTER else counter

    def _values(self) -> list[SignalValue]:
        if self._codec is None:
            return []
        try:
            values = self._codec.decode(self._data)
        except SignalError:  # too short: nothing of it can be shown as present
            values = (None,) * len(self._codec.names)
        for name, value in zip(self._codec.names, values, strict=True):
            old = self._shown.get(name)
            if value is not None:
                self._shown[name] = _signal_value(self._signals[name], value, old)
            elif old is not None:
                self._shown[name] = msgspec.structs.replace(
                    old, is_absent=True, is_out_of_range=False, has_changed=False
                )
        return list(self._shown.values())


def _signal_value(signal: Signal, value: Value, old: SignalValue | None) -> SignalValue:
    assert value is not None
    is_finite = math.isfinite(value)
    names: Mapping[int, object] = signal.choices or {}
    named = names.get(int(value)) if is_finite and value == int(value) else None
    text = str(named) if named is not None else f"{value:.7g}"
    low, high = signal.minimum, signal.maximum
    is_out = not is_finite or (low is not None and value < low) or (high is not None and value > high)
    return SignalValue(
        name=signal.name,
        value=text,
        unit=signal.unit or "",
        is_named=named is not None,
        is_out_of_range=is_out and named is None,
        has_changed=old is not None and old.value != text,
    )
