"""Bytes to numbers with units and back: the one package that knows the layout of a message."""

from vehicle_iface.codec import cantools_parser  # before whatever imports cantools

# isort: split
from vehicle_iface.codec.compiled import MessageCodec

__all__ = ["MessageCodec", "cantools_parser"]
