"""Decodes received frames; only frames that are complete, intact, in sequence and in range are used.

Any other frame is dropped as a whole and counted by cause and message; no frame makes the decoder raise.
"""

from collections.abc import Callable, Iterable
from enum import Enum

from vehicle_iface.codec.c_codec import build_unpack
from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.database import EXACT_ID, BoundMessage, find_masked
from vehicle_iface.codec.e2e import CounterCheck, DamageCheck, Sequence
from vehicle_iface.codec.protection import NO_COUNTER
from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.errors import SignalError
from vehicle_iface.frame import CanFrame, FrameKey


class DropCause(Enum):
    """Why a frame was dropped, in the order of the checks."""

    UNKNOWN_ID = "unknown id"
    """The identifier belongs to none of our messages; counted without a name."""
    WRONG_TYPE = "wrong type"
    """The frame is a remote, error, extended or FD frame, and the message is not."""
    WRONG_LENGTH = "wrong length"
    BAD_CRC = "bad CRC"
    BAD_COUNTER = "bad counter"
    """The counter's value is not a valid one."""
    REPEATED = "repeated"
    WRONG_SEQUENCE = "wrong sequence"
    TOO_MANY_DAMAGED = "too many damaged"
    """The frame is intact, but most of the last frames of this message were damaged."""
    OUT_OF_RANGE = "out of range"
    """The DBC does not allow one of the values. The frame still counts as the next one: the sequence advances."""


_EXTENDED = 1 << 31
"""The bit set in the keys of extended identifiers, which may have the same numbers as standard ones."""
_BUS = 32
"""Keys hold the number of the bus from this bit on, because an identifier has another meaning on another bus."""
_ACCEPTED = (Sequence.OK, Sequence.INITIAL)
_SEQUENCE_DROPS = {
    Sequence.REPEATED: DropCause.REPEATED,
    Sequence.WRONG: DropCause.WRONG_SEQUENCE,
    Sequence.INVALID: DropCause.BAD_COUNTER,
    Sequence.UNTRUSTED: DropCause.TOO_MANY_DAMAGED,
}


class _Input:
    """The decoder's state for one message."""

    __slots__ = (
        "convert",
        "counters",
        "decode",
        "intact",
        "is_fd",
        "length",
        "name",
        "read_counter",
        "seen",
        "unpack_in_c",
    )

    def __init__(self, message: BoundMessage) -> None:
        self.name = message.name
        self.length = message.length
        self.is_fd = message.is_fd
        self.decode = message.codec.decode
        self.counters: DamageCheck | None = None
        protection = message.protection
        if protection is not None:
            self.counters = (
                CounterCheck(protection.counter_states, protection.max_step)
                if protection.has_counter
                else DamageCheck()
            )
            self.intact, self.read_counter = protection.intact, protection.read_counter
        self.convert = _compile_conversion(message)
        self.unpack_in_c = build_unpack(message)
        self.seen = 0


