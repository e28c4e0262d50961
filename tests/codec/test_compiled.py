"""The compiled codec gives what cantools gives, bit for bit, and the checked one refuses the rest."""

import contextlib
import math
import struct
from collections.abc import Callable, Iterable
from typing import Any, Literal, TypeVar

import cantools
import numpy as np
import pytest
from cantools.database import Message, Signal
from cantools.database.can import Database
from cantools.database.conversion import BaseConversion, LinearConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.codec import MessageCodec
from vehicle_iface.codec.layout import SignalRules
from vehicle_iface.errors import ConfigError, SignalError

from .layouts import as_tuple, decoded, messages, network_start

T = TypeVar("T")
ByteOrder = Literal["little_endian", "big_endian"]
CANTOOLS_REFUSALS = (cantools.database.errors.Error, ValueError, ArithmeticError, KeyError)


def same(ours: Iterable[object], theirs: Iterable[object]) -> bool:
    """Equal with the same type, NaN and signed zeros included."""
    return [(type(v), struct.pack("<d", v) if isinstance(v, float) else v) for v in ours] == [
        (type(v), struct.pack("<d", v) if isinstance(v, float) else v) for v in theirs
    ]


def theirs_or_none(function: Callable[[], T]) -> T | None:
    try:
        return function()
    except CANTOOLS_REFUSALS:
        return None


def message_of(*signals: Signal, length: int = 8) -> Message:
    return Message(0x100, "MESSAGE", length, list(signals), strict=True, is_fd=length > 8)


def signal(
    name: str = "SIGNAL",
    start: int = 0,
    width: int = 16,
    *,
    order: ByteOrder = "little_endian",
    signed: bool = False,
    **rest: Any,
) -> Signal:
    options = {key: rest.pop(key) for key in ("scale", "offset", "choices", "is_float") if key in rest}
    return Signal(name, start, width, order, signed, conversion=BaseConversion.factory(**options), **rest)


@settings(max_examples=150, deadline=None)
@given(messages(), st.data())
def test_decodes_random_bytes_and_encodes_them_again_as_cantools_does(message: Message, data: st.DataObject) -> None:
    codec = MessageCodec(message, checked=False)
    for _ in range(4):
        payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
        theirs = theirs_or_none(lambda: decoded(message, payload))  # noqa: B023
        if theirs is None:
            with pytest.raises(SignalError):
                codec.decode(payload)
            continue
        values = codec.decode(payload)
        assert same(values, as_tuple(codec.names, theirs))
        again = theirs_or_none(lambda: message.encode(theirs, strict=False))  # noqa: B023
        if again is not None:
            assert codec.encode(values) == again


@settings(max_examples=150, deadline=None)
@given(messages(), st.data())
def test_encodes_random_values_as_cantools_does(message: Message, data: st.DataObject) -> None:
    codec = MessageCodec(message, checked=False)
    numbers = st.one_of(
        st.integers(-300, 300),
        st.integers(-(2**66), 2**66),
        st.floats(allow_nan=True, allow_infinity=True),
        st.floats(-300, 300),
        st.booleans(),
    )
    values = [data.draw(numbers) for _ in codec.names]
    for index, name in enumerate(codec.names):
        choices = message.get_signal_by_name(name)
        if choices.is_multiplexer and message.is_multiplexed():
            known = [number for s in message.signals for number in s.multiplexer_ids or ()]
            values[index] = data.draw(st.sampled_from(known))
    named = dict(zip(codec.names, values, strict=True))
    theirs = theirs_or_none(lambda: message.encode(named, strict=False))
    if theirs is None:
        with pytest.raises(SignalError):
            codec.encode(values)
    else:
        assert codec.encode(values) == theirs


@settings(max_examples=120, deadline=None)
@given(messages(bounded=True), st.data())
def test_checked_values_are_in_range_and_encoded_like_strict_cantools(message: Message, data: st.DataObject) -> None:
    codec = MessageCodec(message)
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    try:
        values = codec.decode(payload)
    except SignalError:
        return
    assert same(values, as_tuple(codec.names, decoded(message, payload)))
    for name, value in zip(codec.names, values, strict=True):
        limits = message.get_signal_by_name(name)
        assert value is None or math.isfinite(value)
        if value is not None and limits.minimum is not None and limits.maximum is not None:
            slack = abs(limits.scale) * 1e-6
            assert limits.minimum - slack <= value <= limits.maximum + slack
    present = {name: value for name, value in zip(codec.names, values, strict=True) if value is not None}
    assert codec.encode(values) == message.encode(present, strict=True)


