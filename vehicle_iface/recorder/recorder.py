"""Writes bus and telemetry into files. A slow disk delays this process, never the loop."""

import contextlib
import errno
import os
from collections.abc import Callable
from pathlib import Path

import msgspec

from vehicle_iface.recorder import files
from vehicle_iface.recorder.black_box import BlackBox
from vehicle_iface.recorder.folder import RecordingRequest, create_folder, empty_folder, not_writable_error
from vehicle_iface.recorder.frame_tap import FrameTaps
from vehicle_iface.recorder.inputs_tap import InputsTap
from vehicle_iface.recorder.sink import Sink
from vehicle_iface.recorder.telemetry_tap import NewLines, TelemetryTap
from vehicle_iface.units import ns_from_s


class Recorder:
    """Records until `close`. `ConfigError` or `BusError` when it cannot start; it then leaves nothing behind."""

    def __init__(self, request: RecordingRequest, notify: Callable[[str], None]) -> None:
        self._telemetry = TelemetryTap(request.telemetry)
        self._frames = FrameTaps(request.channels, notify) if request.channels else None
        self._inputs = InputsTap(request.inputs_fd) if request.inputs_fd >= 0 else None
        self._notify = notify
        self._sinks: dict[str, Sink] = {}
        self._file = -1
        if request.folder:
            self._open(request)
        place = Path(request.black_box)
        self._black_box = BlackBox(place, request, self._telemetry.info, notify) if request.black_box else None
        self._reported_losses: dict[str, int] = {}
        self._status_due_ns = 0

    def _open(self, request: RecordingRequest) -> None:
        """Create the folder and the files of a recording."""
        folder, notify = Path(request.folder), self._notify
        try:
            create_folder(request, self._telemetry.info)
            self._file = os.open(folder / files.STATUS, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
            if os.pwrite(self._file, b" " * files.STATUS_BYTES, 0) < files.STATUS_BYTES:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self._sinks = {
                "snapshots": Sink(folder / files.SNAPSHOTS, notify, files.SNAPSHOT_HEADER),
                "trajectories": Sink(folder / files.TRAJECTORIES, notify),
                "counters": Sink(folder / files.COUNTERS, notify),
                "events": Sink(folder / files.EVENTS, notify),
            }
            if self._frames is not None:
                self._sinks["frames"] = Sink(folder / files.FRAMES, notify)
            if self._inputs is not None:
                self._sinks["inputs"] = Sink(folder / files.INPUTS, notify)
        except OSError as error:
            empty_folder(folder)
            raise not_writable_error(folder, error) from error

    def step(self, now_ns: int) -> None:
        """Write everything that has arrived since the last step."""
        lines = self._telemetry.read(now_ns)
        frames = self._frames.read(now_ns) if self._frames is not None else []
        if self._sinks:
            self._write(lines, frames, now_ns)
        if self._black_box is not None:
            self._black_box.add(lines, frames, now_ns, is_loop_dead=self._telemetry.is_loop_dead)
        if now_ns >= self._status_due_ns:
            self._status_due_ns = now_ns + ns_from_s(files.STATUS_PERIOD_S)
            self._save(self.status(now_ns))
            self._report_losses()

    def _write(self, lines: NewLines, frames: list[bytes], now_ns: int) -> None:
        if self._frames is not None:
            self._sinks["frames"].write(frames, now_ns)
        if self._inputs is not None:
            self._sinks["inputs"].write(self._inputs.read(now_ns), now_ns)
        self._sinks["snapshots"].write(lines.snapshots, now_ns)
        self._sinks["trajectories"].write(lines.trajectories, now_ns)
        self._sinks["counters"].write(lines.counters, now_ns)
        self._sinks["events"].write(lines.events, now_ns)

    def status(self, now_ns: int, *, is_over: bool = False) -> files.RecorderStatus:
        """Return what was written and lost so far."""
        written = {name: sink.written for name, sink in sorted(self._sinks.items())}
        lost = {name: sink.lost for name, sink in sorted(self._sinks.items())}
        for name, count in self._count_overwritten().items():
            lost[name] = lost.get(name, 0) + count
        if self._black_box is not None:
            written["black boxes"], lost["black boxes"] = self._black_box.kept, self._black_box.lost
        trouble = next((sink.trouble for sink in self._sinks.values() if sink.trouble), "")
        return files.RecorderStatus(at_ns=now_ns, is_over=is_over, written=written, lost=lost, trouble=trouble)

    def close(self, now_ns: int) -> files.RecorderStatus:
        """Write the final status and close all files."""
        if self._inputs is not None:
            self._sinks["inputs"].write(self._inputs.read(now_ns, is_last=True), now_ns)
            self._inputs.close()
        if self._black_box is not None:
            self._black_box.finish()
        status = self.status(now_ns, is_over=True)
        self._save(status)
        if self._file >= 0:
            os.close(self._file)
        for sink in self._sinks.values():
            sink.close()
        if self._frames is not None:
            self._frames.close()
        self._telemetry.close()
        return status

    def _count_overwritten(self) -> dict[str, int]:
        """Count what was overwritten before it could be read, by kind."""
        of_bus = {"frames": self._frames.lost} if self._frames is not None else {}
        return of_bus | {
            "snapshots": self._telemetry.snapshots_lost,
            "trajectories": self._telemetry.trajectories_lost,
            "events": self._telemetry.events_lost,
        }

    def _report_losses(self) -> None:
        fresh = {name: count - self._reported_losses.get(name, 0) for name, count in self._count_overwritten().items()}
        if any(fresh.values()):
            self._reported_losses = self._count_overwritten()
            what = ", ".join(f"{count:,} {name}" for name, count in fresh.items() if count)
            self._notify(f"too slow: {what} lost; the drive continues")

    def _save(self, status: files.RecorderStatus) -> None:
        if self._file < 0:
            return
        text = msgspec.json.format(msgspec.json.encode(status))
        with contextlib.suppress(OSError):  # the sinks report it
            os.pwrite(self._file, text.ljust(files.STATUS_BYTES - 1) + b"\n", 0)
