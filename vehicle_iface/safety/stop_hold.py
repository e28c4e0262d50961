"""How long a stop goes on: until its cause has been away for a while, and for good where causes come and go.

A cause that is away for one sample in two would otherwise brake for half of the time, and that is hardly at all.
"""

from collections import deque

from vehicle_iface.profile import Recovery
from vehicle_iface.reason import Reason
from vehicle_iface.units import ns_from_s

_BY_TRAJECTORY = frozenset(
    {Reason.NO_TRAJECTORY, Reason.EMPTY_TRAJECTORY, Reason.PAST_END_SPACE, Reason.PAST_END_TIME, Reason.DEVIATION}
)
SLOW_MPS = 1.0
"""A slower vehicle arrives and drives off as its trajectories say: stops by these are not counted."""
_SHUTDOWN = Reason.SHUTDOWN  # enumerations are slow to read


class StopHold:
    """Holds each stop until it may end, and counts the stops of a moving vehicle.

    Time is given. A cause is the reason of a stop; `Reason.SHUTDOWN` is an order and neither held nor counted.
    """

    def __init__(self, recovery: Recovery) -> None:
        trajectory_ns = ns_from_s(recovery.trajectory_s)
        self._hold_ns = {
            **dict.fromkeys(_BY_TRAJECTORY, trajectory_ns),
            Reason.STATE_INVALID: ns_from_s(recovery.state_invalid_s),
            Reason.STATE_STALE: ns_from_s(recovery.state_stale_s),
            Reason.FRAME_MISMATCH: ns_from_s(recovery.frame_mismatch_s),
            Reason.CONTROLLER_ERROR: ns_from_s(recovery.controller_error_s),
            Reason.DEADLINE_MISSED: ns_from_s(recovery.deadline_missed_s),
            Reason.LINK_DOWN: ns_from_s(recovery.link_down_s),
        }
        self._latch_window_ns = ns_from_s(recovery.latch_window_s)
        self._begins_ns: deque[int] = deque(maxlen=recovery.latch_stops)
        self.reset()

    def reset(self) -> None:
        """Clear held and counted stops, as when the vehicle is engaged."""
        self._held: Reason | None = None
        self._seen_ns: int  # set with each cause
        self._begins_ns.clear()

    def update(self, cause: Reason | None, now_ns: int, speed_mps: float) -> Reason | None:
        """Why to stop now: for `cause`, or for an earlier one that is not over; None to drive.

        `speed_mps` is the vehicle's, of either sign.
        """
        if cause is _SHUTDOWN:
            return cause
        if cause is not None:
            if self._held is None and (cause not in _BY_TRAJECTORY or abs(speed_mps) > SLOW_MPS):
                self._begins_ns.append(now_ns)
            self._held, self._seen_ns = cause, now_ns
        elif self._held is not None and now_ns - self._seen_ns >= self._hold_ns.get(self._held, 0):
            self._held = None
        return self._held

    @property
    def must_latch(self) -> bool:
        """Whether so many stops began within the window that the vehicle must not be driven on by itself."""
        begins_ns = self._begins_ns
        return len(begins_ns) == begins_ns.maxlen and begins_ns[-1] - begins_ns[0] <= self._latch_window_ns