@settings(max_examples=120, deadline=None)
@given(messages(bounded=True), st.booleans(), st.data())
def test_nothing_but_our_own_error_comes_out(message: Message, checked: bool, data: st.DataObject) -> None:
    codec = MessageCodec(message, checked=checked)
    junk = st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(),
        st.text(max_size=3),
        st.just(10**400),
        st.just(1j),
        st.just([1]),
        st.floats(-10, 10).map(np.float64),
    )
    values = data.draw(st.lists(junk, max_size=len(codec.names) + 2))
    payload: Any = data.draw(st.one_of(st.binary(max_size=70), st.none(), st.text(max_size=8), st.integers()))
    with contextlib.suppress(SignalError):
        codec.encode(values)
    with contextlib.suppress(SignalError):
        codec.decode(payload)


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("order", ["little_endian", "big_endian"])
def test_every_width_at_every_bit_is_what_cantools_reads(order: ByteOrder, signed: bool) -> None:
    payloads = (bytes(range(0x51, 0x51 + 9 * 17, 17)), bytes(range(0xAE, 0xAE - 9 * 17, -17)), bytes(9), b"\xff" * 9)
    for width in range(1, 65):
        for first in range(8):
            start = network_start(first) if order == "big_endian" else first
            message = message_of(signal("SIGNAL", start, width, order=order, signed=signed), length=9)
            decode = MessageCodec(message).decode
            for payload in payloads:
                assert decode(payload) == (decoded(message, payload)["SIGNAL"],), (width, first, payload)


@pytest.mark.parametrize("order", ["little_endian", "big_endian"])
@pytest.mark.parametrize(
    ("signals", "length"),
    [
        ([(0, 16, True), (8, 8, False), (0, 8, False)], 2),
        ([(0, 16, False), (8, 8, True), (4, 12, False), (4, 12, True)], 2),
        ([(0, 24, True), (0, 24, False), (16, 8, False), (8, 8, True)], 3),
        ([(3, 61, True), (32, 32, False), (0, 64, False), (60, 4, True)], 8),
    ],
)
def test_signals_that_share_bits_are_each_what_they_are_alone(
    order: ByteOrder, signals: list[tuple[int, int, bool]], length: int
) -> None:
    """A database that is read without strictness may have such; cantools decodes no message of them."""
    ours = []
    for first, width, signed in signals:
        start = network_start(8 * length - first - width) if order == "big_endian" else first
        ours.append(signal(f"S{first}_{width}_{signed}", start, width, order=order, signed=signed))
    message = Message(0x100, "MESSAGE", length, ours, strict=False)
    codec = MessageCodec(message)
    for payload in (bytes(range(0x7B, 0x7B + length)), bytes(range(0x8A, 0x8A + length)), b"\xff" * length):
        alone = {one.name: decoded(message_of(one, length=length), payload)[one.name] for one in ours}
        assert same(codec.decode(payload), as_tuple(codec.names, alone))


@pytest.mark.parametrize("start", [0, 3, 8])
@pytest.mark.parametrize("order", ["little_endian", "big_endian"])
@pytest.mark.parametrize(
    ("width", "bits"),
    [
        *((16, bits) for bits in (0x0001, 0x8000, 0x7D55, 0xFC00)),
        *((32, bits) for bits in (0x80000000, 0x7FA00001, 0xFF800000)),
        *((64, bits) for bits in (1, 1 << 63, 0x7FF0000000000001, 0xFFF8DEADBEEF0000)),
    ],
)
def test_a_float_is_taken_out_bit_for_bit_wherever_it_lies(width: int, bits: int, order: ByteOrder, start: int) -> None:
    first = network_start(start) if order == "big_endian" else start
    float_there = signal("SIGNAL", first, width, order=order, is_float=True)
    message, plain = (message_of(one, length=9) for one in (float_there, signal("SIGNAL", first, width, order=order)))
    payload = plain.encode({"SIGNAL": bits})
    codec = MessageCodec(message, checked=False)
    assert same(codec.decode(payload), as_tuple(codec.names, decoded(message, payload)))


