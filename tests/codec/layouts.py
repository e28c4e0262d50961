"""Messages of random layout for property tests, and random values for them."""

from collections import OrderedDict
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from cantools.database import Message, Signal
from cantools.database.conversion import BaseConversion
from cantools.database.namedsignalvalue import NamedSignalValue
from cantools.typechecking import SignalDictType
from hypothesis import strategies as st

SCALES = st.sampled_from([1, 2, 10, 0.1, 0.5, 0.001, 0.005, 1e-4, -1, -0.25, 3, 1.0, 4.0, 1e6])
OFFSETS = st.sampled_from([0, 0.0, 1, -40, 0.5, -273.15, 1000, -0.001])
FD_LENGTHS = st.sampled_from([0, 1, 2, 3, 5, 8, 8, 8, 12, 16, 24, 64])


def network_start(position: int) -> int:
    """A bit counted from the first byte's most significant one, in the DBC's big-endian numbering."""
    return 8 * (position // 8) + 7 - position % 8


@st.composite
def signals(
    draw: st.DrawFn, /, name: str, position: int, width: int, big: bool, *, bounded: bool = False, **multiplexing: Any
) -> Signal:
    """A signal on `width` bits from `position`, counted in the direction of its byte order."""
    is_float = width in (16, 32, 64) and draw(st.booleans()) and not multiplexing.get("is_multiplexer")
    choices: OrderedDict[int, str | NamedSignalValue] | None = None
    if width <= 8 and draw(st.integers(0, 3)) == 0:
        numbers = draw(st.sets(st.integers(0, 2**width - 1), min_size=1, max_size=6))
        choices = OrderedDict((number, f"NAME_{number}") for number in sorted(numbers))
    scaled = not multiplexing.get("is_multiplexer")
    conversion = BaseConversion.factory(
        scale=draw(SCALES) if scaled else 1,
        offset=draw(OFFSETS) if scaled else 0,
        choices=choices,
        is_float=is_float,
    )
    minimum = maximum = None
    if bounded and draw(st.booleans()):
        first, second = draw(st.floats(-1e4, 1e4)), draw(st.floats(-1e4, 1e4))
        minimum, maximum = min(first, second), max(first, second)
    return Signal(
        name,
        network_start(position) if big else position,
        width,
        "big_endian" if big else "little_endian",
        is_signed=draw(st.booleans()) and not multiplexing.get("is_multiplexer"),
        conversion=conversion,
        minimum=minimum,
        maximum=maximum,
        **multiplexing,
    )


@st.composite
def runs(draw: st.DrawFn, /, bits: int) -> list[tuple[int, int]]:
    """Widths and positions of signals without overlap in `bits` bits: [(position, width), …]."""
    found: list[tuple[int, int]] = []
    position = 0
    while position < bits:
        position += draw(st.sampled_from([0, -position % 8, 1, 3]))
        width = draw(st.sampled_from([1, 2, 3, 4, 7, 8, 8, 11, 12, 16, 16, 24, 32, 32, 47, 64]))
        if position + width <= bits:
            found.append((position, width))
        position += width
    return found


@st.composite
def plain_messages(draw: st.DrawFn, /, **options: bool) -> Message:
    """A message of one or both byte orders, its signals anywhere.

    Every byte-aligned region has one byte order, so that the two numberings cannot collide."""
    length = draw(FD_LENGTHS)
    ends = [0, *sorted(draw(st.lists(st.integers(0, length), max_size=3))), length]
    found: list[Signal] = []
    for first, end in pairwise(ends):
        big = draw(st.booleans())
        for position, width in draw(runs(8 * (end - first))):
            name = f"S{len(found)}"
            found.append(draw(signals(name, 8 * first + position, width, big, **options)))
    return Message(0x100, "RANDOM", length, found, strict=True, is_fd=length > 8)


@st.composite
def multiplexed_messages(draw: st.DrawFn, /, **options: bool) -> Message:
    """A message with a multiplexer in byte 0, another one inside some of its branches, and shared signals."""
    length = draw(st.sampled_from([4, 8, 16]))
    big = draw(st.booleans())
    found = [Signal("OUTER", 7 if big else 0, 8, "big_endian" if big else "little_endian", is_multiplexer=True)]
    ids = sorted(draw(st.sets(st.integers(0, 255), min_size=1, max_size=5)))
    groups = draw(st.lists(st.sampled_from(ids), min_size=1, max_size=2, unique=True))
    nested = draw(st.booleans())
    rest = [number for number in ids if number not in groups] if nested else []
    for position, width in draw(runs(8 * (length - 1))):
        name = f"A{position}"
        under: dict[str, Any] = {"multiplexer_ids": groups, "multiplexer_signal": "OUTER"}
        found.append(draw(signals(name, 8 + position, width, big, **options, **under)))
    if rest:
        found.append(Signal("INNER", 8, 4, is_multiplexer=True, multiplexer_ids=rest, multiplexer_signal="OUTER"))
        for inner in draw(st.sets(st.integers(0, 15), min_size=1, max_size=3)):
            under = {"multiplexer_ids": [inner], "multiplexer_signal": "INNER"}
            for position, width in draw(runs(8 * (length - 2))):
                name = f"B{inner}_{position}"
                found.append(draw(signals(name, 16 + position, width, False, **options, **under)))
    return Message(0x100, "RANDOM", length, found, strict=True, is_fd=length > 8)


def messages(**options: bool) -> st.SearchStrategy[Message]:
    """Any of them."""
    return st.one_of(plain_messages(**options), multiplexed_messages(**options))


def decoded(message: Message, payload: bytes) -> SignalDictType:
    """What cantools reads in the payload of a message that is no container."""
    theirs = message.decode(payload, decode_choices=False)
    assert isinstance(theirs, dict)
    return theirs


def as_tuple(names: tuple[str, ...], decoded: Mapping[str, object]) -> tuple[object, ...]:
    """cantools' dictionary in the order of the codec's values."""
    return tuple(decoded.get(name) for name in names)
