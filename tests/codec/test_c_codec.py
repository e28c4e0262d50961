"""The encoder in C beside the encoder in Python: the same payload for every value, or Python's own answer."""

import math
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.wire_library import SANITIZERS, build_wire, find_runtime, run_tests
from vehicle_iface import wire
from vehicle_iface.codec.c_codec import EXACT_BITS, Pack, build_pack
from vehicle_iface.codec.checksums import (
    BitPlace,
    CoveredMessage,
    build_cover,
    crc_function,
    describe_cover,
    sum_function,
    xor_function,
)
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.codec.e2e import autosar_protection
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.codec.layout import Field
from vehicle_iface.codec.protection import ChecksumRecipe, Payload, PayloadBits, Protection, Reduction
from vehicle_iface.errors import SignalError

from .conftest import PROFILES, load
from .layouts import messages
from .test_encoder import COMMAND

SILENT = "toyota_rav4"
"""The profile without sent messages."""


class Member(IntEnum):
    """A value as the program's enumerations are."""

    NONE = 0
    ONE = 1
    SEVEN = 7


pytestmark = pytest.mark.usefixtures("c_wire")


@pytest.mark.timeout(300)
def test_no_value_makes_c_leave_its_memory(tmp_path: Path) -> None:
    library = build_wire(tmp_path, *SANITIZERS)
    files = [Path(__file__), Path(__file__).with_name("test_c_decoder.py")]
    run_tests(files, library, find_runtime("libasan.so"), without="leave_its_memory")


def sent_messages(name: str) -> list[BoundMessage]:
    return [*load(name).sent]


def good_values(field: Field) -> st.SearchStrategy[object]:
    """Values that the signal allows."""
    low, high, named = field.allowed_raw() if not field.is_float else (-1000, 1000, None)
    if named is not None:
        return st.sampled_from([*sorted(named), *map(float, named)])
    raws = st.integers(max(low, -(2**31)), min(high, 2**31)) if low <= high else st.just(low)
    return raws.map(field.scaled)


def limits_of(field: Field) -> list[object]:
    """Values at and beside every limit of a signal, between two steps, and what is no number for it."""
    low, high, named = field.allowed_raw() if not field.is_float else (-1000, 1000, None)
    raws = {
        low,
        high,
        field.raw_minimum,
        field.raw_maximum,
        *(named or ()),
        *(() if named is None else range(low, high)),
    }
    steps = sorted({raw + by for raw in raws if abs(raw) < 1 << 60 for by in (-1, -0.5, 0, 0.5, 1)})
    ends = [end for end in (field.lowest, field.highest) if math.isfinite(end)]
    beside = [math.nextafter(end, to) for end in ends for to in (-math.inf, math.inf)]
    scaled = [field.scaled(raw) for raw in steps]
    odd = [math.nan, math.inf, -math.inf, None, "1", 2**60, -(2**80), np.float64(1.0), 1e300, -0.0, True, *Member]
    return [*scaled, *(int(value) for value in scaled), *ends, *beside, *odd]


def odd_values(field: Field) -> st.SearchStrategy[object]:
    """Those, and any in the range."""
    low, high = max(field.lowest, -1e6), min(field.highest, 1e6)
    return st.sampled_from(limits_of(field)) | st.floats(min(low, high), max(low, high))


@st.composite
def rows(draw: st.DrawFn, fields: tuple[Field, ...]) -> tuple[Any, ...]:
    """A value for each signal; at most two of them are odd, so that each shows by itself what becomes of it."""
    odd = draw(st.sets(st.sampled_from(range(len(fields))), max_size=2)) if fields else set()
    return tuple(draw((odd_values if i in odd else good_values)(field)) for i, field in enumerate(fields))


def in_python(codec: MessageCodec, protection: Protection | None, values: tuple[Any, ...], counter: int) -> object:
    """The payload, or the kind of error."""
    try:
        data = bytearray(codec.encode(values))
    except SignalError:
        return SignalError
    if protection is not None:
        protection.protect(data, counter)
    return bytes(data)


def is_plain(value: object) -> bool:
    return type(value) in (float, int, bool, Member) and (not isinstance(value, int) or abs(value) <= 1 << EXACT_BITS)


