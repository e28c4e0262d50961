"""The telemetry of one run as lines: every snapshot, trajectory and event, the counters twice a second."""

from dataclasses import dataclass, field

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder.files import format_counters, format_event, format_snapshot, format_trajectory
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryReader, WriterState
from vehicle_iface.units import NS_PER_S

COUNTERS_NS = NS_PER_S // 2


@dataclass(slots=True)
class NewLines:
    """Data published since the last call, as lines."""

    snapshots: list[bytes] = field(default_factory=list)
    trajectories: list[bytes] = field(default_factory=list)
    counters: list[bytes] = field(default_factory=list)
    events: list[bytes] = field(default_factory=list)


class TelemetryTap:
    """Reads the session that exists at the start, and no later one; `ConfigError` when there is none."""

    def __init__(self, address: str) -> None:
        self._reader = TelemetryReader(address)
        self._reader.poll()
        if self._reader.info is None:
            raise ConfigError(f"telemetry {address!r}: cannot be recorded: {self._reader.problem}")
        self.info: SessionInfo = self._reader.info
        self._session = self._reader.session
        self._sequence = 0
        self._version = 0
        self._counters_due_ns = 0
        self._event = 0
        self.snapshots_lost = 0
        """Number of snapshots overwritten before they were read."""
        self.events_lost = 0
        self.trajectories_lost = 0

    def read(self, now_ns: int) -> NewLines:
        """Return all lines since the last call."""
        lines = NewLines()
        self._reader.poll()
        if self._reader.session != self._session:
            return lines
        snapshots = self._reader.since(self._sequence)
        self.snapshots_lost = self._reader.dropped
        for snapshot in snapshots:
            self._add_trajectories(snapshot, lines)
            lines.snapshots.append(format_snapshot(snapshot))
            self._sequence = snapshot.sequence
        for event in self._reader.events(self._event):
            self.events_lost += event.number - self._event - 1
            self._event = event.number
            lines.events.append(format_event(event))
        if now_ns >= self._counters_due_ns:
            self._counters_due_ns = now_ns + COUNTERS_NS
            counters = self._reader.details()
            lines.counters = [format_counters(now_ns, counters)] if counters is not None else []
        return lines

    @property
    def is_loop_dead(self) -> bool:
        """Whether the loop ended without closing its telemetry."""
        return self._reader.writer_state is WriterState.DEAD

    def close(self) -> None:
        """Close the telemetry file."""
        self._reader.close()

    def _add_trajectories(self, snapshot: Snapshot, lines: NewLines) -> None:
        """Add the trajectories up to that of `snapshot`. Only the two newest can be read; older ones are lost."""
        for version in range(self._version + 1, snapshot.trajectory_version + 1):
            path = self._reader.trajectory(version)
            if path is None:
                self.trajectories_lost += 1
            else:
                lines.trajectories.append(format_trajectory(path))
            self._version = version
