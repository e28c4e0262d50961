"""The telemetry of one run as lines: every snapshot, every trajectory, the counters twice a second."""

from dataclasses import dataclass, field

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder.files import counters_line, snapshot_line, trajectory_line
from vehicle_iface.runtime.telemetry import SessionInfo, Snapshot, TelemetryReader
from vehicle_iface.units import NS_PER_S

COUNTERS_NS = NS_PER_S // 2


@dataclass(slots=True)
class News:
    """What has been published since the last look, as lines."""

    snapshots: list[bytes] = field(default_factory=list)
    trajectories: list[bytes] = field(default_factory=list)
    counters: list[bytes] = field(default_factory=list)


class Follower:
    """Follows the session that is there at the start, and none after it; `ConfigError` where there is none."""

    def __init__(self, address: str) -> None:
        self._reader = TelemetryReader(address)
        self._reader.poll()
        if self._reader.info is None:
            raise ConfigError(f"telemetry {address!r}: nothing to record there: {self._reader.problem}")
        self.info: SessionInfo = self._reader.info
        self._session = self._reader.session
        self._sequence = 0
        self._version = 0
        self._counters_ns = 0
        self.snapshots_lost = 0
        """Overwritten before we came."""
        self.trajectories_lost = 0

    def take(self, now_ns: int) -> News:
        """What is new."""
        news = News()
        self._reader.poll()
        if self._reader.session != self._session:
            return news
        snapshots = self._reader.since(self._sequence)
        self.snapshots_lost = self._reader.missed
        for snapshot in snapshots:
            self._follow_trajectory(snapshot, news)
            news.snapshots.append(snapshot_line(snapshot))
            self._sequence = snapshot.sequence
        if now_ns >= self._counters_ns:
            self._counters_ns = now_ns + COUNTERS_NS
            counters = self._reader.details()
            news.counters = [counters_line(now_ns, counters)] if counters else []
        return news

    def close(self) -> None:
        """Let go of the file."""
        self._reader.close()

    def _follow_trajectory(self, snapshot: Snapshot, news: News) -> None:
        """Only the two newest can be read; those before them are lost."""
        for version in range(self._version + 1, snapshot.trajectory_version + 1):
            path = self._reader.trajectory(version)
            if path is None:
                self.trajectories_lost += 1
            else:
                news.trajectories.append(trajectory_line(path))
            self._version = version