def compare(
    codec: MessageCodec, protection: Protection | None, pack: Pack, values: tuple[Any, ...], counter: int
) -> None:
    """C and Python pack the same, for values that are plainly right; C leaves the others to Python."""
    python, c = in_python(codec, protection, values, counter), pack(values, counter)
    if python is SignalError:
        assert c is None, values
    elif all(map(is_plain, values)):
        assert c == python, values
    else:
        assert c in (None, python), values


def compare_any(codec: MessageCodec, protection: Protection | None, data: st.DataObject) -> None:
    """The same for values that hypothesis chooses."""
    pack = build_pack(codec, protection)
    if pack is not None:
        counter = data.draw(st.integers(0, (protection.counter_states if protection else 1) - 1))
        compare(codec, protection, pack, data.draw(rows(codec.layout.fields)), counter)


@pytest.mark.parametrize("profile", [name for name in PROFILES if name != SILENT])
def test_both_pack_the_same_at_every_limit_of_a_shipped_profile(profile: str) -> None:
    packed = 0
    for message in sent_messages(profile):
        pack, fields = build_pack(message.codec, message.protection), message.codec.layout.fields
        states = message.protection.counter_states if message.protection else 1
        good = [field.scaled(0 if field.is_float else field.allowed_raw()[0]) for field in fields]
        for i, field in enumerate(fields if pack is not None else ()):
            for value in limits_of(field):
                assert pack is not None
                compare(message.codec, message.protection, pack, (*good[:i], value, *good[i + 1 :]), i % states)
                packed += 1
    assert packed > 20


@pytest.mark.parametrize("profile", [name for name in PROFILES if name != SILENT])
@given(data=st.data())
def test_both_pack_the_same_for_every_sent_message_of_a_shipped_profile(profile: str, data: st.DataObject) -> None:
    message = data.draw(st.sampled_from(sent_messages(profile)))
    compare_any(message.codec, message.protection, data)


@given(messages(bounded=True), st.data())
def test_both_pack_the_same_for_any_layout(message: object, data: st.DataObject) -> None:
    compare_any(MessageCodec(message), None, data)  # type: ignore[arg-type]


IN_PYTHON = {"j1939_truck": {"TSC1", "XBR"}, "pacmod3": {"GLOBAL_CMD"}}
"""Sent messages of shipped profiles that C does not pack: a user's checksum function, a complement."""


@pytest.mark.parametrize("profile", PROFILES)
def test_c_packs_the_messages_of_the_shipped_profiles(profile: str) -> None:
    encoder = Encoder(sent_messages(profile))
    assert bool(encoder._outputs) == (profile != SILENT)
    in_c = {name for name, output in encoder._outputs.items() if output.pack_in_c is not None}
    assert encoder._outputs.keys() - in_c == IN_PYTHON.get(profile, set())


E2E = [
    *((1, 0x1234, mode) for mode in ("BOTH", "LOW", "ALT")),
    (2, tuple(range(3, 240, 15)), "BOTH"),
    (5, 0xABCD, "BOTH"),
    (11, 0x0BCD, "BOTH"),
]


@pytest.mark.parametrize(("number", "data_id", "mode"), E2E)
@given(payload=st.binary(min_size=3, max_size=64), count=st.integers(0, 14))
def test_both_protect_the_same_by_every_autosar_profile(
    c_wire: ModuleType, number: int, data_id: int | tuple[int, ...], mode: str, payload: bytes, count: int
) -> None:
    protection = autosar_protection(number, data_id, len(payload), mode)
    assert protection.recipe is not None
    expected = bytearray(payload)
    protection.protect(expected, count)
    packer = c_wire.Packer(payload, (), *protection.recipe)
    assert packer.pack((), count) == expected


@st.composite
def places(draw: st.DrawFn, length: int, width: int) -> BitPlace:
    return BitPlace(draw(st.integers(0, 8 * length - width)), width, draw(st.sampled_from(["little", "big"])))


