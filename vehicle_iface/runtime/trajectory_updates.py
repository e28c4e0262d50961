"""Passes new trajectories from the source to the controller, each after a complete check.

A trajectory of at most `AT_ONCE` points is checked in the pass in which it comes. A longer one is checked in pieces,
for `SHARE_NS` a pass. Until then the old trajectory stays in force. After a restart there is none: the vehicle stops.
"""

import logging
from collections.abc import Callable, Generator, Iterator

import msgspec

from vehicle_iface.control.base import ControllerBase
from vehicle_iface.errors import TrajectoryRejectedError
from vehicle_iface.pieces import finish
from vehicle_iface.profile import Limits
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.safety.feasibility import find_violation_in_pieces
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectories.cleaning import find_backward_step_in_pieces
from vehicle_iface.trajectories.source import FixedTrajectory, SupportsLaps, TrajectorySource, restamp
from vehicle_iface.trajectory import FloatArray, Trajectory
from vehicle_iface.units import NS_PER_MS, NS_PER_S, s_from_ns

FUTURE_NS = 10 * NS_PER_S
"""A trajectory may begin a little later; one that begins later than this was stamped by another clock."""
AT_ONCE = 256
"""Points that are checked within one pass: some 0.4 ms."""
AT_ONCE_AT_RESTART = 1024
"""The same for the trajectory after a restart, which the vehicle would have to be stopped for: up to 1 ms."""
SHARE_NS = NS_PER_MS // 4
"""Time in a pass after which no further piece of a check is begun; a piece takes up to 0.4 ms."""
PAUSE_NS = 2 * NS_PER_MS
"""Least time between two passes with such pieces: a loop of 1 kHz checks in every second or third pass."""
LOGGED_NS = NS_PER_S // 2
"""A check that takes longer than this is logged."""

log = logging.getLogger(__name__)


class _Admission(msgspec.Struct):
    """The check of one trajectory."""

    trajectory: Trajectory
    begun_ns: int
    pieces: Iterator[None]
    is_stamped_now: bool
    """Whether its time 0 is the instant at which the source gave it, and so that at which it comes into force."""
    is_logged: bool = False


