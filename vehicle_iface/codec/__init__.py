"""Bytes to numbers with units and back: the one room where the layout of a message is known."""

from vehicle_iface.codec import cantools_parser  # before whatever imports cantools

# isort: split
from vehicle_iface.codec.compiled import MessageCodec

__all__ = ["MessageCodec", "cantools_parser"]