@given(st.data())
def test_both_compute_the_same_checksum_of_any_kind_over_any_parts(c_wire: ModuleType, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(Reduction))
    is_crc = kind in (Reduction.CRC, Reduction.CRC_REFLECTED)
    width = data.draw(st.sampled_from([8, 16]) if is_crc else st.integers(1, 16))
    length = data.draw(st.integers(3, 16))
    data_id = data.draw(
        st.none() | st.integers(0, 0xFFFF) | st.lists(st.integers(0, 255), min_size=1, max_size=16).map(tuple)
    )
    counter = data.draw(st.none() | st.integers(1, 12).flatmap(lambda bits: places(length, bits)))
    is_extended = data.draw(st.booleans())
    covered = CoveredMessage(
        can_id=data.draw(st.integers(0, 0x1FFFFFFF if is_extended else 0x7FF)),
        is_extended=is_extended,
        length=length,
        checksum=data.draw(places(length, width)),
        counter=counter,
        data_id=data_id,
    )
    over = data.draw(st.permutations(["id", "length", "bytes", "data_id", "counter"]))[: data.draw(st.integers(1, 5))]
    greatest = (1 << width) - 1
    poly, init, xor_out = (data.draw(st.integers(0, greatest)) for _ in range(3))
    functions: dict[Reduction, Callable[[Payload], int]] = {
        Reduction.CRC: crc_function(width if is_crc else 8, poly, init, xor_out),
        Reduction.CRC_REFLECTED: crc_function(width if is_crc else 8, poly, init, xor_out, reflect=True),
        Reduction.SUM: sum_function(width, init, xor_out),
        Reduction.XOR: xor_function(width, init, xor_out),
    }
    payload = data.draw(st.binary(min_size=length, max_size=length))
    count = data.draw(st.integers(0, counter.mask if counter else 0))
    expected = bytearray(payload)
    if counter is not None:
        counter.write(expected, count)
    covered.checksum.write(expected, functions[kind](build_cover(over, covered)(expected)))
    recipe = ChecksumRecipe(covered.checksum.bits, kind, width, poly, init, xor_out, describe_cover(over, covered))
    packer = c_wire.Packer(payload, (), counter.bits if counter else None, recipe)
    assert packer.pack((), count) == expected


def test_the_encoder_sends_the_same_with_and_without_c(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = load("reference").commands
    c = Encoder(commands)
    monkeypatch.setenv(wire.VARIABLE, "python")
    python = Encoder(commands)
    for _ in range(20):
        pair = c.encode_command(COMMAND)
        assert pair == python.encode_command(COMMAND)
        c.commit(pair)
        python.commit(pair[:1])
        python.commit(pair[1:])


FIELD = (PayloadBits(0, 8, False), False, False, False, False, 1.0, 0.0, 0.0, 255.0, 0, 255, None)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ((bytes(65), (), None, None), "at most 64 bytes"),
        ((bytes(1), (FIELD, (PayloadBits(1, 8, False), *FIELD[1:])), None, None), "field does not fit"),
        ((bytes(8), ((PayloadBits(0, 54, False), *FIELD[1:]),), None, None), "field does not fit"),
        ((bytes(8), ((PayloadBits(-1, 8, False), *FIELD[1:]),), None, None), "field does not fit"),
        ((bytes(8), (1,), None, None), "a field is a tuple"),
        ((bytes(8), ((*FIELD[:-1], [1]),), None, None), "a tuple or None"),
        ((bytes(1), (), PayloadBits(8, 4, False), None), "counter is not in the payload"),
        ((bytes(1), (), None, (PayloadBits(8, 8, False), 0, 8, 0, 0, 0, ())), "checksum does not fit"),
        ((bytes(8), (), None, (PayloadBits(8, 8, False), 0, 17, 0, 0, 0, ())), "checksum does not fit"),
        ((bytes(8), (), None, (PayloadBits(8, 8, False), 4, 8, 0, 0, 0, ())), "unknown kind"),
        ((bytes(8), (), None, (PayloadBits(8, 8, False), 0, 8, 0, 0, 0, ((1, bytes(7), 0, 0),))), "does not fit"),
        ((bytes(8), (), None, (PayloadBits(8, 8, False), 0, 8, 0, 0, 0, ((2, b"", 0, 0),))), "does not fit"),
        ((bytes(8), (), None, (PayloadBits(8, 8, False), 0, 8, 0, 0, 0, ((4, b"", 0, 0),))), "unknown kind"),
        ((bytes(8), (), None, (PayloadBits(8, 8, False), 0, 8, 0, 0, 0, ((0, b"", 0, 0),) * 6)), "too many parts"),
    ],
)
def test_a_description_that_does_not_fit_is_rejected(c_wire: ModuleType, arguments: object, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        c_wire.Packer(*arguments)  # type: ignore[misc]