@pytest.mark.parametrize("length", [0, 1, 7, 9, 64])
def test_a_wrong_length_is_refused_with_the_right_one(length: int) -> None:
    codec = MessageCodec(message_of(signal()))
    with pytest.raises(SignalError, match=rf"MESSAGE: {length} bytes: must be 8"):
        codec.decode(bytes(length))


def test_without_checks_a_long_payload_is_cut_and_a_short_one_refused_as_cantools_does() -> None:
    codec = MessageCodec(message_of(signal()), checked=False)
    assert codec.decode(b"\x01\x02" + bytes(8)) == (0x201,)
    with pytest.raises(SignalError, match="7 bytes"):
        codec.decode(bytes(7))


@pytest.mark.parametrize(
    ("value", "fits"), [(-2, True), (-2.01, False), (100, True), (100.01, False), (math.nan, False)]
)
def test_encoding_ends_exactly_at_the_range(value: float, fits: bool) -> None:
    codec = MessageCodec(message_of(signal(scale=0.01, signed=True, minimum=-2, maximum=100)))
    if fits:
        assert codec.decode(codec.encode([value])) == pytest.approx((value,))
    else:
        with pytest.raises(SignalError, match=r"MESSAGE\.SIGNAL = .*(in \[-2, 100\]|finite)"):
            codec.encode([value])


@pytest.mark.parametrize("raw", [-201, -200, -199, 9999, 10000, 10001, 32767, -32768])
def test_decoding_ends_exactly_at_the_range(raw: int) -> None:
    codec = MessageCodec(message_of(signal(scale=0.01, signed=True, minimum=-2, maximum=100)))
    payload = raw.to_bytes(2, "little", signed=True) + bytes(6)
    if -200 <= raw <= 10000:
        assert codec.decode(payload) == (raw * 0.01,)
    else:
        with pytest.raises(SignalError, match=r"MESSAGE\.SIGNAL = .*: must be in \[-2, 100\]"):
            codec.decode(payload)


def test_a_falling_scale_keeps_its_range() -> None:
    codec = MessageCodec(message_of(signal(scale=-0.5, signed=True, minimum=-10, maximum=20)))
    accepted: list[float] = []
    for raw in range(-100, 100):
        try:
            (value,) = codec.decode(raw.to_bytes(2, "little", signed=True) + bytes(6))
        except SignalError:
            continue
        assert value is not None
        accepted.append(value)
    assert (min(accepted), max(accepted)) == (-10, 20)


@pytest.mark.parametrize("number", range(16))
def test_a_number_without_a_name_is_refused_both_ways(number: int) -> None:
    names = {0: "OFF", 1: "ON", 7: "AUTO"}
    codec = MessageCodec(message_of(signal(width=4, choices=names, minimum=0, maximum=15)))
    payload = bytes([number]) + bytes(7)
    if number in names:
        assert codec.decode(payload) == (number,)
        assert codec.encode([number]) == payload
    else:
        for call in (lambda: codec.decode(payload), lambda: codec.encode([number])):
            with pytest.raises(SignalError, match=rf"MESSAGE\.SIGNAL = {number}: must be one of {{0, 1, 7}}"):
                call()


