"""Everything that this package raises on purpose.

VehicleIfaceError
├── InvalidValueError (ValueError)     a value that a data type refuses: name, value, what is allowed
│   └── SignalError                    the same for a CAN signal: message, signal, value, range
├── ConfigError                        a profile, DBC or option that does not fit: file, place, allowed
├── TrajectoryFileError                a CSV that cannot be read: file, line, column
├── FrameMismatchError                 state and trajectory are in different frames of reference
├── TrajectoryRejectedError            the controller refused a new trajectory; the old one stays in force
├── NoTrajectoryError                  asked for an index where there is no trajectory
└── BusError                           the bus cannot be used: channel, cause, mending command
    └── BusGoneError                   there is no such interface, or not any more

What a peer on the bus does wrong is data (a counted cause), never an exception.
"""


class VehicleIfaceError(Exception):
    """The root of all errors of this package."""


class InvalidValueError(VehicleIfaceError, ValueError):
    """A value is not finite, out of range or of the wrong shape."""


class SignalError(InvalidValueError):
    """A CAN signal's value cannot be on the wire."""


class ConfigError(VehicleIfaceError):
    """A profile, a DBC or an option does not fit."""


class TrajectoryFileError(VehicleIfaceError):
    """A trajectory file cannot be read."""


class FrameMismatchError(VehicleIfaceError):
    """State and trajectory are in different frames of reference."""


class TrajectoryRejectedError(VehicleIfaceError):
    """The controller refused a new trajectory."""


class NoTrajectoryError(VehicleIfaceError):
    """There is no trajectory to have an index in."""


class BusError(VehicleIfaceError):
    """The bus cannot be used."""


class BusGoneError(BusError):
    """There is no such interface, or not any more."""
