"""Finds the events of a run: once a tick it compares what the parts of the loop say with what they said before."""

from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import NamedTuple

from vehicle_iface.codec.decoder import DropCause
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.activity import Activity, Change, Name
from vehicle_iface.runtime.arming import ArmingRequests
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import ControlCycle
from vehicle_iface.runtime.event_log import EventLog
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.shutdown import Shutdown
from vehicle_iface.runtime.trajectory_updates import TrajectoryUpdater
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.telemetry.details import LimitSummary, StopSummary
from vehicle_iface.telemetry.events import EventKind, Phase
from vehicle_iface.units import NS_PER_MS, NS_PER_S, s_from_ns

MAX_STOPS = 1000
COUNT_NS = 50 * NS_PER_MS
"""Period of comparing the counts."""
AGAIN_NS = NS_PER_S
"""A trajectory that follows another one sooner is no event; nor is one that is rejected sooner for the same reason."""
FAULTS = (
    "commands_refused",
    "frames_not_sent",
    "messages_not_encoded",
    "foreign_commands",
    "controller_errors",
    "controller_too_slow",
    "samples_held_up",
)
"""The counters whose rise is a fault."""
_MISSES = "deadline_misses"
_read_faults = attrgetter(_MISSES, *FAULTS)


class _Cause(NamedTuple):
    """Why the loop does not drive a vehicle that it drove before."""

    reason: Reason
    reaction: str


