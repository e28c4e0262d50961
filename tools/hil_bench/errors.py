"""What stops a case for a reason that is not the device's."""


class RigError(Exception):
    """The bench itself cannot continue."""


class UnexpectedNodeError(RigError):
    """Another node sends the vehicle's frames: a real vehicle may be there. The bench stops sending on this bus."""
