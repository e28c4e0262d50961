"""The end of a run, on schedule or on request: the vehicle is stopped, then released, then the run ends."""

import logging

from vehicle_iface.reason import Reason
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.handover import Handover
from vehicle_iface.safety.modes import Event
from vehicle_iface.status import VehicleMode, VehicleStatus
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

RELEASE_NS = 200 * NS_PER_MS
"""How long ENABLE = 0 is repeated at the end for a vehicle that does not report its release."""


class Shutdown:
    """Requests to end, progress of the shutdown, and how the run ended. Reads no clock: methods get `now_ns`."""

    def __init__(self, engagement: Engagement, handover: Handover) -> None:
        self._engagement, self._handover = engagement, handover
        self._requests = 0
        self.applied = 0
        """Number of requests that were known when they were last applied."""
        self._is_due = False
        self.has_begun = False
        """Whether the shutdown has begun: on schedule, or on request."""
        self.is_released_at_once = False
        """Whether a second request released the vehicle."""
        self._released_ns: int | None = None
        self.is_done = False
        self.ended_in_fault = False

    def request(self) -> None:
        """Stop the vehicle and end; a second request releases it at once. Safe in a signal handler."""
        self._requests += 1

    def schedule(self, at_ns: int) -> None:
        """Announce that `begin_on_schedule` will be called at `at_ns`, so that the driver is warned before."""
        self._handover.plan(at_ns)

    def begin_on_schedule(self) -> None:
        """Begin a scheduled shutdown. It is no user request: one later SIGINT still means a normal stop."""
        self._is_due = True

    @property
    def cause(self) -> str:
        """What the shutdown was begun by."""
        return "by request" if self.applied else "on schedule"

    @property
    def must_release_now(self) -> bool:
        """Whether it was requested twice."""
        return self.applied > 1 and not self.is_done

    def may_hold_or_release(self, now_ns: int) -> bool:
        """Whether a vehicle at standstill may now be held or, at the end, released."""
        mode = self._engagement.mode
        return mode.stops and (not mode.ends or self._handover.may_release(now_ns))

    def begin_if_due(self, now_ns: int) -> None:
        """Begin the shutdown when it is due or was requested; it is done at once where nothing may be sent."""
        self.applied = self._requests  # a signal may add another one at any time
        if self.has_begun or not (self._is_due or self.applied):
            return
        self.has_begun = True
        self.ended_in_fault = self._engagement.ends_in_fault
        self._engagement.apply(Event.END, now_ns)
        self.is_done = not self._engagement.mode.may_send

    def warn_if_near(self, now_ns: int) -> None:
        """Log once that control is about to be released."""
        mode = self._engagement.mode
        if self._handover.update(now_ns, is_driven=mode.enables, is_ending=mode.ends):
            log.warning("HANDOVER: control is about to be released")

    def release_now(self, now_ns: int) -> bool:
        """End without waiting for standstill; return whether ENABLE = 0 must still be sent once."""
        self.is_done = self.is_released_at_once = True
        self._engagement.apply(Event.STANDSTILL, now_ns)
        return self._engagement.is_released

    def finish_if_released(self, now_ns: int, status: VehicleStatus | None) -> None:
        """Finish when the vehicle reports its release, ENABLE = 0 was sent long enough, or nothing may be sent."""
        engagement = self._engagement
        if not self.has_begun:
            return
        if not engagement.mode.may_send:
            self.ended_in_fault = self.ended_in_fault or engagement.ends_in_fault
            self.is_done = True
        elif engagement.is_released:
            self.ended_in_fault = self.ended_in_fault or engagement.reason is Reason.VEHICLE_FAULT
            if self._released_ns is None:
                self._released_ns = now_ns
            says_so = (
                status is not None and status.stamp_ns > self._released_ns and status.mode is not VehicleMode.AUTONOMOUS
            )
            self.is_done = self.is_done or says_so or now_ns - self._released_ns >= RELEASE_NS