class EventWatch:
    """Adds events to a log. A call without an event takes a few microseconds."""

    def __init__(
        self,
        log: EventLog,
        *,
        engagement: Engagement,
        cycle: ControlCycle,
        link: Link,
        counters: Counters,
        arming: ArmingRequests,
        shutdown: Shutdown,
        trajectories: TrajectoryUpdater,
        limited: Mapping[str, int],
        causes: Mapping[str, Callable[[], Mapping[str, int]]],
        drops: Callable[[], Mapping[tuple[DropCause, str], int]],
        decided_ns: Callable[[], int],
    ) -> None:
        """`limited` are the commands that the gate changed, by limit; `causes` the counts of faults by cause, each
        group with the word in front of its names; `drops` those of frames. `decided_ns` is the time of the newest
        command."""
        self.log = log
        self._engagement, self._cycle, self._link, self._counters = engagement, cycle, link, counters
        self._arming, self._shutdown, self._trajectories = arming, shutdown, trajectories
        self._decided_ns = decided_ns
        self._limits = Activity(lambda: limited)
        self._faults = {word: Activity(read) for word, read in causes.items()}
        self._counted = Activity(self._read_counts)
        self._dropped = Activity(drops)
        self._mode, self._reason = engagement.mode, cycle.reason
        self._modes = self._links = self._requests = self._accepted = self._rejected = 0
        self._accepted_ns = self._rejected_ns = -AGAIN_NS
        self._rejection = ""
        self._ended = self._released = False
        self._cause: _Cause | None = None
        self._cause_ns = self._count_due_ns = 0
        self._cause_mode = engagement.mode
        self._is_latched = False
        self._stops: list[tuple[int, int, _Cause, bool]] = []
        self._acted: dict[str, LimitSummary] = {}

    def poll(self, now_ns: int) -> None:
        """Add what has happened since the last call."""
        if self._requests != self._arming.answers or self._shutdown.has_begun is not self._ended:
            self._note_requests(now_ns)
        if self._shutdown.is_released_at_once is not self._released:
            self._released = True
            self.log.add(now_ns, EventKind.REQUEST, "release at once")
        if len(self._engagement.transitions) > self._modes or self._engagement.mode is not self._mode:
            self._note_modes(now_ns)
        if len(self._link.transitions) > self._links:
            self._note_links()
        if self._cycle.reason is not self._reason or self._engagement.mode is not self._cause_mode:
            self._note_cause(now_ns)
        counters = self._counters
        if counters.trajectories != self._accepted or counters.trajectories_rejected != self._rejected:
            self._note_trajectories(now_ns)
        if now_ns >= self._count_due_ns:
            self._count_due_ns = now_ns + COUNT_NS
            self._note_counts(now_ns)

    def stops(self, started_ns: int, now_ns: int) -> list[StopSummary]:
        """Return the first stops of the run, in seconds since `started_ns`; one that lasts as if it ended now."""
        stops = list(self._stops)
        if self._cause is not None and len(stops) < MAX_STOPS:
            stops.append((self._cause_ns, now_ns - self._cause_ns, self._cause, self._is_latched))
        return [
            StopSummary(
                at_s=s_from_ns(at_ns - started_ns),
                reason=cause.reason.name,
                reaction=cause.reaction,
                duration_s=s_from_ns(duration_ns),
                latched=latched,
            )
            for at_ns, duration_ns, cause, latched in stops
        ]

    def limits(self) -> dict[str, LimitSummary]:
        """Return the limits that acted, by name."""
        acted = dict(self._acted)
        for change in self._limits.lasting:
            acted[change.name] = _add(acted.get(change.name, _NONE), change)
        return acted

    def _note_counts(self, now_ns: int) -> None:
        for change in self._limits.poll(now_ns):
            self._note_limit(change)
        for change in self._counted.poll(now_ns):
            kind = EventKind.DEADLINE if change.name == _MISSES else EventKind.FAULT
            self._note_change(kind, change.name, change)
        for drop in self._dropped.poll(now_ns):
            cause, message = drop.name
            self._note_change(EventKind.FAULT, f"dropped: {cause.value} {message}".strip(), drop)
        for word, faults in self._faults.items():
            for change in faults.poll(now_ns):
                self._note_change(EventKind.FAULT, f"{word}: {change.name}", change)

    def _read_counts(self) -> dict[str, int]:
        return dict(zip((_MISSES, *FAULTS), _read_faults(self._counters), strict=True))

    def _note_requests(self, now_ns: int) -> None:
        if self._requests != self._arming.answers:
            self._requests = self._arming.answers
            self.log.add(now_ns, EventKind.REQUEST, "arm", text=self._arming.answer)
        if self._shutdown.has_begun is not self._ended:
            self._ended = True
            self.log.add(now_ns, EventKind.REQUEST, "end", text=self._shutdown.cause)

    def _note_modes(self, now_ns: int) -> None:
        engagement = self._engagement
        fresh = engagement.transitions[self._modes :]
        self._modes += len(fresh)
        for at_ns, mode, reason in fresh:
            self.log.add(at_ns, EventKind.MODE, mode.name, text=reason.name)
        if not fresh:  # the list of transitions is full
            self.log.add(now_ns, EventKind.MODE, engagement.mode.name, text=engagement.reason.name)
        self._mode = engagement.mode

    def _note_links(self) -> None:
        fresh = self._link.transitions[self._links :]
        self._links += len(fresh)
        for at_ns, state, why in fresh:
            self.log.add(at_ns, EventKind.LINK, state.name, text=why)

    def _note_cause(self, now_ns: int) -> None:
        """Add a stop that began or ended, or another reason of the commands."""
        reason, cause = self._cycle.reason, self._find_cause()
        if cause != self._cause:
            at_ns = min(self._decided_ns(), now_ns) if self._engagement.mode.enables else now_ns
            self._end_stop(at_ns)
            self._cause, self._cause_ns, self._is_latched = cause, at_ns, False
            if cause is not None:
                self.log.add(at_ns, EventKind.STOP, cause.reason.name, phase=Phase.BEGAN, text=cause.reaction)
        elif reason is not self._reason:
            self.log.add(now_ns, EventKind.REASON, reason.name)
        self._reason, self._cause_mode = reason, self._engagement.mode
        self._is_latched = self._is_latched or (cause is not None and bool(self._engagement.mode.latched))

    def _find_cause(self) -> _Cause | None:
        engagement = self._engagement
        mode = engagement.mode
        if mode.enables:
            reason = self._cycle.reason  # NOT_ENGAGED: there was no command since the loop engaged
            return None if reason in (Reason.NOMINAL, Reason.NOT_ENGAGED) else _Cause(reason, "stopped")
        has_driven = self._cause is not None or self._reason is Reason.NOMINAL
        if not has_driven or engagement.is_released or not (mode.disengaged or mode.latched):
            return None
        return _Cause(engagement.reason, "released" if mode.may_send else "silent")

    def _end_stop(self, at_ns: int) -> None:
        cause = self._cause
        if cause is None:
            return
        duration_ns = at_ns - self._cause_ns
        text = f"after {s_from_ns(duration_ns):.2f} s"
        self.log.add(at_ns, EventKind.STOP, cause.reason.name, phase=Phase.ENDED, text=text)
        if len(self._stops) < MAX_STOPS:
            self._stops.append((self._cause_ns, duration_ns, cause, self._is_latched))

    def _note_trajectories(self, now_ns: int) -> None:
        counters, trajectories = self._counters, self._trajectories
        if counters.trajectories != self._accepted:
            self._accepted = counters.trajectories
            if now_ns - self._accepted_ns > AGAIN_NS:
                self.log.add(now_ns, EventKind.TRAJECTORY, "accepted", text=f"{trajectories.points} points")
            self._accepted_ns = now_ns
        if counters.trajectories_rejected != self._rejected:
            self._rejected = counters.trajectories_rejected
            if trajectories.rejection != self._rejection or now_ns - self._rejected_ns > AGAIN_NS:
                self.log.add(now_ns, EventKind.TRAJECTORY, "rejected", text=trajectories.rejection)
            self._rejection, self._rejected_ns = trajectories.rejection, now_ns

    def _note_limit(self, change: Change[str]) -> None:
        self._note_change(EventKind.LIMIT, change.name, change)
        if change.phase is Phase.ENDED:
            self._acted[change.name] = _add(self._acted.get(change.name, _NONE), change)

    def _note_change(self, kind: EventKind, name: str, change: Change[Name]) -> None:
        ended = change.phase is Phase.ENDED
        text = f"{change.count} in {s_from_ns(change.duration_ns):.2f} s" if ended else ""
        self.log.add(change.at_ns, kind, name, phase=change.phase, text=text)


_NONE = LimitSummary(commands=0, times=0, duration_s=0.0)


def _add(before: LimitSummary, change: Change[str]) -> LimitSummary:
    return LimitSummary(
        commands=before.commands + change.count,
        times=before.times + 1,
        duration_s=before.duration_s + s_from_ns(change.duration_ns),
    )
