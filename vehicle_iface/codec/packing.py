"""Unpacks payloads: the words of 8 to 64 bits that one `struct.unpack` reads, and each signal's bits in them.

A word covers the bytes of signals that share bytes; a word that covers exactly one signal is that signal. Bits and
bytes of both byte orders are counted from the least significant one, as in `Field.shift`.
"""

from collections.abc import Sequence

from vehicle_iface.codec.layout import Field
from vehicle_iface.value import Value

_SIZES = (8, 4, 2, 1)
"""Sizes of words in bytes."""
_INTEGER_CODES = {8: "B", 16: "H", 32: "I", 64: "Q"}
_FLOAT_CODES = {16: "e", 32: "f", 64: "d"}
"""Codes of `struct` for floats, by width in bits."""


class PackedWord(Value, frozen=True):
    """Whole bytes that `struct` reads as one number."""

    name: str
    shift: int
    """The place of the least significant bit in the payload."""
    width: int
    code: str
    """The code of `struct`."""

    @property
    def end(self) -> int:
        return self.shift + self.width

    @property
    def is_signed(self) -> bool:
        return self.code in "bhiq"


def find_words(fields: Sequence[Field], is_big: bool, length: int) -> list[PackedWord]:
    """Return the words that contain the fields of one byte order, in their order in a payload of `length` bytes."""
    found = []
    for first, last in _runs(fields):
        while first < last:
            size = next(size for size in _SIZES if size <= last - first)
            place = length - first - size if is_big else first
            found.append(_pack_word(fields, 8 * first, 8 * size, f"{'b' if is_big else 'n'}{place}"))
            first += size
    return found[::-1] if is_big else found


def _runs(fields: Sequence[Field]) -> list[tuple[int, int]]:
    """Return first byte and end of each group of bytes; bytes are in one group if a signal lies in both."""
    found: list[tuple[int, int]] = []
    for first, last in sorted((field.shift // 8, -(-field.end // 8)) for field in fields):
        if found and first < found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        else:
            found.append((first, last))
    return found


def _pack_word(fields: Sequence[Field], shift: int, width: int, name: str) -> PackedWord:
    end = shift + width
    inside = [field for field in fields if field.shift < end and shift < field.end]
    alone = inside[0] if len(inside) == 1 and (inside[0].shift, inside[0].end) == (shift, end) else None
    code = _INTEGER_CODES[width]
    if alone and alone.is_float:
        code = _FLOAT_CODES[width]
    elif any(field.is_signed and field.end == end for field in inside):
        code = code.lower()
    return PackedWord(f"r{alone.index}" if alone else name, shift, width, code)


def struct_format(found: Sequence[PackedWord], is_big: bool, length: int) -> str:
    """Return the format of `struct` for the words, with padding for the bytes between them."""
    codes, place = "", 0
    for word in found:
        first = length - word.end // 8 if is_big else word.shift // 8
        codes += _padding(first - place) + word.code
        place = first + word.width // 8
    return (">" if is_big else "<") + codes + _padding(length - place)


def _padding(count: int) -> str:
    return f"{count}x" if count > 1 else "x" * count


def extract_expression(field: Field, found: Sequence[PackedWord]) -> str:
    """Return the expression for a field's raw number."""
    of_field = [word for word in found if word.shift < field.end and field.shift < word.end]
    bits = " | ".join(_part(field, word) for word in of_field)
    if field.is_float:
        return bits if of_field[0].code in "efd" else f"float{field.width}({bits})"
    if field.is_signed and all(word.end != field.end for word in of_field):
        half = hex(1 << field.width - 1)
        return f"(({bits}) ^ {half}) - {half}"
    return bits


def _part(field: Field, word: PackedWord) -> str:
    """Return the expression for the field's bits in one word, at their place in the field. It includes the sign if both
    end together."""
    low, high = max(field.shift, word.shift), min(field.end, word.end)
    part = f"{word.name} >> {low - word.shift}" if low > word.shift else word.name
    has_sign = field.is_signed and field.end == word.end
    if high < word.end or (word.is_signed and not has_sign):
        part = f"{part} & {hex((1 << high - low) - 1)}"
    if low > field.shift:
        part = f"({part}) << {low - field.shift}" if part != word.name else f"{part} << {low - field.shift}"
    return part
