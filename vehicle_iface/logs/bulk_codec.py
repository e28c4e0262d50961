"""Decode all payloads of one message at once, with the results of `MessageCodec` row by row, to the last bit."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.codec.cantools_classes import IdentityConversion, Message
from vehicle_iface.codec.layout import Field, Layout
from vehicle_iface.logs.frames import Bools, Bytes

Column = NDArray[Any]
"""float64; int64 where scale and offset are whole, uint64 or (beyond 64 bits) Python's int where int64 has no room."""
_WORD = 64


@dataclass(frozen=True, slots=True)
class Decoded:
    """Decoded payloads."""

    values: Mapping[str, Column]
    shown: Mapping[str, Bools]
    """(n,) Whether a multiplexed signal is present."""
    known: Bools
    """(n,) Whether every multiplexer has a known number. Otherwise `MessageCodec` rejects the frame."""
    out_of_range: Mapping[str, Bools]


class BulkCodec:
    """One message's layout, applied to all its frames at once. `ConfigError` when it cannot be compiled."""

    def __init__(self, message: Message, checked: bool = False) -> None:
        self._layout = Layout.of(message)
        self._checked = checked
        self.names = tuple(field.name for field in self._layout.fields)
        self.length: int = message.length
        """Length of the payload in bytes."""

    def decode(self, data: Bytes) -> Decoded:
        """Decode payloads (n, length or more), longer ones cut as by `MessageCodec(checked=False)`."""
        data = data[:, : self.length]
        words = {is_big: _words(data, is_big) for is_big in {field.is_big for field in self._layout.fields}}
        raw = {field.name: _extracted(field, words[field.is_big]) for field in self._layout.fields}
        with np.errstate(all="ignore"):  # infinities and NaN of float signals are values here
            values = {field.name: _scaled(field, raw[field.name]) for field in self._layout.fields}
        shown, known = self._shown(values, len(data))
        out_of_range: dict[str, Bools] = {}
        for one in self._layout.fields if self._checked else ():
            bad = _out_of_range(one, raw[one.name], values[one.name]) & shown.get(one.name, True)
            if bad.any():
                out_of_range[one.name] = bad
        return Decoded(values, shown, known, out_of_range)

    def _shown(self, values: Mapping[str, Column], count: int) -> tuple[dict[str, Bools], Bools]:
        """Return whether each dependent signal is present, parents first, and whether every multiplexer is known."""
        shown: dict[str, Bools] = {}
        known = np.ones(count, bool)
        waiting = [root for root in self._layout.roots if self._layout.branches.get(root.name)]
        while waiting:
            parent = waiting.pop()
            here = shown.get(parent.name, True)
            numbers, any_branch = _whole(values[parent.name]), np.zeros(count, bool)
            for branch in self._layout.branches[parent.name]:
                hit = np.isin(numbers, branch.ids) & here
                any_branch |= hit
                for child in branch.fields:
                    shown[child.name] = shown.get(child.name, False) | hit
            known &= any_branch | ~np.broadcast_to(here, (count,))
            children = {child.name: child for branch in self._layout.branches[parent.name] for child in branch.fields}
            for child in self._layout.fields:
                if child.parent == parent.name:
                    shown.setdefault(child.name, np.zeros(count, bool))
            waiting += [child for child in children.values() if self._layout.branches.get(child.name)]
        return shown, known


def _words(data: Bytes, is_big: bool) -> NDArray[np.uint64]:
    """Return payloads as rows of 64-bit words, least significant first: big-endian payloads are read from the end."""
    count, length = data.shape
    ordered = data[:, ::-1] if is_big else data
    width = max(1, -(-length // 8)) * 8
    if length == width:
        return np.ascontiguousarray(ordered).view("<u8").astype(np.uint64, copy=False)
    padded = np.zeros((count, width), np.uint8)
    padded[:, :length] = ordered
    return padded.view("<u8").astype(np.uint64, copy=False)


def _extracted(one: Field, words: NDArray[np.uint64]) -> Column:
    """Extract the raw integer of a signal, sign extended, as int64 (uint64 for 64 unsigned bits)."""
    index, shift = divmod(one.shift, _WORD)
    bits = words[:, index]
    if shift + one.width > _WORD:
        bits = bits >> np.uint64(shift) | words[:, index + 1] << np.uint64(_WORD - shift)
        shift = 0
    if one.is_signed:
        lifted = bits << np.uint64(_WORD - shift - one.width)
        return lifted.view(np.int64) >> np.int64(_WORD - one.width)
    if shift:
        bits = bits >> np.uint64(shift)
    if one.width == _WORD:
        return np.ascontiguousarray(bits)
    return (bits & np.uint64((1 << one.width) - 1)).view(np.int64)


def _scaled(one: Field, raw: Column) -> Column:
    """Compute the physical values by the same operations as `MessageCodec`."""
    if one.is_float:
        kind, bits = {16: (np.float16, np.uint16), 32: (np.float32, np.uint32), 64: (np.float64, np.uint64)}[one.width]
        number = raw.astype(bits).view(kind).astype(np.float64)
        return number if one.kind is IdentityConversion else number * float(one.scale) + float(one.offset)
    if one.kind is IdentityConversion:
        return raw
    scale, offset = one.scale, one.offset
    if isinstance(scale, int):
        product = _whole_product(one, raw, scale)
        if isinstance(offset, int):
            return _shifted(one, product, scale, offset)
        return product.astype(np.float64) + offset
    if offset == 0 and scale > 0:
        return raw * scale
    return raw * scale + offset


def _whole_product(one: Field, raw: Column, scale: int) -> Column:
    if _has_room(one.raw_minimum * scale, one.raw_maximum * scale) and raw.dtype == np.int64:
        return raw * scale
    return raw.astype(object) * scale


def _shifted(one: Field, product: Column, scale: int, offset: int) -> Column:
    """Add a whole offset to a whole product, in the narrowest exact type."""
    ends = (one.raw_minimum * scale + offset, one.raw_maximum * scale + offset)
    if product.dtype == np.int64 and _has_room(*ends):
        return product + offset
    exact = product.astype(object) + offset
    if _has_room(*ends):
        return exact.astype(np.int64)
    return exact.astype(np.uint64) if min(ends) >= 0 and max(ends) < 1 << 64 else exact


def _has_room(*numbers: int) -> bool:
    return all(-(1 << 63) <= number < 1 << 63 for number in numbers)


def _whole(values: Column) -> Column:
    """Return a multiplexer's number; one that is not finite, or beyond all ids, matches none."""
    if values.dtype != np.float64:
        return values
    usable = np.isfinite(values) & (np.abs(values) < 1 << 62)
    return np.where(usable, values, -(1 << 62)).astype(np.int64)


def _out_of_range(one: Field, raw: Column, values: Column) -> Bools:
    if one.is_float:
        with np.errstate(invalid="ignore"):
            inside = (values >= one.lowest) & (values <= one.highest)
        bad: Bools = ~(np.isfinite(values) & inside)
        return bad
    low, high, named = one.allowed_raw()
    if named is not None:
        return ~np.isin(raw, np.array(sorted(named), raw.dtype))
    if (low, high) == (one.raw_minimum, one.raw_maximum):
        return np.zeros(len(raw), bool)
    if low > high:
        return np.ones(len(raw), bool)
    outside: Bools = (raw < low) | (raw > high)
    return outside
