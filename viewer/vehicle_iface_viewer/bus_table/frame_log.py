"""The frames of a recording, in the format of candump's log."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface.recorder import files
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.lines import Lines

_STAMP = re.compile(r"\((\d{1,10})\.(\d{6})\)")
_FRAME = re.compile(
    r"\((\d{1,10})\.(\d{6})\) (\S+) ([0-9A-F]{3}|[0-9A-F]{8})#(#[0-9A-F])?((?:[0-9A-F]{2}){0,64})", re.ASCII
)
_ERROR, _LAST_ID, _LAST_STANDARD_ID = 0x20000000, 0x1FFFFFFF, 0x7FF


class FrameLog:
    """Frames by their number; a recording without any is empty. `ConfigError` when the file cannot be read."""

    def __init__(self, folder: Path, wall_offset_ns: int) -> None:
        """`wall_offset_ns` is added to times of the monotonic clock to get those of the file."""
        self._offset_ns = wall_offset_ns
        self._lines = Lines(folder / files.FRAMES)

    def __len__(self) -> int:
        return len(self._lines)

    def count_until(self, at_ns: int) -> int:
        """Return the number of frames up to that time."""
        return bisect_right(range(len(self._lines)), at_ns + self._offset_ns, key=self._stamp_ns)

    def frames(
        self, first: int, end: int, buses: Mapping[str, int], only: Collection[FrameKey] | None = None
    ) -> Iterator[CanFrame]:
        """Yield the frames from `first` to before `end` of the interfaces in `buses`, if `only` is given those of its
        identifiers. Remote frames and damaged lines are left out."""
        lines: Iterable[str] = self._lines.texts(first, end)
        if only is not None:
            marks = [f" {key.can_id:0{8 if key.is_extended else 3}X}#" for key in only]
            lines = (line for line in lines if any(mark in line for mark in marks))
        return _parse(lines, buses, self._offset_ns)

    def close(self) -> None:
        """Close the file."""
        self._lines.close()

    def _stamp_ns(self, index: int) -> int:
        found = _STAMP.match(self._lines.text(index))
        return int(found[1]) * NS_PER_S + int(found[2]) * 1000 if found is not None else 0


def _parse(lines: Iterable[str], buses: Mapping[str, int], offset_ns: int) -> Iterator[CanFrame]:
    for line in lines:
        found = _FRAME.fullmatch(line)
        if found is None or found[3] not in buses:
            continue
        can_id, is_extended, is_fd = int(found[4], 16), len(found[4]) == 8, found[5] is not None
        data, is_error = bytes.fromhex(found[6]), is_extended and bool(can_id & _ERROR)
        if (can_id & ~_ERROR) > (_LAST_ID if is_extended else _LAST_STANDARD_ID) or (len(data) > 8 and not is_fd):
            continue
        yield CanFrame(
            can_id & _LAST_ID,
            data,
            int(found[1]) * NS_PER_S + int(found[2]) * 1000 - offset_ns,
            is_extended=is_extended,
            is_fd=is_fd,
            is_error=is_error,
            bus=buses[found[3]],
        )
