"""The newest value of every bound signal in one row, and what state and status are of it.

The codec compiles a profile's fields, forms and conditions to the two functions here, once at the start.
"""

from collections.abc import Callable, Mapping

from vehicle_iface.pose import Located, PoseInputs
from vehicle_iface.state import VehicleState
from vehicle_iface.status import VehicleStatus
from vehicle_iface.value import Value

Row = list[float | int | None]
"""In the fields' units; None where the sender has no value."""


Locate = Callable[[int, bool, PoseInputs], Located]
"""Stamp, whether the vehicle calls its pose valid, and what the pose is computed from: the pose."""


class MeasuredState(Value, frozen=True, gc=False):
    """A state, and what the vehicle says about its pose."""

    state: VehicleState
    pose_valid: bool


class RowReader(Value, frozen=True, kw_only=True):
    """Which values of a row are whose, and what they mean."""

    empty: tuple[int | None, ...]
    """The row before anything was received: 0 for fields of the state in whole messages, None for all else."""
    places: Mapping[str, slice]
    """Where the values of a message stand, by its name."""
    status_messages: frozenset[str]
    """The messages that the vehicle's mode is read from."""
    driver_messages: frozenset[str]
    """Those, and the messages with anything else of the status."""
    needed: Mapping[str, frozenset[int]]
    """Places of the values without which a message does not count as received: fields of the state, and of the status
    all but the gear."""
    multiplexed: frozenset[str]
    """Messages of which a frame has only some of the values; the others stay as they are."""
    read_state: Callable[[int, Row, Locate], MeasuredState | None]
    """The state with that stamp; None where a value is missing. A local position without a mount is not located."""
    read_status: Callable[[int, Row], VehicleStatus]
    """The status with that stamp."""
    omissible: tuple[int, ...] = ()
    """Those of `needed` for the status that the sender may leave out; without one of them there is no new status."""
