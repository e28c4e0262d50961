"""The codec: converts CAN payloads to values in SI units and back. No other package knows the layout of a message."""

from vehicle_iface.codec.compiled import MessageCodec

__all__ = ["MessageCodec"]
