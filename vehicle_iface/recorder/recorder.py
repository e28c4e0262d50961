"""Bus and telemetry into files, a few times in a tenth of a second; a slow disk makes it late, never the loop."""

import contextlib
import errno
import os
from collections.abc import Callable
from pathlib import Path

import msgspec

from vehicle_iface.recorder import files
from vehicle_iface.recorder.folder import Order, emptied, made, refused
from vehicle_iface.recorder.follower import Follower
from vehicle_iface.recorder.frames import FrameTap
from vehicle_iface.recorder.sink import Sink
from vehicle_iface.units import ns_from_s


class Recorder:
    """Records from its making to `close`. `ConfigError` or `BusError` when it cannot begin; nothing is left then."""

    def __init__(self, order: Order, say: Callable[[str], None]) -> None:
        self._follower = Follower(order.telemetry)
        self._tap = FrameTap(order.channel, say) if order.channel is not None else None
        folder = Path(order.folder)
        try:
            made(order, self._follower.info)
            self._file = os.open(folder / files.REPORT, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
            if os.pwrite(self._file, b" " * files.REPORT_BYTES, 0) < files.REPORT_BYTES:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self._sinks = {
                "snapshots": Sink(folder / files.SNAPSHOTS, say, files.SNAPSHOT_HEADER),
                "trajectories": Sink(folder / files.TRAJECTORIES, say),
                "counters": Sink(folder / files.COUNTERS, say),
            }
            if self._tap is not None:
                self._sinks["frames"] = Sink(folder / files.FRAMES, say)
        except OSError as error:
            emptied(folder)
            raise refused(folder, error) from error
        self._say = say
        self._said: dict[str, int] = {}
        self._report_ns = 0

    def step(self, now_ns: int) -> None:
        """Write down what has come since the last step."""
        news = self._follower.take(now_ns)
        if self._tap is not None:
            self._sinks["frames"].write(self._tap.take(now_ns), now_ns)
        self._sinks["snapshots"].write(news.snapshots, now_ns)
        self._sinks["trajectories"].write(news.trajectories, now_ns)
        self._sinks["counters"].write(news.counters, now_ns)
        if now_ns >= self._report_ns:
            self._report_ns = now_ns + ns_from_s(files.REPORT_S)
            self._save(self.report(now_ns))
            self._say_what_was_missed()

    def report(self, now_ns: int, *, is_over: bool = False) -> files.Report:
        """What was written and lost so far."""
        written = {name: sink.written for name, sink in sorted(self._sinks.items())}
        lost = {name: sink.lost for name, sink in sorted(self._sinks.items())}
        for name, count in self._missed().items():
            lost[name] += count
        trouble = next((sink.trouble for sink in self._sinks.values() if sink.trouble), "")
        return files.Report(at_ns=now_ns, is_over=is_over, written=written, lost=lost, trouble=trouble)

    def close(self, now_ns: int) -> files.Report:
        """Say in `recorder.json` that this is all."""
        report = self.report(now_ns, is_over=True)
        self._save(report)
        os.close(self._file)
        for sink in self._sinks.values():
            sink.close()
        if self._tap is not None:
            self._tap.close()
        self._follower.close()
        return report

    def _missed(self) -> dict[str, int]:
        """What was overwritten before it could be taken."""
        of_bus = {"frames": self._tap.lost} if self._tap is not None else {}
        return of_bus | {
            "snapshots": self._follower.snapshots_lost,
            "trajectories": self._follower.trajectories_lost,
        }

    def _say_what_was_missed(self) -> None:
        fresh = {name: count - self._said.get(name, 0) for name, count in self._missed().items()}
        if any(fresh.values()):
            self._said = self._missed()
            what = ", ".join(f"{count:,} {name}" for name, count in fresh.items() if count)
            self._say(f"too slow: {what} lost; the drive goes on")

    def _save(self, report: files.Report) -> None:
        text = msgspec.json.format(msgspec.json.encode(report))
        with contextlib.suppress(OSError):  # the sinks say so
            os.pwrite(self._file, text.ljust(files.REPORT_BYTES - 1) + b"\n", 0)
