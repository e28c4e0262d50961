"""Passes new trajectories from the source to the controller."""

import logging

from vehicle_iface.control.base import ControllerBase
from vehicle_iface.errors import TrajectoryRejectedError
from vehicle_iface.profile import Limits
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.safety.feasibility import find_violation
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectories.cleaning import find_backward_step
from vehicle_iface.trajectories.source import SupportsLaps, TrajectorySource
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S, s_from_ns

FUTURE_NS = 10 * NS_PER_S
"""A trajectory may begin a little later; one that begins later than this was stamped by another clock."""

log = logging.getLogger(__name__)


class TrajectoryUpdater:
    """Asks the source once per sample; a trajectory that is rejected leaves the old one in force."""

    def __init__(
        self,
        source: TrajectorySource,
        controller: ControllerBase,
        counters: Counters,
        *,
        limits: Limits,
        wheelbase_m: float,
    ) -> None:
        """Trajectories beyond `limits` or with a backward step are rejected before the controller gets them."""
        self._source, self._controller, self._counters = source, controller, counters
        self._limits, self._wheelbase_m = limits, wheelbase_m
        self._feasible: FloatArray | None = None
        self._has_raised = False
        self._laps = source if isinstance(source, SupportsLaps) else None
        self.rejection = ""
        """Why the newest trajectory that was rejected was."""

    @property
    def points(self) -> int:
        """Number of points of the trajectory in force."""
        trajectory = self._controller.trajectory
        return 0 if trajectory is None else len(trajectory)

    @property
    def lap(self) -> int | None:
        """Number of the lap where the source drives a closed route; otherwise None."""
        return None if self._laps is None else self._laps.lap

    def poll(self, now_ns: int, state: VehicleState, *, restart: bool) -> bool:
        """Pass on a new trajectory; return whether the controller took one. `restart` restarts the source now."""
        try:
            if restart:
                self._source.restart()
            trajectory = self._source.next(now_ns, state)
            if trajectory is None:
                return False
            if trajectory.stamp_ns - now_ns > FUTURE_NS:
                raise TrajectoryRejectedError(
                    f"stamp_ns {trajectory.stamp_ns} is {s_from_ns(trajectory.stamp_ns - now_ns):.3g} s ahead of "
                    f"time.monotonic_ns() ({now_ns}), more than {s_from_ns(FUTURE_NS):.0f} s: another clock's?"
                )
            # The same points at another time, as at engagement, are not looked at again: arrays are locked.
            if trajectory.x_m is not self._feasible:
                text = find_violation(trajectory, self._limits, self._wheelbase_m)
                if text:
                    raise TrajectoryRejectedError(text)
                step = find_backward_step(trajectory)
                if step is not None:
                    raise TrajectoryRejectedError(
                        f"{step}, where a vehicle that drives on would never pass it: "
                        "vehicle_iface.trajectories.drop_backward_steps takes recording noise out"
                    )
                self._feasible = trajectory.x_m
            self._controller.set_trajectory(trajectory)
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
        self._counters.trajectories += 1
        return True
