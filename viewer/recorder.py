"""What the recorder says of itself in its folder, for the page of the loop that is being recorded."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

import msgspec

from vehicle_iface.recorder.files import REPORT, REPORT_BYTES, REPORT_S, Report
from vehicle_iface.units import ns_from_s, s_from_ns

SILENT_AFTER_S = 5 * REPORT_S
_LOOK_NS = ns_from_s(REPORT_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderState:
    """How the recording of this drive goes."""

    folder: str
    fault: str = ""
    """What is or was lost, in words; empty where all is well."""


class RecorderWatch:
    """Looks once a second."""

    def __init__(self) -> None:
        self._due_ns = 0
        self._state: RecorderState | None = None

    def state(self, folder: str, now_ns: int) -> RecorderState | None:
        """Of the recorder that writes to `folder`; None where there is none."""
        if not folder:
            return None
        if self._state is None or self._state.folder != folder or now_ns >= self._due_ns:
            self._due_ns = now_ns + _LOOK_NS
            self._state = RecorderState(folder=folder, fault=_fault(_read(Path(folder) / REPORT), now_ns))
        return self._state


def _fault(report: Report | None, now_ns: int) -> str:
    if report is None:
        return "no word from the recorder"
    silent_s = s_from_ns(now_ns - report.at_ns)
    silence = f"no word for {silent_s:.0f} s" if silent_s > SILENT_AFTER_S and not report.is_over else ""
    return ", ".join(part for part in (silence, report.trouble, report.loss) if part)


def _read(path: Path) -> Report | None:
    try:
        file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        content = os.pread(file, REPORT_BYTES, 0) if stat.S_ISREG(os.fstat(file).st_mode) else b""
        return msgspec.json.decode(content, type=Report)
    except (OSError, msgspec.MsgspecError, ValueError, RecursionError):
        return None
    finally:
        os.close(file)