@pytest.mark.parametrize("names", [{0: "OFF", 1: "ON", 2: "AUTO"}, {0: "OFF", 1: "ON", 2: "LOW", 7: "AUTO"}])
@pytest.mark.parametrize("between", [0.4, 0.5, 1.6, 1.0 + 1e-12, -0.1, math.nan])
def test_between_two_names_there_is_no_third(names: dict[int, str], between: float) -> None:
    message = message_of(signal(width=3, choices=names, minimum=0, maximum=7))
    codec = MessageCodec(message)
    with pytest.raises(SignalError, match=r"MESSAGE\.SIGNAL"):
        codec.encode([between])
    assert [codec.encode([whole]) for whole in (1, 1.0, True)] == [b"\x01" + bytes(7)] * 3
    if math.isfinite(between) and between > 0:
        assert MessageCodec(message, checked=False).encode([between]) == bytes([round(between)]) + bytes(7)


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ({65534: "ERROR", 65535: "NOT_AVAILABLE"}, None),
        ({0: "NONE", 65535: "NOT_AVAILABLE"}, None),
        ({0: "STANDS", 1: "CREEPS", 65535: "NOT_AVAILABLE"}, "rpm"),
    ],
)
def test_a_table_of_a_few_special_numbers_is_no_list_of_all_that_are_allowed(names: dict[int, str], unit: str) -> None:
    message = message_of(signal(width=16, choices=names, minimum=0, maximum=65535, unit=unit))
    payload = bytes([0xE8, 3]) + bytes(6)
    assert MessageCodec(message).decode(payload) == (1000,)
    with pytest.raises(SignalError, match="1000: must be one of"):
        MessageCodec(message, rules={"SIGNAL": SignalRules(is_enumerated=True)}).decode(payload)


def test_a_number_that_the_program_needs_a_name_for_is_refused_beside_a_marker_out_of_range() -> None:
    gear = signal(width=4, choices={1: "REVERSE", 2: "DRIVE", 15: "NOT_AVAILABLE"}, minimum=0, maximum=7)
    codec = MessageCodec(message_of(gear), rules={"SIGNAL": SignalRules(is_enumerated=True)})
    assert codec.decode(bytes([2]) + bytes(7)) == (2,)
    for number in (3, 15):
        with pytest.raises(SignalError, match=r"must be one of \{1, 2\}"):
            codec.decode(bytes([number]) + bytes(7))


def test_a_name_outside_the_range_is_a_marker_for_no_value() -> None:
    percent = signal(width=8, choices={255: "NOT_AVAILABLE"}, minimum=0, maximum=100)
    codec = MessageCodec(message_of(percent))
    assert codec.decode(bytes([50]) + bytes(7)) == (50,)
    with pytest.raises(SignalError, match=r"255: must be in \[0, 100\]"):
        codec.decode(bytes([255]) + bytes(7))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("width", [16, 32, 64])
def test_a_float_that_is_not_finite_is_refused_both_ways(width: int, value: float) -> None:
    message = message_of(signal(width=width, is_float=True))
    checked, unchecked = MessageCodec(message), MessageCodec(message, checked=False)
    payload = unchecked.encode([value])
    with pytest.raises(SignalError, match=r"MESSAGE\.SIGNAL"):
        checked.decode(payload)
    with pytest.raises(SignalError, match=r"MESSAGE\.SIGNAL"):
        checked.encode([value])


@pytest.mark.parametrize("value", [3.5e38, 1e300])
def test_a_float_too_great_for_its_bits_is_refused(value: float) -> None:
    codec = MessageCodec(message_of(signal(width=32, is_float=True)))
    with pytest.raises(SignalError):
        codec.encode([value])


@pytest.mark.parametrize("value", [-1, 256, math.nan, math.inf, None, "1", 10**400])
def test_a_value_too_great_for_its_bits_is_refused_with_and_without_checks(value: Any) -> None:
    for checked in (True, False):
        codec = MessageCodec(message_of(signal(width=8)), checked=checked)
        with pytest.raises(SignalError, match="MESSAGE"):
            codec.encode([value])


@pytest.fixture
def multiplexed() -> Message:
    return message_of(
        signal("MODE", 0, 8, is_multiplexer=True),
        signal("SPEED", 8, 16, multiplexer_ids=[1, 2], multiplexer_signal="MODE"),
        signal("ANGLE", 8, 8, multiplexer_ids=[3], multiplexer_signal="MODE"),
    )


def test_the_other_branch_is_none(multiplexed: Message) -> None:
    codec = MessageCodec(multiplexed)
    assert codec.names == ("MODE", "SPEED", "ANGLE")
    assert codec.decode(bytes([2, 5, 0, 0, 0, 0, 0, 0])) == (2, 5, None)
    assert codec.encode((3, None, 9)) == bytes([3, 9, 0, 0, 0, 0, 0, 0])


