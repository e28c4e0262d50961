"""Logs read by python-can: .asc, .trc, .csv and .blf. It is imported on first use, which takes 0.2 s."""

import io
import itertools
import logging
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.frames import (
    EXTENDED,
    GREATEST_STAMP_S,
    LAST_ID,
    LAST_STANDARD_ID,
    MAX_FD_BYTES,
    Chunk,
    Frame,
    RefusedLine,
)
from vehicle_iface.logs.stamps import parse_seconds
from vehicle_iface.logs.text_logs import FrameLine, TextFormat

if TYPE_CHECKING:
    from can import Message

BATCH_FRAMES = 10_000
"""Frames of a .blf that are read at once."""
BLF_STAMPS = "of the log, taken as UTC"


class _PythonCanText(TextFormat):
    """Gives python-can the frames of a log with the header that they need: many at once, and one by one where it
    does not make a message of each."""

    first_channel = 0
    """Added to python-can's numbers, so that a channel is called as in the file."""

    def __init__(self) -> None:
        self._header: list[str] = []

    def read_messages(self, file: TextIO) -> "Iterable[Message]":
        """Return all messages of a text, by python-can."""
        raise NotImplementedError

    def parse(self, lines: Sequence[FrameLine], chunk: Chunk) -> Iterator[Frame]:
        """Parse the data frames; count every other line by kind."""
        whole = self._try([line.text for line in lines])
        is_complete = len(whole.messages) == len(lines)
        for index, line in enumerate(lines):
            one = _Parsed([whole.messages[index]]) if is_complete else self._try([line.text])
            if len(one.messages) != 1:
                chunk.refused.append(RefusedLine(line.number, f"{one.fault or 'no frame'}: {line.text[:60]}"))
            elif (
                frame := to_frame(one.messages[0], line.number, line.stamp_ns, self.first_channel, chunk)
            ) is not None:
                yield frame

    def _try(self, texts: Sequence[str]) -> "_Parsed":
        """Return the messages of some lines, or the reason why they cannot be read."""
        with _collected_warnings() as warnings:
            try:
                messages = list(self.read_messages(io.StringIO("\n".join((*self._header, *texts)))))
            except Exception as error:  # noqa: BLE001 (python-can lets through whatever its parsing runs into)
                return _Parsed([], str(error) or type(error).__name__)
        return _Parsed([], warnings[0]) if warnings else _Parsed(messages)


@contextmanager
def _collected_warnings() -> Iterator[list[str]]:
    """What python-can's readers warn of, instead of their log: it is a fault of the line that is read."""
    warnings: list[str] = []

    def collect(record: logging.LogRecord) -> bool:
        if record.levelno >= logging.WARNING:
            warnings.append(record.getMessage())
        return record.levelno < logging.WARNING

    loggers = [logging.getLogger(f"can.io.{name}") for name in ("asc", "trc", "blf")]
    for logger in loggers:
        logger.addFilter(collect)
    try:
        yield warnings
    finally:
        for logger in loggers:
            logger.removeFilter(collect)


@dataclass(frozen=True, slots=True)
class _Parsed:
    messages: "list[Message]"
    fault: str = ""


class AscFormat(_PythonCanText):
    """Reads Vector's .asc. The stamps are parsed here: python-can neither sums relative ones nor keeps nanoseconds."""

    first_channel = 1
    _BASE = re.compile(r"base\s+(hex|dec)(\s+timestamps\s+relative)?", re.IGNORECASE)
    _STAMP = re.compile(r"(\d+\.\d+)\s+(.*)")
    _FRAME = re.compile(r"(CANFD|\d+)\s+(?!\s|Statistic|OverloadFrame)", re.IGNORECASE)

    def __init__(self) -> None:
        super().__init__()
        self._set_base("hex")
        self._is_relative = False
        self._sum_ns = 0

    def _set_base(self, base: str) -> None:
        self._header = [f"base {base}  timestamps absolute", "no internal events logged"]

    @property
    def stamps(self) -> str:  # type: ignore[override]
        """What the stamps mean."""
        summed = ", sums of the log's differences" if self._is_relative else ""
        return f"seconds since the start of the measurement{summed}"

    def sort_out(self, text: str, number: int) -> FrameLine | None:
        """Return stamped lines that begin with a channel, except bus statistics: they should be frames."""
        base = self._BASE.match(text)
        if base is not None:
            self._set_base(base[1].lower())
            self._is_relative = base[2] is not None
            return None
        event = self._STAMP.match(text)
        if event is None:
            return None if self._is_header(text) else FrameLine(number, text)
        stamp_ns = parse_seconds(event[1].encode())
        if self._is_relative and stamp_ns is not None:
            stamp_ns = self._sum_ns = self._sum_ns + stamp_ns
        return FrameLine(number, text, stamp_ns) if self._FRAME.match(event[2]) else None

    @staticmethod
    def _is_header(text: str) -> bool:
        return text.lower().startswith(
            ("//", "date ", "internal events", "no internal event", "begin trig", "end trig")
        )

    def read_messages(self, file: TextIO) -> "Iterable[Message]":
        """Return all messages of a text, by python-can."""
        from can.io.asc import ASCReader

        return ASCReader(file)