class TrajectoryUpdater:
    """Asks the source once per sample; a trajectory that is rejected leaves the old one in force.

    A trajectory that comes during the check of another one waits, and replaces one that waits already. One that can be
    passed on at once, such as an empty one, ends the check instead: it is newer.
    """

    def __init__(
        self,
        source: TrajectorySource,
        controller: ControllerBase,
        counters: Counters,
        *,
        deviation: DeviationMonitor,
        limits: Limits,
        wheelbase_m: float,
        now_ns: Callable[[], int],
    ) -> None:
        """Trajectories beyond `limits` or with a backward step are rejected before the controller gets them.

        A `FixedTrajectory` is checked here, before the first pass.
        """
        self._source, self._controller, self._counters = source, controller, counters
        self._deviation, self._limits, self._wheelbase_m, self._now_ns = deviation, limits, wheelbase_m, now_ns
        self._checked: FloatArray | None = None
        """The locked array `x_m` of the last trajectory that passed the check."""
        self._admission: _Admission | None = None
        self._waiting: _Admission | None = None
        self._worked_ns = -PAUSE_NS
        self._has_raised = False
        self._laps = source if isinstance(source, SupportsLaps) else None
        self.rejection = ""
        """Why the newest trajectory that was rejected was."""
        if isinstance(source, FixedTrajectory):
            try:
                finish(self._admit(source.trajectory))
            except Exception:  # the first pass meets it again, where it is counted and logged
                log.debug("the trajectory was not accepted before the start", exc_info=True)

    @property
    def points(self) -> int:
        """Number of points of the trajectory in force."""
        trajectory = self._controller.trajectory
        return 0 if trajectory is None else len(trajectory)

    @property
    def lap(self) -> int | None:
        """Number of the lap where the source drives a closed route; otherwise None."""
        return None if self._laps is None else self._laps.lap

    @property
    def points_in_check(self) -> int | None:
        """Number of points of the trajectory that is being checked; None when there is none."""
        return None if self._admission is None else len(self._admission.trajectory)

    def poll(self, now_ns: int, state: VehicleState, *, restart: bool) -> bool:
        """Pass on a new trajectory, or go on with its check; return whether the controller has another one now.

        `restart` restarts the source now.
        """
        try:
            if restart:
                self._source.restart()
            trajectory = self._source.next(now_ns, state)
            if trajectory is not None:
                return self._receive(trajectory, now_ns, restart=restart)
            return not restart and self._go_on(now_ns)
        except TrajectoryRejectedError as error:
            self._counters.trajectories_rejected += 1
            self.rejection = str(error)
            log.warning("trajectory rejected, the old one stays in force: %s", error)
            return False
        except KeyboardInterrupt:
            raise
        except BaseException:  # source and controller are the user's code: they may raise anything
            self._counters.trajectories_rejected += 1
            self.rejection = "source or controller raised an exception, see the log"
            if not self._has_raised:
                self._has_raised = True
                log.exception("no new trajectory; the old one stays in force (further ones are counted)")
            return False

    def _receive(self, trajectory: Trajectory, now_ns: int, *, restart: bool) -> bool:
        if trajectory.stamp_ns - now_ns > FUTURE_NS:
            raise TrajectoryRejectedError(
                f"stamp_ns {trajectory.stamp_ns} is {s_from_ns(trajectory.stamp_ns - now_ns):.3g} s ahead of "
                f"time.monotonic_ns() ({now_ns}), more than {s_from_ns(FUTURE_NS):.0f} s: another clock's?"
            )
        # The same points at another time, as at engagement, are not looked at again: arrays are locked.
        is_checked = trajectory.x_m is self._checked
        if is_checked or len(trajectory) <= (AT_ONCE_AT_RESTART if restart else AT_ONCE):
            self._admission = self._waiting = None
            if not is_checked:
                finish(self._admit(trajectory))
            self._pass_on(trajectory)
            return True
        admission = _Admission(trajectory, now_ns, self._admit(trajectory), trajectory.stamp_ns == now_ns)
        if restart:
            self._admission, self._waiting = admission, None
            self._controller.clear_trajectory()
            return True
        self._waiting = admission
        return self._go_on(now_ns)

    def _go_on(self, now_ns: int) -> bool:
        """Check for a share of the pass; return whether a trajectory was passed on."""
        if now_ns - self._worked_ns < PAUSE_NS:
            return False
        if self._admission is None:
            self._admission, self._waiting = self._waiting, None
        admission = self._admission
        if admission is None:
            return False
        self._worked_ns = now_ns
        self._admission = None  # what raises is not gone on with
        end_ns = self._now_ns() + SHARE_NS
        for _ in admission.pieces:
            if self._now_ns() >= end_ns:
                self._admission = admission
                self._log_if_long(admission, now_ns)
                return False
        trajectory = admission.trajectory
        self._pass_on(restamp(trajectory, now_ns) if admission.is_stamped_now else trajectory)
        if admission.is_logged:
            took_s = s_from_ns(now_ns - admission.begun_ns)
            log.info("the trajectory of %d points is in force: its check took %.1f s", len(trajectory), took_s)
        return True

    def _log_if_long(self, admission: _Admission, now_ns: int) -> None:
        if not admission.is_logged and now_ns - admission.begun_ns > LOGGED_NS:
            admission.is_logged = True
            log.info("a trajectory of %d points is being checked; it is not driven yet", len(admission.trajectory))

    def _admit(self, trajectory: Trajectory) -> Generator[None]:
        """Check the trajectory and prepare for it, in pieces. Raises `TrajectoryRejectedError`."""
        text = yield from find_violation_in_pieces(trajectory, self._limits, self._wheelbase_m)
        if text:
            raise TrajectoryRejectedError(text)
        step = yield from find_backward_step_in_pieces(trajectory)
        if step is not None:
            raise TrajectoryRejectedError(
                f"{step}, where a vehicle that drives on would never pass it: "
                "vehicle_iface.trajectories.drop_backward_steps takes recording noise out"
            )
        if len(trajectory) > AT_ONCE:
            yield from self._deviation.prepare(trajectory)
        yield from self._controller.prepare_new_trajectory(trajectory)
        self._checked = trajectory.x_m

    def _pass_on(self, trajectory: Trajectory) -> None:
        self._controller.set_trajectory(trajectory)
        self._counters.trajectories += 1
