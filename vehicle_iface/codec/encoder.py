"""Encodes permitted commands into frames, with counter and checksum.

The counter of a message starts at 0 and steps once for each of its frames that is committed as sent. A frame that was
not sent steps no counter; the next one reuses it.
"""

from collections.abc import Callable, Collection, Iterable, Sequence

from vehicle_iface.codec.binding import Role
from vehicle_iface.codec.c_codec import build_pack
from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.codec.sent_values import SendContext
from vehicle_iface.command import SafeCommand, WireCommand
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.frame import CanFrame, FrameKey, unchecked_frame


class _Output:
    """The encoder's state for one message."""

    __slots__ = (
        "bus",
        "can_id",
        "complements",
        "counter",
        "echoes",
        "encode",
        "fields",
        "is_extended",
        "is_fd",
        "is_sealed",
        "name",
        "pack_in_c",
        "protection",
        "sent",
        "values_of",
    )

    def __init__(self, message: BoundMessage) -> None:
        self.name = message.name
        self.can_id, self.bus = message.can_id, message.bus
        self.is_extended = message.is_extended
        self.is_fd = message.is_fd
        self.encode = message.codec.encode
        self.protection = message.protection
        self.values_of = _collector(message)
        self.echoes, self.complements = message.values.echoes, message.values.complements
        self.fields = message.fields
        self.is_sealed = self.protection is not None or bool(self.complements)
        self.pack_in_c = None if self.complements else build_pack(message.codec, message.protection)
        self.counter = 0
        self.sent = 0

    def frame(self, source: object, context: SendContext) -> CanFrame:
        """Return the next frame with the signals of `source`; raises `SignalError` if a value cannot be sent."""
        try:
            values = self.values_of(source, context, self.sent)
        except KeyError as error:
            raise SignalError(f"{self.name}: {error.args[0]!r} has no number in the DBC's VAL_ table") from None
        return self.pack(values)

    def pack(self, values: Sequence[Value]) -> CanFrame:
        """Return the next frame with these values; raises `SignalError` if one cannot be sent."""
        pack = self.pack_in_c
        payload = None if pack is None else pack(values, self.counter)
        if payload is None:
            payload = self._pack_in_python(values)
        return unchecked_frame((self.can_id, payload, 0, self.is_extended, False, self.is_fd, False, self.bus))

    def _pack_in_python(self, values: Sequence[Value]) -> bytes:
        payload = self.encode(values)
        if self.is_sealed:
            data = bytearray(payload)
            for place, of in self.complements:
                place.write(data, place.mask ^ (self.counter if of is None else of.read(data)))
            if self.protection is not None:
                self.protection.protect(data, self.counter)
            payload = bytes(data)
        return payload


class Encoder:
    """Encodes the given messages and tracks the counter of each."""

    __slots__ = ("_by_id", "_commands", "_outputs", "context", "depends_on_context")

    def __init__(self, messages: Iterable[BoundMessage]) -> None:
        kept = tuple(messages)
        self.context = SendContext()
        """The context of values that no field fills, for the next frames."""
        self.depends_on_context = any(message.values.expressions for message in kept)
        self._outputs = {message.name: _Output(message) for message in kept}
        self._by_id = {(output.can_id, output.is_extended, output.bus): output for output in self._outputs.values()}
        self._commands = tuple(self._outputs[message.name] for message in kept if message.role is Role.COMMAND)

    @property
    def sent(self) -> dict[FrameKey, int]:
        """The number of committed frames for each identifier."""
        return {FrameKey(*key): output.sent for key, output in self._by_id.items()}

    def encode(self, message_name: str, source: object) -> CanFrame:
        """Return the next frame of a message.

        Its values are read from the attributes of `source` that have the names of the message's fields.

        Raises `SignalError` when a value is not finite or out of range, and `ConfigError` for a message that this
        encoder does not have.
        """
        return self._find(message_name).frame(source, self.context)

    def encode_values(self, message_name: str, values: Sequence[Value]) -> CanFrame:
        """Return the next frame of a message with these values, in the order and units of its codec.

        Raises `SignalError` and `ConfigError` as `encode` does.
        """
        return self._find(message_name).pack(values)

    def encode_command(
        self, command: SafeCommand | WireCommand, names: Collection[str] | None = None
    ) -> tuple[CanFrame, ...]:
        """Return the next frame of each command message, or of those in `names`.

        Raises `SignalError` if any of them cannot be encoded.
        """
        outputs = self._commands
        if names is not None:
            outputs = tuple([output for output in outputs if output.name in names])
        return tuple([output.frame(command, self.context) for output in outputs])

    def has_echoes(self, names: Iterable[str]) -> bool:
        """Whether all received values that these messages send back have been received."""
        row = self.context.row
        return all(row[column] is not None for name in names for column in self._outputs[name].echoes)

    def _find(self, message_name: str) -> _Output:
        output = self._outputs.get(message_name)
        if output is None:
            raise ConfigError(f"no message {message_name!r}: must be one of {', '.join(self._outputs)}")
        return output

    def commit(self, frames: Iterable[CanFrame]) -> None:
        """Count these frames as sent, at most one of each message. The next frames have the counters after theirs."""
        outputs = self._by_id
        for frame in frames:
            can_id, _, _, is_extended, _, _, _, bus = frame
            output = outputs[can_id, is_extended, bus]
            output.sent += 1
            if output.protection is not None:
                output.counter = output.protection.next_counter(output.counter)

    def fields_of(self, frames: Iterable[CanFrame]) -> set[str]:
        """Return the fields whose values these frames carry."""
        outputs = [self._by_id[frame.can_id, frame.is_extended, frame.bus] for frame in frames]
        return {field for output in outputs for field in output.fields if field}


def _collector(message: BoundMessage) -> Callable[[object, SendContext, int], tuple[Value, ...]]:
    """Compile a function that reads a message's values from an object's attributes, without looking up names."""
    terms = []
    for place, field in enumerate(message.fields):
        conversion = message.conversions[place]
        expression = message.values.expressions.get(message.codec.names[place])
        if expression is not None:
            terms.append(expression)
        elif not field:
            terms.append("0")
        elif message.to_wire[place] is not None:
            terms.append(f"tables[{place}][s.{field}]")
        elif conversion is not None:
            value = f"(s.{field} - {conversion.offset!r})" if conversion.offset else f"s.{field}"
            terms.append(f"{value} / {conversion.scale!r}")
        else:
            terms.append(f"s.{field}")
    source = f"lambda s, x, n: ({''.join(term + ', ' for term in terms)})"
    names: dict[str, object] = {"tables": message.to_wire}
    collect: Callable[[object, SendContext, int], tuple[Value, ...]] = eval(
        compile(source, f"<values of {message.name}>", "eval"), names
    )
    return collect
