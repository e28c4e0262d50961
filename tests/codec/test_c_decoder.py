"""The decoder in C beside the decoder in Python: the same messages, counts and verdicts from the same frames."""

import gc
import math
import random
import struct
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import ModuleType

import pytest
from cantools.database import Message
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import wire
from vehicle_iface.codec.binding import Role
from vehicle_iface.codec.c_codec import Scaling, build_unpack
from vehicle_iface.codec.checksums import BitPlace
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.database import EXACT_ID, BoundMessage, Conversion
from vehicle_iface.codec.decoder import Decoder, _Input
from vehicle_iface.codec.e2e import autosar_protection
from vehicle_iface.codec.layout import Field, SignalRules
from vehicle_iface.codec.protection import NO_COUNTER, PayloadBits, Protection, ProtectionRecipe
from vehicle_iface.codec.sent_values import NO_VALUES
from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.frame import CanFrame

from .conftest import PROFILES, load
from .layouts import messages

pytestmark = pytest.mark.usefixtures("c_wire")

RESET = None
"""In the place of a frame: the link was lost."""


class Sender:
    """A sender with faults: mostly good values and the next counter, now and then something else."""

    def __init__(self, messages: tuple[BoundMessage, ...], seed: int) -> None:
        self._messages, self._random = messages, random.Random(seed)
        self._counters = {message.name: self._random.randrange(256) for message in messages}

    def send(self, count: int) -> Iterator[CanFrame | None]:
        for _ in range(count):
            yield RESET if self._is_rare() else self._frame(self._random.choice(self._messages))

    def _is_rare(self) -> bool:
        return self._random.random() < 0.02

    def _frame(self, message: BoundMessage) -> CanFrame:
        chance = self._random
        payload = bytearray(chance.randbytes(message.length) if chance.random() < 0.5 else message.length)
        for field in message.codec.layout.fields:
            BitPlace.of(field).write(payload, self._bits(field))
        protection = message.protection
        if protection is not None:
            step = chance.choice([0, 2, 3, 4, 5, 7]) if chance.random() < 0.05 else 1
            counter = self._counters[message.name] = (self._counters[message.name] + step) % protection.counter_states
            protection.protect(payload, 15 if protection.counter_states == 15 and self._is_rare() else counter)
        if payload and self._is_rare():
            payload[chance.randrange(len(payload))] ^= 1 << chance.randrange(8)
        key = message.key
        frame = CanFrame(
            key.can_id, bytes(payload), chance.randrange(10**12), key.is_extended, is_fd=message.is_fd, bus=key.bus
        )
        if not self._is_rare():
            return frame
        odd = (
            {"is_fd": not frame.is_fd},
            {"is_remote": True},
            {"is_error": True},
            {"is_extended": not frame.is_extended},
            {"data": frame.data[:-1]},
            {"data": frame.data + b"\0"},
            {"can_id": frame.can_id ^ 1},
            {"bus": frame.bus + 1},
        )
        return frame._replace(**chance.choice(odd))

    def _bits(self, field: Field) -> int:
        chance, mask = self._random, (1 << field.width) - 1
        if field.is_float:
            return float_bits(chance, field) & mask
        low, high, named = field.allowed_raw()
        if chance.random() < 0.02:
            odd: int = chance.choice([low - 1, high + 1, *field.missing, *range(low, min(high, low + 40))])
            return odd & mask
        ends = sorted(named) if named else [low, min(low + 1, high), max(high - 1, low), high, min(max(low, 0), high)]
        raw: int = chance.choice(ends) if named or chance.random() < 0.3 else chance.randint(low, max(high, low))
        return raw & mask


def float_bits(chance: random.Random, field: Field) -> int:
    """Mostly a number in the range, now and then one that is outside, zero or not finite."""
    low, high = max(field.lowest, -1e4), min(field.highest, 1e4)
    raw = (chance.uniform(low, high) - field.offset) / field.scale
    if chance.random() < 0.05:
        raw = chance.choice([math.nan, math.inf, -math.inf, 0.0, -0.0, raw + 2e4, raw - 2e4])
    code = {16: "<e", 32: "<f", 64: "<d"}[field.width]
    return int.from_bytes(struct.pack(code, max(-6e4, min(raw, 6e4)) if field.width == 16 else raw), "little")


