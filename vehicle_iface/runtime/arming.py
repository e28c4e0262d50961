"""Requests to arm: engage, or engage again after a latched fault."""

import logging

from vehicle_iface.bus.link_state import OPEN, LinkState
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.modes import Event
from vehicle_iface.status import VehicleStatus
from vehicle_iface.units import NS_PER_S

log = logging.getLogger(__name__)

REFUSALS_NS = NS_PER_S
"""Rejected requests are logged this often at most."""


class ArmingRequests:
    """Applies at most one request per tick, and logs why a request was rejected."""

    def __init__(self, engagement: Engagement) -> None:
        self._engagement = engagement
        self._is_requested = False
        self._refusals, self._refused_ns = 0, 0
        self.applied = 0
        """Number of requests that were applied or rejected."""
        self.answers = 0
        """Number of requests that were applied, or rejected and logged."""
        self.answer = ""
        """What became of the newest of them."""

    def request(self) -> None:
        """Arm with the next tick. Safe in a signal handler."""
        self._is_requested = True

    def apply(self, now_ns: int, link: LinkState, status: VehicleStatus | None) -> bool:
        """Arm if that was requested; return whether a vehicle held at standstill drives on now."""
        if not self._is_requested:
            return False
        self._is_requested = False
        self.applied += 1
        if link not in OPEN:
            self._refuse(f"the link is {link.name}", now_ns)
        elif not self._engagement.apply(Event.ARMED, now_ns):
            self._refuse(self._engagement.refusal_to_arm(status), now_ns)
        else:
            self._answer("accepted")
            return self._engagement.mode.computes
        return False

    def _refuse(self, why: str, now_ns: int) -> None:
        """Log it, at most once a second: a flood of signals must not slow the process down."""
        if self._refusals and now_ns - self._refused_ns < REFUSALS_NS:
            self._refusals += 1
            return
        more = f" ({self._refusals - 1} more refusals since the last)" if self._refusals > 1 else ""
        log.warning("not armed: %s%s", why, more)
        self._answer(f"rejected: {why}")
        self._refusals, self._refused_ns = 1, now_ns

    def _answer(self, text: str) -> None:
        self.answers, self.answer = self.answers + 1, text
