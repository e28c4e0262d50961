"""Permissions to frames: the fields of an object into a message's signals, with counter and checksum.

The counter of a message steps once for each frame that was built of it, from 0; a value that cannot
be sent raises `SignalError` and steps nothing, and a frame that nobody took may be taken back.
"""

from collections.abc import Callable, Iterable

from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.database import BoundMessage, Role
from vehicle_iface.command import SafeCommand
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.frame import CanFrame, unchecked_frame


class _Output:
    """What the encoder keeps of one message."""

    __slots__ = (
        "can_id",
        "counter",
        "encode",
        "fields",
        "is_extended",
        "is_fd",
        "last",
        "name",
        "protection",
        "sent",
        "values_of",
    )

    def __init__(self, message: BoundMessage) -> None:
        self.name = message.name
        self.can_id = message.can_id
        self.is_extended = message.is_extended
        self.is_fd = message.is_fd
        self.encode = message.codec.encode
        self.protection = message.protection
        self.values_of = _collector(message)
        self.fields = message.fields
        self.counter = 0
        self.sent = 0
        self.last = 0
        """The counter of the frame before the next one."""

    def payload(self, source: object) -> bytes:
        """The signals of `source`, not yet protected; SignalError when a value cannot be sent."""
        try:
            values = self.values_of(source)
        except KeyError as error:
            raise SignalError(f"{self.name}: {error.args[0]!r} has no number in the DBC's VAL_ table") from None
        return self.encode(values)

    def frame(self, payload: bytes) -> CanFrame:
        """The next frame of this message with that payload; steps the counter."""
        self.sent += 1
        if self.protection is not None:
            data = bytearray(payload)
            self.protection.protect(data, self.counter)
            self.last = self.counter
            self.counter = self.protection.next_counter(self.counter)
            payload = bytes(data)
        return unchecked_frame((self.can_id, payload, 0, self.is_extended, False, self.is_fd, False))


class Encoder:
    """Encodes the given messages; keeps the counter of each."""

    __slots__ = ("_by_id", "_commands", "_outputs")

    def __init__(self, messages: Iterable[BoundMessage]) -> None:
        kept = tuple(messages)
        self._outputs = {message.name: _Output(message) for message in kept}
        self._by_id = {(output.can_id, output.is_extended): output for output in self._outputs.values()}
        self._commands = tuple(self._outputs[message.name] for message in kept if message.role is Role.COMMAND)

    @property
    def sent(self) -> dict[tuple[int, bool], int]:
        """Frames of each identifier that were built and not taken back; with whether it is extended."""
        return {can_id: output.sent for can_id, output in self._by_id.items()}

    def encode(self, message_name: str, source: object) -> CanFrame:
        """The next frame of a message, its values taken from the attributes of `source` that bear
        its fields' names.

        Raises `SignalError` when a value is not finite or out of range (the counter then stays),
        `ConfigError` for a message that this encoder does not have."""
        output = self._outputs.get(message_name)
        if output is None:
            raise ConfigError(f"no message {message_name!r}: must be one of {', '.join(self._outputs)}")
        return output.frame(output.payload(source))

    def encode_command(self, command: SafeCommand) -> tuple[CanFrame, ...]:
        """One frame of each command message; all of them, or `SignalError` and no counter has stepped."""
        payloads = [output.payload(command) for output in self._commands]
        return tuple(output.frame(data) for output, data in zip(self._commands, payloads, strict=True))

    def fields_of(self, frames: Iterable[CanFrame]) -> set[str]:
        """The fields whose values these frames of ours carry."""
        return {field for frame in frames for field in self._by_id[frame.can_id, frame.is_extended].fields if field}

    def take_back(self, frame: CanFrame) -> None:
        """The newest frame of its message was not sent: the next one bears its counter again.

        What is no message of ours has none.
        """
        output = self._by_id.get((frame.can_id, frame.is_extended))
        if output is not None:
            output.counter = output.last
            output.sent -= 1


def _collector(message: BoundMessage) -> Callable[[object], tuple[Value, ...]]:
    """A function that reads a message's values off an object, compiled once: no name is looked up
    on the way."""
    terms = []
    for index, field in enumerate(message.fields):
        if not field:
            terms.append(repr(message.constants[index]))
        elif message.to_bus[index] is not None:
            terms.append(f"tables[{index}][s.{field}]")
        else:
            terms.append(f"s.{field}")
    source = f"lambda s: ({''.join(term + ', ' for term in terms)})"
    names: dict[str, object] = {"tables": message.to_bus}
    collect: Callable[[object], tuple[Value, ...]] = eval(compile(source, f"<values of {message.name}>", "eval"), names)
    return collect
