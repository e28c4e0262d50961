"""The signals of the buses that a plot can show, and the samples of those that somebody plots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle_iface_viewer.bus_table.report import BusReport, MessageRow, Samples, SignalKey

MAX_PLOTTED = 32
"""Signals that are kept at one time, for all browsers of a running loop or for one of a recording."""
MAX_SAMPLES = 100_000
"""Of each signal: the last ten minutes and the longest plot at 135 Hz, and 1.6 MB."""
MAX_OFFERED = 2000
KEPT_READS = 300
"""Calls of `advance`, half a minute, for which a signal is kept that nobody plots: a page may be loaded again."""
SAMPLE = np.dtype([("at_ns", "i8"), ("value", "f8")])
_FIRST_ROWS = 1024
_SPELLINGS = {
    "deg": "°",
    "deg/s": "°/s",
    "m/s^2": "m/s²",
    "m/s/s": "m/s²",
}
"""Of units: signals of one unit share an axis."""

SampleRows = npt.NDArray[np.void]
"""Rows of `SAMPLE`, in the order of their times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BusSignal:
    """A signal of one identifier."""

    key: SignalKey
    unit: str


class BusSignals:
    """Grows with the messages that are seen in a session; samples only of signals that are wanted."""

    def __init__(self) -> None:
        self.offered: tuple[str, ...] = ()
        """Names like `MOTION.SPEED, m/s`, in the order of the table."""
        self.problem = ""
        """Why there may be none."""
        self._signals: dict[str, BusSignal] = {}
        self._listed: list[tuple[str, str, int]] = []
        self._reads_left: dict[str, int] = {}
        self._samples: dict[SignalKey, _History] = {}

    def clear(self) -> None:
        """Forget all signals: those of another session follow."""
        self.offered, self.problem = (), ""
        self._signals, self._listed = {}, []
        self._samples.clear()

    def clear_samples(self) -> None:
        """Forget the samples: those of another time follow."""
        self._samples = {key: _History() for key in self._samples}

    def update(self, report: BusReport | None) -> None:
        """Offer what the table lists."""
        if report is None:
            return
        self.problem = report.problem or report.note
        listed = [(row.bus, row.can_id, len(row.signals)) for row in report.rows]
        if listed != self._listed:
            self._listed = listed
            self._signals = {**self._signals, **dict(pair for row in report.rows for pair in _of_message(row))}
            self.offered = tuple(self._signals)[:MAX_OFFERED]

    def find(self, name: str) -> BusSignal | None:
        """Return the signal of that name, if it has been seen."""
        return self._signals.get(name)

    def want(self, name: str) -> None:
        """Keep samples of that signal for some time."""
        if name in self._signals:
            self._reads_left[name] = KEPT_READS

    def advance(self) -> list[SignalKey]:
        """Return the signals to be sampled now; forget samples of all others."""
        self._reads_left = {name: left - 1 for name, left in self._reads_left.items() if left > 0}
        keys = [self._signals[name].key for name in self._reads_left if name in self._signals][:MAX_PLOTTED]
        self._samples = {key: self._samples.get(key) or _History() for key in keys}
        return keys

    def is_left_out(self, name: str) -> bool:
        """Whether no samples of that signal are kept, as too many others are."""
        signal = self._signals.get(name)
        return signal is not None and signal.key not in self._samples and len(self._samples) >= MAX_PLOTTED

    def extend(self, keys: Sequence[SignalKey], samples: Sequence[Samples]) -> None:
        """Add new samples of these signals."""
        for key, new in zip(keys, samples, strict=True):
            history = self._samples.get(key)
            if history is not None and new.times_ns:
                history.extend(new)

    def between(self, name: str, begin_ns: int, end_ns: int) -> SampleRows:
        """Return the samples after `begin_ns` and up to `end_ns`: valid until the next `extend`."""
        signal = self._signals.get(name)
        history = self._samples.get(signal.key) if signal is not None else None
        return history.between(begin_ns, end_ns) if history is not None else np.zeros(0, SAMPLE)


class _History:
    """The newest samples of one signal."""

    def __init__(self) -> None:
        self._rows: SampleRows = np.zeros(_FIRST_ROWS, SAMPLE)
        self._end = 0

    def extend(self, new: Samples) -> None:
        begin, end = self._end, self._end + len(new.times_ns)
        if end > len(self._rows):
            kept = self._rows[: self._end][-MAX_SAMPLES * 4 // 5 :]
            begin, end = len(kept), len(kept) + len(new.times_ns)
            rows = np.zeros(max(min(2 * end, MAX_SAMPLES), end), SAMPLE)
            rows[:begin] = kept
            self._rows = rows
        # Stamps are those of the wall clock, which may be set back.
        newest_ns = self._rows["at_ns"][begin - 1] if begin else 0
        self._rows["at_ns"][begin:end] = np.maximum.accumulate(np.maximum(new.times_ns, newest_ns))
        self._rows["value"][begin:end] = new.values
        self._end = end

    def between(self, begin_ns: int, end_ns: int) -> SampleRows:
        rows = self._rows[: self._end]
        first, last = np.searchsorted(rows["at_ns"], (begin_ns, end_ns), side="right")
        return rows[first:last]


def _of_message(row: MessageRow) -> Iterator[tuple[str, BusSignal]]:
    bus = f"{row.bus} " if row.bus else ""
    which = f" {row.can_id}" if row.is_masked else ""
    for signal in row.signals:
        unit = _SPELLINGS.get(signal.unit, signal.unit)
        name = f"{bus}{row.name}{which}.{signal.name}" + (f", {unit}" if unit else "")
        yield name, BusSignal(key=SignalKey(bus=row.bus, can_id=row.can_id, signal=signal.name), unit=unit)
