"""Recognise which program wrote a log, by its content, then by its suffix."""

import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from shlex import quote

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.candump import BYTE_ORDER_MARK
from vehicle_iface.logs.candump_line import find_stamps
from vehicle_iface.logs.stamps import Stamps

_HEAD_BYTES = 1 << 18
"""Bytes at the beginning of a file that determine its kind."""


class LogKind(Enum):
    """Supported kinds of logs; the value is the name for a person."""

    CANDUMP = "candump"
    ASC = "Vector .asc"
    TRC = "PEAK .trc"
    BLF = "Vector .blf"
    SAVVYCAN = "SavvyCAN .csv"
    CSV = "python-can .csv"


READABLE = ", ".join(kind.value for kind in LogKind)
_ASC_BASE = re.compile(rb"base\s+(hex|dec)\b", re.IGNORECASE)
_ASC_FRAME = re.compile(rb"\s*\d+\.\d+\s+(\d+\s+[0-9A-Fa-f]+x?|CANFD\s+\d+)\s+(Rx|Tx)\s", re.IGNORECASE)
_TRC_FRAME = re.compile(rb"\s*\d+\)\s+\d+(\.\d+)?\s")
SAVVYCAN_HEADER = b"Time Stamp,ID,Extended,"
CSV_HEADER = b"timestamp,arbitration_id,extended,remote,error,dlc,data"


@dataclass(frozen=True, slots=True)
class RecognizedLog:
    """The kind of a log."""

    kind: LogKind
    stamps: Stamps
    """Of a candump log; `AS_LOGGED` for the others."""


def recognize_log(path: Path) -> RecognizedLog:
    """Recognise the kind of a file. `ConfigError` when it cannot be read or its kind is not supported."""
    try:
        with path.open("rb") as file:
            if not file.seekable():
                raise ConfigError(f"{path}: must be a file, not a pipe or a device; write the log to a file first")
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    for magic, what, way in _FOREIGN:
        if head.startswith(magic):
            way = way.format(path=quote(str(path)), log=quote(str(path.with_suffix(".log"))))
            raise ConfigError(f"{path}: {what} cannot be read; {way}")
    if head.startswith(b"LOGG"):
        return RecognizedLog(LogKind.BLF, Stamps.AS_LOGGED)
    return _recognize_text(path, head.removeprefix(BYTE_ORDER_MARK))


def _recognize_text(path: Path, head: bytes) -> RecognizedLog:
    lines = head.splitlines() or [b""]
    stamps = find_stamps(lines)
    if stamps is not None:
        return RecognizedLog(LogKind.CANDUMP, stamps)
    suffix, first = path.suffix.lower(), lines[0].strip()
    if any(line.startswith(b";$FILEVERSION") for line in lines):
        kind = LogKind.TRC
    elif any(_ASC_BASE.match(line) or _ASC_FRAME.match(line) for line in lines):
        kind = LogKind.ASC
    elif first.startswith(SAVVYCAN_HEADER):
        kind = LogKind.SAVVYCAN
    elif first == CSV_HEADER:
        kind = LogKind.CSV
    elif suffix == ".trc" or any(_TRC_FRAME.match(line) for line in lines):
        kind = LogKind.TRC
    elif suffix == ".csv":
        header = first[:60].decode("utf-8", "replace")
        expected = f"{SAVVYCAN_HEADER.decode()}… (SavvyCAN) or {CSV_HEADER.decode()} (python-can)"
        raise ConfigError(f"{path}:1: CSV with the header {header!r}: must be {expected}")
    else:
        kind = LogKind.ASC if suffix == ".asc" else LogKind.CANDUMP
    return RecognizedLog(kind, Stamps.AS_LOGGED)


_MF4 = (
    "MF4 (ASAM MDF)",
    "convert it in an environment of its own: pipx run --spec 'python-can[mf4]' can_logconvert {path} {log}",
)
_UNPACK = "unpack it first"
_FOREIGN = (
    (b"MDF     ", *_MF4),
    (b"UnFinMF ", *_MF4),
    (b"SQLite format 3\0", "SQLite (python-can .db)", "convert it: can_logconvert {path} {log}"),
    *(
        (magic, "a packet capture", "record the bus with candump -L, or export it as .asc")
        for magic in (
            b"\x0a\x0d\x0d\x0a",
            b"\xd4\xc3\xb2\xa1",
            b"\xa1\xb2\xc3\xd4",
            b"\x4d\x3c\xb2\xa1",
            b"\xa1\xb2\x3c\x4d",
        )
    ),
    *(
        (magic, "a compressed file", _UNPACK)
        for magic in (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd")
    ),
    *(
        (magic, "text in UTF-16", "convert it: iconv -f UTF-16 -t UTF-8 {path} > {log}")
        for magic in (b"\xff\xfe", b"\xfe\xff")
    ),
)
"""Beginning of an unsupported file, its kind, and how to convert it."""
