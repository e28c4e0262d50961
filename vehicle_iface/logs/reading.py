"""Reads any supported log, in chunks of one form."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface.logs.candump import read_candump
from vehicle_iface.logs.frames import Chunk
from vehicle_iface.logs.kinds import LogKind, recognize_log
from vehicle_iface.logs.python_can_logs import BLF_STAMPS, AscFormat, CsvFormat, TrcFormat, read_blf
from vehicle_iface.logs.savvycan import SavvyCanFormat
from vehicle_iface.logs.stamps import Stamps
from vehicle_iface.logs.text_logs import TextFormat, read_text_log

_TEXT_FORMATS: dict[LogKind, Callable[[], TextFormat]] = {
    LogKind.ASC: AscFormat,
    LogKind.TRC: TrcFormat,
    LogKind.SAVVYCAN: SavvyCanFormat,
    LogKind.CSV: CsvFormat,
}


@dataclass(frozen=True, slots=True)
class OpenedLog:
    """A log of a known kind."""

    kind: LogKind
    chunks: Iterator[Chunk]
    """Chunks, which can be read once. `ConfigError` when the file cannot be read."""
    describe_stamps: Callable[[], str]
    """Returns the meaning of the stamps, for a person; valid after the last chunk."""


def open_log(path: Path) -> OpenedLog:
    """Open the log at a path. `ConfigError` when it cannot be read or is of no known kind."""
    recognized = recognize_log(path)
    if recognized.kind is LogKind.CANDUMP:
        return open_candump(path, recognized.stamps)
    if recognized.kind is LogKind.BLF:
        return OpenedLog(recognized.kind, read_blf(path), lambda: BLF_STAMPS)
    text_format = _TEXT_FORMATS[recognized.kind]()
    return OpenedLog(recognized.kind, read_text_log(path, text_format), lambda: text_format.stamps)


def open_candump(path: Path, stamps: Stamps = Stamps.AS_LOGGED) -> OpenedLog:
    """Open a log as candump's, regardless of its content."""
    return OpenedLog(LogKind.CANDUMP, read_candump(path, stamps), lambda: stamps.value)