class Watched(Decoder):
    """A decoder that leaves no plain frame to Python where C could decode it."""

    __slots__ = ()

    def _decode_in_python(self, entry: _Input, frame: CanFrame) -> DecodedMessage | None:
        expected = NO_COUNTER if entry.counters is None else entry.counters.expected
        message = super()._decode_in_python(entry, frame)
        if message is not None and None not in message.values and entry.unpack_in_c is not None:
            has_huge = any(type(value) is int and abs(value) >> 63 for value in message.values)
            assert message.counter != expected or has_huge
        return message


def decode_all(decoder: Decoder, frames: list[CanFrame | None]) -> list[object]:
    """What becomes of each frame, with the types of all values and the bits of all floats."""
    found: list[object] = []
    for frame in frames:
        if frame is None:
            decoder.reset()
            continue
        message = decoder.decode(frame)
        assert message is None or type(message) is DecodedMessage
        values = () if message is None else tuple((type(value), repr(value)) for value in message.values)
        sequences = [(one.counters.expected, one.counters._history) for one in decoder._inputs.values() if one.counters]
        found.append((message and message[:3], values, sequences))
    return [*found, decoder.accepted, decoder.drops, decoder.lost, decoder.seen]


def compare(received: tuple[BoundMessage, ...], seed: int, count: int = 60) -> int:
    """Both decoders do the same with every frame of a sender; how many frames were accepted."""
    frames = [*Sender(received, seed).send(count)]
    c = Watched(received)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(wire.VARIABLE, "python")
        python = Decoder(received)
    assert all(entry.unpack_in_c is None for entry in python._inputs.values())
    assert decode_all(c, frames) == decode_all(python, frames)
    return c.accepted


@pytest.mark.parametrize("profile", PROFILES)
def test_c_decodes_every_message_of_the_shipped_profiles_as_python_does(profile: str) -> None:
    received = load(profile).received
    assert all(build_unpack(message) for message in received)
    assert sum(compare(received, seed, 300) for seed in range(3)) > 300


def bind(
    message: Message,
    protection: Protection | None = None,
    *,
    conversions: tuple[Conversion | None, ...] = (),
    from_wire: tuple[Mapping[int, int] | None, ...] = (),
    rules: Mapping[str, SignalRules] | None = None,
) -> BoundMessage:
    """A received message of a vehicle."""
    codec = MessageCodec(message, rules=rules)
    nothing = (None,) * len(codec.names)
    return BoundMessage(
        name=message.name,
        role=Role.SAMPLE,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        bus=0,
        id_mask=EXACT_ID,
        is_fd=message.is_fd,
        length=message.length,
        cycle_s=None,
        codec=codec,
        signals=(),
        fields=codec.names,
        values=NO_VALUES,
        conversions=conversions or nothing,
        from_wire=from_wire or nothing,
        to_wire=nothing,
        protection=protection,
    )


PROTECTIONS: list[tuple[int, int | tuple[int, ...], str]] = [
    *((1, 0x1234, mode) for mode in ("BOTH", "LOW", "ALT", "NIBBLE")),
    (2, tuple(range(3, 240, 15)), "BOTH"),
    (5, 0xABCD, "BOTH"),
    (11, 0x0BCD, "BOTH"),
]


MISSING: st.SearchStrategy[frozenset[int]] = st.sets(st.integers(0, 3), max_size=2).map(frozenset)


