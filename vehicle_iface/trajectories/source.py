"""The interface of the loop to its source of trajectories, and the source that gives one trajectory once."""

import copy
from typing import Protocol, runtime_checkable

import msgspec

from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory


class TrajectorySource(Protocol):
    """Gives the loop a new trajectory whenever one is due."""

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        """Return a new trajectory stamped `now_ns`, or None while the last one stays in force."""
        ...

    def restart(self) -> None:
        """Start over: the next call of `next` gives the first trajectory again, as at the instant of engagement."""
        ...


@runtime_checkable
class SupportsLaps(Protocol):
    """A source that knows where a lap ends."""

    @property
    def lap(self) -> int | None:
        """Number of the present lap of a closed route; None on an open one."""
        ...


class FixedTrajectory:
    """One trajectory, given once; its time 0 is the instant of the first call."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self._given = False

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:  # noqa: ARG002
        """Return the trajectory, stamped `now_ns`, on the first call; None on later ones."""
        if self._given:
            return None
        self._given = True
        return restamp(self.trajectory, now_ns)

    def restart(self) -> None:
        """Give the trajectory once more."""
        self._given = False


def restamp(trajectory: Trajectory, stamp_ns: int) -> Trajectory:
    """Return the same points at another time, without copying the arrays, which are locked and may be shared.

    A new `Trajectory` would check a million points again, in the loop's thread.
    """
    twin = copy.copy(trajectory)
    msgspec.structs.force_setattr(twin, "stamp_ns", stamp_ns)
    return twin
