"""Parse single lines of candump: of its log format (`-L`) or of its screen output."""

import re
from collections.abc import Iterable

from vehicle_iface.logs.frames import (
    EXTENDED,
    LAST_ID,
    LAST_STANDARD_ID,
    MAX_CLASSICAL_BYTES,
    MAX_FD_BYTES,
    Chunk,
    Frame,
    RefusedLine,
)
from vehicle_iface.logs.stamps import StampReader, Stamps, recognize_stamps

_ERROR = 0x20000000
_LOG = re.compile(
    rb"(?:\((?P<stamp>[^)]*)\)\s+)?(?P<channel>\S+)\s+(?P<id>[0-9A-Fa-f]{3,8})"
    rb"#(?P<fd>#[0-9A-Fa-f])?(?P<data>(?:[0-9A-Fa-f]{2}\.?)*|R[0-8]?)(?:_[9A-Fa-f])?(?:\s+[RT])?"
)
_SCREEN = re.compile(
    rb"(?:\((?P<stamp>[^)]*)\)\s+)?(?P<channel>\S+)\s+(?:[RT]X\s+[B-] [E-]\s+)?"
    rb"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+\[(?P<length>\d\d?)\]"
    rb"(?:\s+remote request|(?P<data>(?:\s+[0-9A-Fa-f]{2})*)(?:\s+ERRORFRAME|\s+'.*')?)"
)
"""Output of candump without `-L`, perhaps with `-x` (direction) or `-a` (characters). Two digits of length: FD."""
_COLOUR = re.compile(rb"\x1b\[[\d;]*m")
_STAMP = re.compile(rb"\s*\(([^)]*)\)")


class LineReader:
    """Reads the lines of one log: returns data frames and counts all other lines by kind."""

    def __init__(self, stamps: Stamps) -> None:
        self._stamps = StampReader(stamps)

    def read(self, line: bytes, number: int, chunk: Chunk) -> Frame | None:
        """Return the data frame of line `number`; None after counting the line in `chunk`."""
        text = _plain(line)
        if not text:
            chunk.blank += 1
            return None
        found = _match(text)
        if found is None:
            self._refuse_line(text, line.startswith(b"\t"), number, chunk)
            return None
        stamp_ns = self._stamps.read(found["stamp"])
        if stamp_ns is None:
            stamp = (found["stamp"] or b"none").decode("ascii", "backslashreplace")
            why = f"stamp {stamp[:40]}: must be like the first of this log ({self._stamps.stamps.value})"
            chunk.refused.append(RefusedLine(number, why + self._lost_time(None)))
            return None
        try:
            return _frame(found, number, stamp_ns, chunk)
        except ValueError as error:
            chunk.refused.append(RefusedLine(number, str(error)))
            return None

    def _refuse_line(self, text: bytes, is_indented: bool, number: int, chunk: Chunk) -> None:
        """Count a line that is no frame; `candump -e` explains error frames in indented ones."""
        if is_indented:
            chunk.comments += 1
            return
        stamp = _STAMP.match(text)
        why = f"no frame: {text[:60].decode('ascii', 'backslashreplace')}"
        lost = self._lost_time(self._stamps.read(stamp[1]) if stamp is not None else None)
        chunk.refused.append(RefusedLine(number, why + lost))

    def _lost_time(self, stamp_ns: int | None) -> str:
        is_lost = stamp_ns is None and self._stamps.stamps is Stamps.DIFFERENCES
        return "; every stamp after it lacks its difference" if is_lost else ""


def find_stamps(lines: Iterable[bytes]) -> Stamps | None:
    """Return the kind of stamps of these lines; None when no line is a frame."""
    frames = [found for line in lines if (found := _match(_plain(line))) is not None]
    return recognize_stamps(found["stamp"] for found in frames) if frames else None


def _plain(line: bytes) -> bytes:
    return (_COLOUR.sub(b"", line) if b"\x1b" in line else line).strip()


def _match(text: bytes) -> re.Match[bytes] | None:
    return _LOG.fullmatch(text) or _SCREEN.fullmatch(text)


def _frame(found: re.Match[bytes], number: int, stamp_ns: int, chunk: Chunk) -> Frame | None:
    """Return the data frame of a line; None after counting another frame, `ValueError` for an invalid one."""
    can_id, is_long = int(found["id"], 16), len(found["id"]) > 3
    if is_long and _ERROR <= can_id < 2 * _ERROR:
        chunk.errors += 1
        return None
    last = LAST_ID if is_long else LAST_STANDARD_ID
    if can_id > last:
        raise ValueError(f"identifier {can_id:X}: must be at most {last:X}")
    data, length, is_fd = found["data"], None, found.re is _LOG and found["fd"] is not None
    if found.re is _SCREEN:
        length, is_fd = int(found["length"]), len(found["length"]) == 2
    if (data is None or data.startswith(b"R")) and not is_fd:
        chunk.remote += 1
        return None
    payload = b"" if data is None or data.startswith(b"R") else bytes.fromhex(data.replace(b".", b"").decode("ascii"))
    longest = MAX_FD_BYTES if is_fd else MAX_CLASSICAL_BYTES
    if len(payload) > longest or data is None or data.startswith(b"R"):
        raise ValueError(f"{len(payload)} bytes: no payload of such a frame")
    if length is not None and length != len(payload):
        raise ValueError(f"{len(payload)} bytes: must be {length}, as the line says")
    channel = found["channel"].decode("utf-8", "backslashreplace")
    return Frame(number, stamp_ns, can_id | EXTENDED if is_long else can_id, payload, channel)