@st.composite
def bound_messages(draw: st.DrawFn) -> BoundMessage:
    """Any layout with any protection and conversions; what protects it may lie on its signals."""
    message = draw(messages(bounded=True))
    protection = None
    if message.length >= 3 and draw(st.booleans()):
        number, data_id, mode = draw(st.sampled_from(PROTECTIONS))
        protection = autosar_protection(number, data_id, message.length, mode)
    elif message.length >= 1 and draw(st.booleans()):  # a counter alone
        place = BitPlace(draw(st.integers(0, 8 * message.length - 4)), 4, draw(st.sampled_from(["little", "big"])))
        protection = Protection(
            intact=lambda _data: True,
            read_counter=place.read,
            protect=lambda data, counter: place.write(data, counter),
            counter_states=16,
            max_step=3,
            recipe=ProtectionRecipe(place.bits, None),
        )
    rules = {
        signal.name: SignalRules(
            limits=None if signal.minimum is None or signal.maximum is None else (signal.minimum, signal.maximum),
            missing=draw(MISSING),
        )
        for signal in message.signals
        if draw(st.booleans())
    }
    units = st.none() | st.builds(Conversion, st.sampled_from([0.001, -2.5, 1.0]), st.sampled_from([0.0, -40.0, 0.5]))
    bound = bind(message, protection, rules=rules)
    fields = bound.codec.layout.fields
    return replace(
        bound,
        conversions=tuple(draw(units) for _ in fields),
        from_wire=tuple(
            {raw: 7 - raw for raw in field.enumeration()} if draw(st.booleans()) and field.enumeration() else None
            for field in fields
        ),
    )


@given(bound_messages(), st.integers(0, 2**32))
def test_c_decodes_any_layout_as_python_does(message: BoundMessage, seed: int) -> None:
    compare((message,), seed)


def test_a_message_that_python_decodes_is_not_given_to_c() -> None:
    status = next(message for message in load("reference").received if message.name == "VEHICLE_STATUS")
    assert status.protection is not None
    assert build_unpack(status) is not None
    assert build_unpack(replace(status, protection=replace(status.protection, recipe=None))) is None
    assert build_unpack(replace(status, codec=MessageCodec(Message(0x100, "M", 8, [], strict=True), False))) is None


def test_no_message_leaves_an_object_behind() -> None:
    received = load("reference").received
    decoder, frames = Decoder(received), [*Sender(received, 1).send(500)]

    def decode() -> None:
        decode_all(decoder, frames)
        gc.collect()

    decode()
    before = sys.getallocatedblocks()
    decode()
    assert abs(sys.getallocatedblocks() - before) < 100


FIELD = (PayloadBits(0, 8, False), False, False, False, 0, 1.0, 0.0, 0.0, 255.0, 0, 255, None)
INPUT = (FIELD, None, None, (), False, 1.0, 0.0)


@pytest.mark.parametrize(
    ("inputs", "what"),
    [
        ((1,), "received signal is a tuple"),
        (((1, *INPUT[1:]),), "a field is a tuple"),
        ((((PayloadBits(1, 8, False), *FIELD[1:]), *INPUT[1:]),), "field does not fit"),
        (((FIELD, [1], *INPUT[2:]),), "a tuple or None"),
        (((FIELD, (1,), *INPUT[2:]),), "a number for each raw one"),
        ((((*FIELD[:4], Scaling.WHOLE, 1e300, *FIELD[6:]), *INPUT[1:]),), "at most 53 bits"),
        ((((*FIELD[:4], Scaling.WHOLE, 1.0, math.nan, *FIELD[7:]), *INPUT[1:]),), "at most 53 bits"),
    ],
)
def test_a_description_that_does_not_fit_is_rejected(c_wire: ModuleType, inputs: object, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        c_wire.Unpacker(DecodedMessage, "M", 1, False, inputs, None, None)


def test_c_rejects_what_it_cannot_use(c_wire: ModuleType) -> None:
    with pytest.raises(ValueError, match="at most 64 bytes"):
        c_wire.Unpacker(DecodedMessage, "M", 65, True, (), None, None)
    with pytest.raises(TypeError, match="subclass of tuple"):
        c_wire.Unpacker(list, "M", 1, False, (), None, None)
    unpack = c_wire.Unpacker(DecodedMessage, "M", 1, False, (INPUT,), None, None).unpack
    assert unpack(CanFrame(1, b"\x07", 5), NO_COUNTER) == DecodedMessage("M", 5, NO_COUNTER, (7,))
    for arguments in ((), ((1, 2), 0), (CanFrame(1, b"\0"), None), (list(CanFrame(1, b"\0")), 0)):
        with pytest.raises(TypeError, match="unpack"):
            unpack(*arguments)
