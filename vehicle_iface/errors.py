"""The errors of this package, as one tree.

VehicleIfaceError
├── InvalidValueError (ValueError)     a value that a data type rejects: name, value, what is allowed
│   ├── SignalError                    the same for a CAN signal: message, signal, value, range
│   └── BackwardStepError              a path that steps backwards: point, distance, what is allowed
├── ConfigError                        a profile, DBC or option that does not fit: file, place, allowed
├── TrajectoryFileError                a CSV that cannot be read: file, line, column
├── FrameMismatchError                 state and trajectory are in different frames of reference
├── TrajectoryRejectedError            the controller rejected a new trajectory; the old one stays in force
├── NoTrajectoryError                  an index was read without a trajectory
└── BusError                           the bus cannot be used: channel, cause, the command that fixes it
    └── BusGoneError                   the interface does not exist (any more)

A protocol violation by another node is data (a counted cause), never an exception.
"""


class VehicleIfaceError(Exception):
    """Base class of all errors of this package."""


class InvalidValueError(VehicleIfaceError, ValueError):
    """A value is not finite, out of range or of the wrong shape."""


class SignalError(InvalidValueError):
    """A value cannot be encoded into its CAN signal."""


class BackwardStepError(InvalidValueError):
    """A trajectory has a point behind the one before it, too far for measurement noise."""

    def __init__(self, text: str, *, point: int) -> None:
        super().__init__(text)
        self.point = point
        """Index of that point, counted from 0."""


class ConfigError(VehicleIfaceError):
    """A profile, a DBC or an option does not fit."""


class TrajectoryFileError(VehicleIfaceError):
    """A trajectory file cannot be read."""


class FrameMismatchError(VehicleIfaceError):
    """State and trajectory are in different frames of reference."""


class TrajectoryRejectedError(VehicleIfaceError):
    """The controller rejected a new trajectory."""


class NoTrajectoryError(VehicleIfaceError):
    """There is no trajectory, so there is no index."""


class BusError(VehicleIfaceError):
    """The bus cannot be used."""


class BusGoneError(BusError):
    """The interface does not exist, or no longer exists."""