def test_an_unknown_multiplexer_is_refused_both_ways(multiplexed: Message) -> None:
    codec = MessageCodec(multiplexed)
    for call in (lambda: codec.decode(bytes([9] * 8)), lambda: codec.encode((9, None, None))):
        with pytest.raises(SignalError, match=r"MESSAGE\.MODE = 9: must be a multiplexer id of {1, 2, 3}"):
            call()


def test_a_value_for_a_hidden_signal_is_refused(multiplexed: Message) -> None:
    with pytest.raises(SignalError, match=r"MESSAGE\.ANGLE = 9: must be None, MODE hides this signal"):
        MessageCodec(multiplexed).encode((1, 5, 9))


def test_a_missing_value_in_a_shown_branch_is_refused(multiplexed: Message) -> None:
    with pytest.raises(SignalError, match="MESSAGE"):
        MessageCodec(multiplexed).encode((1, None, None))


def test_extended_multiplexing_of_a_dbc_is_understood() -> None:
    text = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 EXT: 8 A
 SG_ OUTER M : 0|4@1+ (1,0) [0|0] "" A
 SG_ INNER m0M : 4|4@1+ (1,0) [0|0] "" A
 SG_ X m0 : 8|8@1+ (0.5,-3) [0|0] "" A
 SG_ Y m1 : 8|16@1- (1,0) [0|0] "" A
 SG_ Z m3 : 8|8@1+ (1,0) [0|0] "" A
SG_MUL_VAL_ 256 INNER OUTER 0-2;
SG_MUL_VAL_ 256 X INNER 0-0;
SG_MUL_VAL_ 256 Y INNER 1-1, 3-5;
SG_MUL_VAL_ 256 Z OUTER 3-3;
"""
    database = cantools.database.load_string(text, "dbc")
    assert isinstance(database, Database)
    (message,) = database.messages
    codec = MessageCodec(message, checked=False)
    for first in range(256):
        payload = bytes([first, 0x80, 0xFF, 0, 0, 0, 0, 0])
        theirs = theirs_or_none(lambda: decoded(message, payload))  # noqa: B023
        if theirs is None:
            with pytest.raises(SignalError):
                codec.decode(payload)
        else:
            assert same(codec.decode(payload), as_tuple(codec.names, theirs))


def test_numbers_of_numpy_are_numbers() -> None:
    codec = MessageCodec(message_of(signal(), signal("HIGH", 48, 16)))
    values: list[Any] = [np.float64(1.0), np.int64(0xFFFF)]
    assert codec.encode(values) == bytes([1, 0, 0, 0, 0, 0, 0xFF, 0xFF])


@pytest.mark.parametrize("values", [[], [1, 2], 5, None, "1"])
def test_anything_but_one_value_for_each_signal_is_refused(values: Any) -> None:
    with pytest.raises(SignalError, match="MESSAGE"):
        MessageCodec(message_of(signal())).encode(values)


def test_a_message_without_signals_has_a_codec() -> None:
    codec = MessageCodec(message_of(length=0))
    assert codec.decode(b"") == ()
    assert codec.encode(()) == b""


def test_a_conversion_of_an_unknown_kind_is_refused() -> None:
    class Odd(LinearConversion):
        pass

    message = message_of(Signal("SIGNAL", 0, 8, conversion=Odd(0.5, 0, False)))
    with pytest.raises(ConfigError, match=r"MESSAGE\.SIGNAL: Odd cannot be compiled"):
        MessageCodec(message)


@pytest.mark.parametrize("raw", [0, 1, 2, 0xFFFF])
def test_a_range_without_a_single_value_lets_nothing_in(raw: int) -> None:
    codec = MessageCodec(message_of(signal(minimum=0.2, maximum=0.8)))
    with pytest.raises(SignalError, match=r"must be in \[0\.2, 0\.8\]"):
        codec.decode(raw.to_bytes(8, "little"))


def test_a_signal_outside_its_payload_is_refused() -> None:
    message = Message(0x100, "MESSAGE", 1, [Signal("SIGNAL", 4, 8)], strict=False)
    with pytest.raises(ConfigError, match="not in 1 bytes"):
        MessageCodec(message)
