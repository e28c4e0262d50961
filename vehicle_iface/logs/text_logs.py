"""Logs with one frame a line that are read by a `TextFormat`: the loop and the accounts that these have in common."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.candump import BYTE_ORDER_MARK
from vehicle_iface.logs.frames import Chunk, Frame, RefusedLine

BATCH_LINES = 5_000
"""Lines that are read at once."""


@dataclass(frozen=True, slots=True)
class FrameLine:
    """A line that should be a frame."""

    number: int
    text: str
    stamp_ns: int | None = None
    """Stamp of the line; None where the reader of the frame sets it."""


class TextFormat(ABC):
    """Reads the lines of one log, in their order."""

    stamps: str
    """Meaning of the stamps, for a person; valid after all lines."""

    @abstractmethod
    def sort_out(self, text: str, number: int) -> FrameLine | None:
        """Return a line that should be a frame; None for a header, a comment or an event."""

    @abstractmethod
    def parse(self, lines: Sequence[FrameLine], chunk: Chunk) -> Iterator[Frame]:
        """Parse the data frames; count every other line in `chunk` by kind."""


class SingleLineFormat(TextFormat):
    """A format whose lines are parsed one by one."""

    def parse(self, lines: Sequence[FrameLine], chunk: Chunk) -> Iterator[Frame]:
        """Parse the data frames; reject an invalid line with its reason."""
        for line in lines:
            try:
                yield self.parse_line(line)
            except ValueError as error:
                chunk.refused.append(RefusedLine(line.number, str(error)))

    @abstractmethod
    def parse_line(self, line: FrameLine) -> Frame:
        """Parse the frame of a line. `ValueError` when it is none."""


def read_text_log(path: Path, text_format: TextFormat) -> Iterator[Chunk]:
    """Read the log in chunks. `ConfigError` when the file cannot be read."""
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            number, done_bytes = 1, 0
            while batch := [line for _, line in zip(range(BATCH_LINES), file, strict=False)]:
                done_bytes += sum(map(len, batch))
                if number == 1:
                    batch[0] = batch[0].removeprefix(BYTE_ORDER_MARK)
                yield _parse_batch(batch, number, text_format, done_bytes, max(size, done_bytes))
                number += len(batch)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def _parse_batch(batch: Sequence[bytes], first: int, text_format: TextFormat, done: int, total: int) -> Chunk:
    chunk = Chunk(lines=len(batch), done_bytes=done, total_bytes=total)
    lines = []
    for number, raw in enumerate(batch, start=first):
        text = raw.decode("utf-8", "backslashreplace").strip()
        if not text:
            chunk.blank += 1
        elif (line := text_format.sort_out(text, number)) is not None:
            lines.append(line)
        else:
            chunk.comments += 1
    chunk.add(text_format.parse(lines, chunk))
    return chunk
