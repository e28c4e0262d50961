"""Health of the recorder, from the status file in its folder."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

import msgspec

from vehicle_iface.recorder.files import STATUS, STATUS_BYTES, STATUS_PERIOD_S, RecorderStatus
from vehicle_iface.units import ns_from_s, s_from_ns

SILENT_AFTER_S = 5 * STATUS_PERIOD_S
_PERIOD_NS = ns_from_s(STATUS_PERIOD_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderHealth:
    """Health of the recording of this drive."""

    folder: str
    fault: str = ""
    """What is wrong or was lost, as text; empty when all is well."""


class RecorderMonitor:
    """Reads the status once a second."""

    def __init__(self) -> None:
        self._due_ns = 0
        self._health: RecorderHealth | None = None

    def check(self, folder: str, now_ns: int) -> RecorderHealth | None:
        """Health of the recorder that writes to `folder`; None when the drive is not recorded."""
        if not folder:
            return None
        if self._health is None or self._health.folder != folder or now_ns >= self._due_ns:
            self._due_ns = now_ns + _PERIOD_NS
            self._health = RecorderHealth(
                folder=folder, fault=_describe_fault(_read_status(Path(folder) / STATUS), now_ns)
            )
        return self._health


def _describe_fault(status: RecorderStatus | None, now_ns: int) -> str:
    if status is None:
        return "no status from the recorder"
    silent_s = s_from_ns(now_ns - status.at_ns)
    silence = f"no status for {silent_s:.0f} s" if silent_s > SILENT_AFTER_S and not status.is_over else ""
    return ", ".join(part for part in (silence, status.trouble, status.loss) if part)


def _read_status(path: Path) -> RecorderStatus | None:
    try:
        file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        content = os.pread(file, STATUS_BYTES, 0) if stat.S_ISREG(os.fstat(file).st_mode) else b""
        return msgspec.json.decode(content, type=RecorderStatus)
    except (OSError, msgspec.MsgspecError, ValueError, RecursionError):
        return None
    finally:
        os.close(file)
