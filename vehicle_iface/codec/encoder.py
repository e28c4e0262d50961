"""Encodes permitted commands into frames, with counter and checksum.

The counter of a message starts at 0 and steps once for each of its frames that is committed as sent: a frame that
nobody took has stepped nothing, and the next one has its counter.
"""

from collections.abc import Callable, Iterable, Sequence

from vehicle_iface.codec.binding import Role
from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.command import SafeCommand
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.frame import CanFrame, unchecked_frame


class _Output:
    """The encoder's state for one message."""

    __slots__ = (
        "can_id",
        "counter",
        "encode",
        "fields",
        "is_extended",
        "is_fd",
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

    def frame(self, source: object) -> CanFrame:
        """The next frame of this message with the signals of `source`; SignalError when a value cannot be sent."""
        try:
            values = self.values_of(source)
        except KeyError as error:
            raise SignalError(f"{self.name}: {error.args[0]!r} has no number in the DBC's VAL_ table") from None
        return self.pack(values)

    def pack(self, values: Sequence[Value]) -> CanFrame:
        """The next frame of this message with these values; SignalError when one cannot be sent."""
        payload = self.encode(values)
        if self.protection is not None:
            data = bytearray(payload)
            self.protection.protect(data, self.counter)
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
        """Frames of each identifier that were committed; with whether it is extended."""
        return {can_id: output.sent for can_id, output in self._by_id.items()}

    def encode(self, message_name: str, source: object) -> CanFrame:
        """The next frame of a message, its values taken from the attributes of `source` that bear
        its fields' names.

        Raises `SignalError` when a value is not finite or out of range, `ConfigError` for a message that this encoder
        does not have."""
        return self._find(message_name).frame(source)

    def encode_values(self, message_name: str, values: Sequence[Value]) -> CanFrame:
        """The next frame of a message with these values, in the order and the units of its codec.

        Raises `SignalError` and `ConfigError` as `encode` does."""
        return self._find(message_name).pack(values)

    def encode_command(self, command: SafeCommand) -> tuple[CanFrame, ...]:
        """The next frame of each command message; all of them, or `SignalError`."""
        return tuple([output.frame(command) for output in self._commands])

    def _find(self, message_name: str) -> _Output:
        output = self._outputs.get(message_name)
        if output is None:
            raise ConfigError(f"no message {message_name!r}: must be one of {', '.join(self._outputs)}")
        return output

    def commit(self, frames: Iterable[CanFrame]) -> None:
        """These frames were sent, at most one of each message: the next ones have the counters after theirs."""
        outputs = self._by_id
        for frame in frames:
            output = outputs[frame.can_id, frame.is_extended]
            output.sent += 1
            if output.protection is not None:
                output.counter = output.protection.next_counter(output.counter)

    def fields_of(self, frames: Iterable[CanFrame]) -> set[str]:
        """The fields whose values these frames carry."""
        return {field for frame in frames for field in self._by_id[frame.can_id, frame.is_extended].fields if field}


def _collector(message: BoundMessage) -> Callable[[object], tuple[Value, ...]]:
    """A function that reads a message's values off an object, compiled once: no name is looked up
    on the way."""
    terms = []
    for place, field in enumerate(message.fields):
        conversion = message.conversions[place]
        if not field:
            terms.append("0")
        elif message.to_wire[place] is not None:
            terms.append(f"tables[{place}][s.{field}]")
        elif conversion is not None:
            value = f"(s.{field} - {conversion.offset!r})" if conversion.offset else f"s.{field}"
            terms.append(f"{value} / {conversion.scale!r}")
        else:
            terms.append(f"s.{field}")
    source = f"lambda s: ({''.join(term + ', ' for term in terms)})"
    names: dict[str, object] = {"tables": message.to_wire}
    collect: Callable[[object], tuple[Value, ...]] = eval(compile(source, f"<values of {message.name}>", "eval"), names)
    return collect