class Decoder:
    """Decodes the given messages and tracks the sequence of each."""

    __slots__ = ("_inputs", "_masked", "accepted", "drops")

    def __init__(self, messages: Iterable[BoundMessage]) -> None:
        kept = tuple(messages)
        self._inputs = {_key(message): _Input(message) for message in kept}
        self._masked = [message for message in kept if message.is_masked]
        self.accepted = 0
        """Frames that became messages."""
        self.drops: dict[tuple[DropCause, str], int] = {}
        """Frames dropped, by cause and message name ("" for unknown ones)."""

    @property
    def seen(self) -> dict[FrameKey, int]:
        """The number of received frames for each of our identifiers, dropped ones included."""
        return {
            FrameKey(key & EXACT_ID, bool(key & _EXTENDED), key >> _BUS): entry.seen
            for key, entry in self._inputs.items()
        }

    @property
    def lost(self) -> dict[str, int]:
        """The number of lost frames of each message, counted by gaps in its counter."""
        checks = ((entry.name, entry.counters) for entry in self._inputs.values())
        return {name: check.lost for name, check in checks if isinstance(check, CounterCheck)}

    def decode(self, frame: CanFrame) -> DecodedMessage | None:
        """Return the message in `frame`, or None if the frame is not ours or was dropped."""
        can_id, _, _, is_extended, _, _, _, bus = frame
        key = can_id | _EXTENDED if is_extended else can_id
        if bus:
            key |= bus << _BUS
        entry = self._inputs.get(key)
        if entry is None and self._masked and is_extended:
            masked = find_masked(self._masked, can_id, bus)
            entry = None if masked is None else self._inputs[_key(masked)]
        if entry is None:
            self._drop_unknown(frame)
            return None
        entry.seen += 1
        counters = entry.counters
        expected = NO_COUNTER if counters is None else counters.expected
        if expected is not None and entry.unpack_in_c is not None:
            message = entry.unpack_in_c(frame, expected)
            if message is not None:
                if counters is not None:
                    counters.expected = counters.following[expected]
                self.accepted += 1
                return message
        return self._decode_in_python(entry, frame)

    def _decode_in_python(self, entry: _Input, frame: CanFrame) -> DecodedMessage | None:
        _, data, stamp_ns, _, is_remote, is_fd, is_error, _ = frame
        if is_remote or is_error or is_fd is not entry.is_fd:
            self._drop(DropCause.WRONG_TYPE, entry.name)
            return None
        if len(data) != entry.length:
            self._drop(DropCause.WRONG_LENGTH, entry.name)
            return None
        counter = NO_COUNTER
        counters = entry.counters
        if counters is not None:
            if not entry.intact(data):
                counters.note_damaged()
                self._drop(DropCause.BAD_CRC, entry.name)
                return None
            counter = entry.read_counter(data)
            if counter == counters.expected:
                counters.expected = counters.following[counter]
            else:
                verdict = counters.step(counter)
                if verdict not in _ACCEPTED:
                    self._drop(_SEQUENCE_DROPS[verdict], entry.name)
                    return None
        try:
            values = entry.decode(data)
        except SignalError:
            self._drop(DropCause.OUT_OF_RANGE, entry.name)
            return None
        if entry.convert is not None:
            values = entry.convert(values)
        self.accepted += 1
        return DecodedMessage(entry.name, stamp_ns, counter, values)

    def reset(self) -> None:
        """Reset all sequences, for example after the bus was reopened. The counts are kept."""
        for entry in self._inputs.values():
            if entry.counters is not None:
                entry.counters.reset()

    def _drop_unknown(self, frame: CanFrame) -> None:
        """Count a frame whose identifier is not ours, or is ours in the other format."""
        other = self._inputs.get((frame.can_id if frame.is_extended else frame.can_id | _EXTENDED) | frame.bus << _BUS)
        if frame.is_error:
            self._drop(DropCause.WRONG_TYPE, "")
        elif other is not None:
            self._drop(DropCause.WRONG_TYPE, other.name)
        else:
            self._drop(DropCause.UNKNOWN_ID, "")

    def _drop(self, cause: DropCause, name: str) -> None:
        key = (cause, name)
        self.drops[key] = self.drops.get(key, 0) + 1


def _key(message: BoundMessage) -> int:
    return message.can_id | (_EXTENDED if message.is_extended else 0) | message.bus << _BUS


def _compile_conversion(message: BoundMessage) -> Callable[[tuple[Value, ...]], tuple[Value, ...]] | None:
    """Compile the function from the DBC's units and numbers to the fields'; None if they are the same."""
    if not any(message.conversions) and not any(message.from_wire):
        return None
    terms = []
    for place, (conversion, table) in enumerate(zip(message.conversions, message.from_wire, strict=True)):
        value = f"v[{place}]"
        if table is not None:  # the codec has already refused numbers without a name
            terms.append(f"(None if {value} is None else tables[{place}][int({value})])")
        elif conversion is not None:
            offset = f" + {conversion.offset!r}" if conversion.offset else ""
            terms.append(f"(None if {value} is None else {value} * {conversion.scale!r}{offset})")
        else:
            terms.append(value)
    source = f"lambda v: ({''.join(term + ', ' for term in terms)})"
    names: dict[str, object] = {"tables": message.from_wire}
    convert: Callable[[tuple[Value, ...]], tuple[Value, ...]] = eval(
        compile(source, f"<units of {message.name}>", "eval"), names
    )
    return convert
