"""Reads the newest telemetry for the page, with its age."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Protocol

from vehicle_iface import clock
from vehicle_iface.telemetry import (
    DrawnTrajectory,
    SessionInfo,
    Snapshot,
    TelemetryReader,
    WriterState,
)
from vehicle_iface.telemetry.details import LiveDetails
from vehicle_iface.telemetry.events import LoopEvent
from vehicle_iface.units import NS_PER_S, ns_from_s, s_from_ns
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.recorder_monitor import RecorderHealth, RecorderMonitor

STALE_AFTER_S = 0.5
"""Older data is shown as stale."""
_DETAILS_PERIOD_NS = NS_PER_S // 2
_RATE_NS = 3 * NS_PER_S // 2
"""Rates are those of this time."""
LIVE_S, RECORDED_S = 740.0, 125.0
"""Snapshots of this time are kept for the plots: live ten minutes and the longest plot before them. A recording has all
others in its files."""
_MAX_EVENTS = 1000


class Source(Protocol):
    """A `LiveTelemetry`, or a `Playback`."""

    @property
    def address(self) -> str: ...
    @property
    def problem(self) -> str: ...
    @property
    def session(self) -> int: ...
    @property
    def info(self) -> SessionInfo | None: ...
    def poll(self) -> WriterState: ...
    def newest(self) -> Snapshot | None: ...
    def between(self, begin_ns: int, end_ns: int) -> list[Snapshot]: ...
    def trajectory(self, version: int) -> DrawnTrajectory | None: ...
    def details(self) -> LiveDetails | None: ...
    def events(self, after: int = 0) -> list[LoopEvent]: ...
    @property
    def wall_offset_ns(self) -> int: ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """All data of the page at one time."""

    now_ns: int
    address: str
    writer_state: WriterState
    problem: str = ""
    """Why the writer is not live, for the user."""
    session: int = 0
    info: SessionInfo | None = None
    snapshot: Snapshot | None = None
    """The newest one, even when it is stale."""
    trajectory: DrawnTrajectory | None = None
    """The one that the snapshot's indices refer to."""
    details: LiveDetails | None = None
    sample_rate_hz: float | None = None
    """None: not known (yet)."""
    command_rate_hz: float | None = None
    recorder: RecorderHealth | None = None
    """None: the drive is not recorded."""
    recording: str = ""
    """Of a playback: its description. Empty: this is a live drive."""

    @property
    def data_age_s(self) -> float:
        """Time since the loop last published."""
        return s_from_ns(self.now_ns - self.snapshot.published_ns) if self.snapshot else 0.0

    @property
    def state_age_s(self) -> float:
        """Age of the vehicle's state."""
        return s_from_ns(self.now_ns - self.snapshot.stamp_ns) if self.snapshot else 0.0

    @property
    def is_stale(self) -> bool:
        """Whether the page does not show the present."""
        return self.snapshot is None or self.writer_state is not WriterState.LIVE or self.data_age_s > STALE_AFTER_S


class LiveTelemetry(TelemetryReader):
    """A reader that has each snapshot once."""

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self.wall_offset_ns = clock.wall_ns() - clock.monotonic_ns()
        """What to add to a time of the monotonic clock to get that of the wall clock, when the viewer was started."""
        self._read_of = (0, 0)
        """Session and number of the newest one."""

    def between(self, _begin_ns: int, _end_ns: int) -> list[Snapshot]:
        """Return the snapshots since the last call: those of the last seconds at the first one of a session."""
        session, sequence = self._read_of
        found = self.since(sequence if session == self.session else 0)
        if found:
            self._read_of = (self.session, found[-1].sequence)
        return found


class Feed:
    """Reads the newest data; a new session resets it."""

    def __init__(self, reader: Source, kept_s: float = LIVE_S) -> None:
        """`kept_s`: for how many seconds snapshots are kept."""
        self.recent = RecentSnapshots(length_s=kept_s)
        self.events: deque[LoopEvent] = deque(maxlen=_MAX_EVENTS)
        """The newest ones of the session, the oldest first."""
        self._kept_ns = ns_from_s(kept_s)
        self._reader = reader
        self._session = 0
        self._snapshot: Snapshot | None = None
        self._trajectory: DrawnTrajectory | None = None
        self._details: LiveDetails | None = None
        self._details_due_ns = 0
        self._recorder = RecorderMonitor()

    @property
    def wall_offset_ns(self) -> int:
        """What to add to a time of the monotonic clock to get that of the wall clock."""
        return self._reader.wall_offset_ns

    def read(self, now_ns: int) -> View:
        """Read the telemetry; the data of the page at `now_ns`."""
        writer_state = self._reader.poll()
        if self._reader.session != self._session:
            self._session = self._reader.session
            self._snapshot, self._trajectory, self._details_due_ns = None, None, 0
            self.recent.clear()
            self.events.clear()
        self.recent.extend(self._reader.between(self.recent.newest_ns or now_ns - self._kept_ns, now_ns))
        self._snapshot = self._reader.newest() or self._snapshot
        self._follow_trajectory()
        if now_ns >= self._details_due_ns:
            self._details = self._reader.details() or self._details
            self.events += self._reader.events(self.events[-1].number if self.events else 0)
            self._details_due_ns = now_ns + _DETAILS_PERIOD_NS
        snapshot = self._snapshot
        view = View(
            now_ns=max(now_ns, snapshot.published_ns) if snapshot else now_ns,  # published since now_ns
            address=self._reader.address,
            writer_state=writer_state,
            problem=self._reader.problem,
            session=self._session,
            info=self._reader.info,
            recorder=self._recorder.check(self._reader.info.recording, now_ns) if self._reader.info else None,
            snapshot=snapshot,
            trajectory=self._trajectory,
            details=self._details,
        )
        return view if view.is_stale else self._with_rates(view)

    def _follow_trajectory(self) -> None:
        """Read the trajectory that the snapshot refers to, as soon as it is intact."""
        if self._snapshot is None:
            return
        version = self._snapshot.trajectory_version
        if version == 0:
            self._trajectory = None
        elif self._trajectory is None or self._trajectory.version != version:
            self._trajectory = self._reader.trajectory(version) or self._trajectory

    def _with_rates(self, view: View) -> View:
        rows = self.recent.between(self.recent.newest_ns - _RATE_NS, self.recent.newest_ns)
        if len(rows) < 2:
            return view
        first, last = rows[0], rows[-1]
        span_s = s_from_ns(int(last["published_ns"] - first["published_ns"]))
        return replace(
            view,
            sample_rate_hz=(int(last["samples"]) - int(first["samples"])) / span_s,
            command_rate_hz=(int(last["commands"]) - int(first["commands"])) / span_s,
        )
