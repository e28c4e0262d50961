"""Frames of the program by the bus contract, which knows nothing of the program."""

from vehicle_bus_contract.reference import NAMES, REFERENCE, DecodedFrame, Frame

from vehicle_iface.frame import CanFrame


def pack(name: str, counter: int, **signals: float) -> CanFrame:
    """An intact frame of the reference vehicle's bus; signals that are not named are 0."""
    return CanFrame(*REFERENCE.pack(name, counter, **signals))


def unpack(frame: CanFrame) -> DecodedFrame:
    """The signals of a frame, intact or not."""
    return REFERENCE.unpack(frame.stamp_ns, NAMES[frame.can_id], frame.data)


def intact(frame: CanFrame) -> DecodedFrame | None:
    """The signals of a frame whose kind, length and checksum are right; None for any other."""
    kind = (frame.is_extended, frame.is_remote, frame.is_fd, frame.is_error)
    return REFERENCE.intact(Frame(frame.stamp_ns, frame.can_id, frame.data, *kind))
