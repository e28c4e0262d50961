"""Finds what an identifier means: its message in the profile and in the DBC of its bus."""

from __future__ import annotations

from dataclasses import dataclass

from vehicle_iface.codec.bus_files import read_dbcs
from vehicle_iface.codec.cantools_classes import Message
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase, find_masked
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import FrameKey


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What is known of one identifier."""

    bus: str
    bound: BoundMessage | None
    """None: the profile does not use it."""
    message: Message | None
    """None: it is in no DBC."""
    is_sent: bool
    """A message that the loop sends."""

    def compile_codec(self) -> MessageCodec | None:
        """Return the decoder of all its signals; None when there is none."""
        if self.message is None:
            return None
        try:
            return MessageCodec(self.message, checked=False)
        except ConfigError:  # the data is shown as it is
            return None


class MessageFinder:
    """All messages of one vehicle, those that the profile uses and those that it does not."""

    def __init__(self, database: VehicleDatabase) -> None:
        profile = database.profile
        self.buses = list(profile.all_buses)
        """Names, by the number of the bus in a frame."""
        self.bound = (*database.received, *database.sent)
        self._sent = {message.name for message in database.sent}
        file = read_dbcs(profile)
        parts = file.parts or {"": file}
        self._messages: dict[FrameKey, Message] = {
            FrameKey(message.frame_id, message.is_extended_frame, number): message
            for number, name in enumerate(self.buses)
            for message in parts[name].messages.values()
        }

    def find(self, key: FrameKey) -> Found:
        """Return the message of an identifier on its bus."""
        bound = next((each for each in self.bound if each.key == key and not each.is_masked), None)
        if bound is None and key.is_extended:
            masked = [each for each in self.bound if each.is_masked]
            bound = find_masked(masked, key.can_id, key.bus)
        message = self._messages.get(key) or (self._messages.get(bound.key) if bound is not None else None)
        is_sent = bound is not None and bound.name in self._sent
        return Found(bus=self.buses[key.bus], bound=bound, message=message, is_sent=is_sent)
