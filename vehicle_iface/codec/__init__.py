"""Bytes to numbers with units and back: the one room where the layout of a message is known."""

from vehicle_iface.codec.compiled import MessageCodec

__all__ = ["MessageCodec"]