class TrcFormat(_PythonCanText):
    """Reads PEAK's .trc."""

    _EVENTS = frozenset(("Error", "Warng", "Event", "Status", "ER", "EC", "ST", "EV", "FFFFFFFF"))
    """Types of lines that are no frames, and the identifier that marks them in version 1.0."""

    def __init__(self) -> None:
        super().__init__()
        self._has_begun = False

    @property
    def stamps(self) -> str:  # type: ignore[override]
        """What the stamps mean."""
        if any(line.startswith(";$STARTTIME") for line in self._header):
            return "start time of the log, taken as UTC, plus each frame's offset"
        return "seconds since the start of the log"

    def sort_out(self, text: str, number: int) -> FrameLine | None:
        """Return lines without `;`, except errors and events of the adapter: they should be frames."""
        if text.startswith(";"):
            if not self._has_begun:
                self._header.append(text)
            return None
        self._has_begun = True
        return None if self._EVENTS.intersection(text.split(maxsplit=5)[1:5]) else FrameLine(number, text)

    def read_messages(self, file: TextIO) -> "Iterable[Message]":
        """Return all messages of a text, by python-can."""
        from can.io.trc import TRCReader

        return TRCReader(file)


class CsvFormat(_PythonCanText):
    """Reads the .csv of python-can."""

    stamps = "as logged"

    def sort_out(self, text: str, number: int) -> FrameLine | None:
        """Return every line except the header: it should be a frame."""
        if number > 1:
            return FrameLine(number, text)
        self._header = [text]
        return None

    def read_messages(self, file: TextIO) -> "Iterable[Message]":
        """Return all messages of a text, by python-can."""
        from can.io.csv import CSVReader

        return CSVReader(file)


def read_blf(path: Path) -> Iterator[Chunk]:
    """Read a .blf in chunks; a frame's number replaces its line number. `ConfigError` when it cannot be read."""
    from can.io.blf import BLFReader

    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            try:
                reader = BLFReader(file)
            except Exception as error:  # noqa: BLE001 (python-can lets through whatever its parsing runs into)
                raise ConfigError(f"{path}: cannot be read as .blf: {error}") from None
            fault = f"{size} of {reader.file_size} bytes: the file is cut off" if size < reader.file_size else ""
            yield from _read_blf_messages(iter(reader), fault, lambda: size if file.closed else file.tell(), size)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def _read_blf_messages(
    messages: "Iterator[Message]", fault: str, tell_done: Callable[[], int], total_bytes: int
) -> Iterator[Chunk]:
    """Read all messages; each fault of the file is counted as a separate line."""
    number, is_over = 1, False
    while not is_over:
        batch: list[Message] = []
        with _collected_warnings() as warnings:
            try:
                for message in itertools.islice(messages, BATCH_FRAMES):
                    batch.append(message)
                is_over = len(batch) < BATCH_FRAMES
            except Exception as error:  # noqa: BLE001 (as above)
                fault, is_over = fault or f"the rest cannot be read: {str(error) or type(error).__name__}", True
        chunk = Chunk(lines=len(batch), done_bytes=total_bytes if is_over else tell_done(), total_bytes=total_bytes)
        found = (to_frame(message, line, None, 1, chunk) for line, message in enumerate(batch, start=number))
        chunk.add(frame for frame in found if frame is not None)
        number += len(batch)
        faults = [f"frames before this one are missing: {warning}" for warning in warnings]
        faults += [fault] if is_over and fault else []
        chunk.lines += len(faults)
        chunk.refused += [RefusedLine(number, text) for text in faults]
        yield chunk


def to_frame(message: "Message", line: int, stamp_ns: int | None, first_channel: int, chunk: Chunk) -> Frame | None:
    """Return the data frame of a message; None after counting another or an invalid frame in `chunk`."""
    if message.is_error_frame:
        chunk.errors += 1
    elif message.is_remote_frame:
        chunk.remote += 1
    elif fault := _fault(message):
        chunk.refused.append(RefusedLine(line, fault))
    else:
        if stamp_ns is None:
            stamp_ns = round(message.timestamp * 1e6) * 1000  # a float has no more digits
        key = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
        channel = message.channel
        name = str(channel + first_channel) if isinstance(channel, int) else str(channel or "")
        return Frame(line, stamp_ns, key, bytes(message.data), name)
    return None


def _fault(message: "Message") -> str:
    """Return why a message cannot have been on a bus; python-can does not check it."""
    from can.util import dlc2len

    last = LAST_ID if message.is_extended_id else LAST_STANDARD_ID
    if not 0 <= message.arbitration_id <= last:
        return f"identifier {message.arbitration_id:X}: must be at most {last:X}"
    if not abs(message.timestamp) <= GREATEST_STAMP_S:
        return f"stamp {message.timestamp} s: must be at most {GREATEST_STAMP_S} s"
    length = len(message.data)
    allowed = {message.dlc, dlc2len(message.dlc), message.dlc if message.is_fd else min(message.dlc, 8)}
    if length not in allowed or length > MAX_FD_BYTES:
        return f"{length} bytes: must be {message.dlc}, as the line says"
    return ""
