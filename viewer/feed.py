"""From the telemetry file to what the page shows: the newest of everything, with its age."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from vehicle_iface.runtime.telemetry import (
    DrawnTrajectory,
    SessionInfo,
    Snapshot,
    WriterState,
)
from vehicle_iface.units import NS_PER_S, s_from_ns
from viewer.recorder import RecorderState, RecorderWatch

STALE_AFTER_S = 0.5
"""Data older than this is shown as old."""
_DETAILS_PERIOD_NS = NS_PER_S // 2
_RATE_STEP_NS = NS_PER_S // 20
_RATE_POINTS = 32


class Source(Protocol):
    """A `TelemetryReader`, or what answers as one does."""

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
    def trajectory(self, version: int) -> DrawnTrajectory | None: ...
    def details(self) -> dict[str, Any]: ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """All that the page is drawn from, at one instant."""

    now_ns: int
    address: str
    link: WriterState
    problem: str = ""
    """Why the link is not live, in words."""
    session: int = 0
    info: SessionInfo | None = None
    snapshot: Snapshot | None = None
    """The newest, also when it is old."""
    trajectory: DrawnTrajectory | None = None
    """The one that the snapshot's indices belong to."""
    details: dict[str, Any] = field(default_factory=dict)
    sample_rate_hz: float = 0.0
    command_rate_hz: float = 0.0
    recorder: RecorderState | None = None
    """Of the process that writes this drive down; None: nobody does."""
    recording: str = ""
    """Of a recording: which part of it this is, in words. Empty: this is the present."""

    @property
    def data_age_s(self) -> float:
        """Since the loop last said anything."""
        return s_from_ns(self.now_ns - self.snapshot.published_ns) if self.snapshot else 0.0

    @property
    def state_age_s(self) -> float:
        """Of the vehicle's state, as old as it is now."""
        return s_from_ns(self.now_ns - self.snapshot.stamp_ns) if self.snapshot else 0.0

    @property
    def is_stale(self) -> bool:
        """Whether what is shown is not what is."""
        return self.snapshot is None or self.link is not WriterState.LIVE or self.data_age_s > STALE_AFTER_S


class Feed:
    """Reads the newest and forgets the rest; a new session starts it afresh."""

    def __init__(self, reader: Source) -> None:
        self._reader = reader
        self._session = 0
        self._snapshot: Snapshot | None = None
        self._trajectory: DrawnTrajectory | None = None
        self._details: dict[str, Any] = {}
        self._details_due_ns = 0
        self._recorder = RecorderWatch()
        self._counts: deque[tuple[int, int, int]] = deque(maxlen=_RATE_POINTS)

    def view(self, now_ns: int) -> View:
        """What is known at `now_ns`."""
        link = self._reader.poll()
        if self._reader.session != self._session:
            self._session = self._reader.session
            self._snapshot, self._trajectory, self._details_due_ns = None, None, 0
            self._counts.clear()
        self._snapshot = self._reader.newest() or self._snapshot
        self._follow_trajectory()
        if now_ns >= self._details_due_ns:
            self._details = self._reader.details() or self._details
            self._details_due_ns = now_ns + _DETAILS_PERIOD_NS
        snapshot = self._snapshot
        view = View(
            now_ns=max(now_ns, snapshot.published_ns) if snapshot else now_ns,  # it may have come since
            address=self._reader.address,
            link=link,
            problem=self._reader.problem,
            session=self._session,
            info=self._reader.info,
            recorder=self._recorder.state(self._reader.info.recording, now_ns) if self._reader.info else None,
            snapshot=snapshot,
            trajectory=self._trajectory,
            details=self._details,
        )
        return view if view.is_stale else self._with_rates(view)

    def _follow_trajectory(self) -> None:
        """Take up the trajectory that the snapshot speaks of, as soon as it can be read whole."""
        if self._snapshot is None:
            return
        wanted = self._snapshot.trajectory_version
        if wanted == 0:
            self._trajectory = None
        elif self._trajectory is None or self._trajectory.version != wanted:
            self._trajectory = self._reader.trajectory(wanted) or self._trajectory

    def _with_rates(self, view: View) -> View:
        snapshot = self._snapshot
        assert snapshot is not None
        if not self._counts or snapshot.published_ns - self._counts[-1][0] >= _RATE_STEP_NS:
            self._counts.append((snapshot.published_ns, snapshot.samples, snapshot.commands))
        (first_ns, samples, commands), (last_ns, newer_samples, newer_commands) = self._counts[0], self._counts[-1]
        span_s = s_from_ns(last_ns - first_ns)
        if span_s <= 0.0:
            return view
        return replace(
            view,
            sample_rate_hz=(newer_samples - samples) / span_s,
            command_rate_hz=(newer_commands - commands) / span_s,
        )
