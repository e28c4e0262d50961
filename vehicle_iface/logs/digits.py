"""Digits in a log's text to numbers, two characters at a time, for many lines at once.

Each function takes the text and where the digits of each line begin (and stop), and gives the numbers and whether
they are good: those of other lines mean nothing.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vehicle_iface.logs.frames import EXTENDED, GREATEST_STAMP_S, LAST_ID, LAST_STANDARD_ID, Bools, Bytes, Ints
from vehicle_iface.units import NS_PER_S

_DOT, _ZERO, _LETTER_A = b".0a"


def group_by_value(values: Ints) -> list[tuple[int, NDArray[np.intp] | slice]]:
    """Return each distinct value and its indices."""
    if not len(values):
        return []
    low, high = int(values.min()), int(values.max())
    if low == high:
        return [(low, slice(None))]
    present = np.flatnonzero(np.bincount(values - low)) + low
    return [(int(value), np.flatnonzero(values == value)) for value in present]


def group_by_text(text: Bytes, firsts: Ints, stops: Ints) -> list[tuple[str, NDArray[np.intp] | slice]]:
    """Return each distinct word and its indices; word `i` is the text from `firsts[i]` to `stops[i]`."""
    found: list[tuple[str, NDArray[np.intp] | slice]] = []
    for width, group in group_by_value(stops - firsts):
        words = sliding_window_view(text, width)[firsts[group]]
        if _whole_rows(words == words[0]).all():
            found.append((_decoded(words[0]), group))
            continue
        index = np.arange(len(firsts))[group]
        each, which = np.unique(words.view(f"V{width}")[:, 0], return_inverse=True)
        found += [(_decoded(word), index[which == number]) for number, word in enumerate(each)]
    return found


def _decoded(word: Bytes | np.void) -> str:
    return word.tobytes().decode("utf-8", "backslashreplace")


def parse_stamps_ns(text: Bytes, begins: Ints, stops: Ints) -> tuple[Ints, Bools]:
    """Parse stamps with 6 or 9 digits after the point; return their values and whether they are valid."""
    stamps_ns, good = np.zeros(len(begins), np.int64), np.zeros(len(begins), bool)
    for width, group in group_by_value(stops - begins):
        firsts = begins[group]
        for digits in (6, 9):
            whole = width - digits - 1
            if not 1 <= whole <= 10:
                continue
            seconds, good_seconds = _parse_decimal(text, firsts, whole)
            fraction, good_fraction = _parse_decimal(text, firsts + whole + 1, digits)
            fits = good_seconds & good_fraction & (text[firsts + whole] == _DOT) & (seconds <= GREATEST_STAMP_S)
            if fits.any():
                found = seconds * NS_PER_S + fraction * 10 ** (9 - digits)
                stamps_ns[group] = np.where(fits, found, stamps_ns[group])
                good[group] |= fits
            if fits.all():
                break
    return stamps_ns, good


def parse_keys(text: Bytes, firsts: Ints, stops: Ints) -> tuple[Ints, Bools]:
    """Parse identifiers of 3 digits, or 8 for extended ones; return their values and whether they are valid."""
    keys, good = np.zeros(len(firsts), np.int64), np.zeros(len(firsts), bool)
    for width, group in group_by_value(stops - firsts):
        if width not in (3, 8):
            continue
        content, fits = parse_hexadecimal(text, firsts[group], width)
        number = np.zeros(len(content), np.int64)
        for place in range(content.shape[1]):
            number = number << 8 | content[:, place]
        keys[group] = number | EXTENDED if width == 8 else number
        good[group] = fits & (number <= (LAST_ID if width == 8 else LAST_STANDARD_ID))
    return keys, good


def _windows(text: Bytes, firsts: Ints, width: int) -> Bytes:
    """`width` characters from each of `firsts` on, one more in front when that is odd: then it is 0."""
    odd = width % 2
    characters = sliding_window_view(text, width + odd)[firsts - odd]
    if odd:
        characters[:, 0] = _ZERO
    return characters


def _parse_decimal(text: Bytes, firsts: Ints, width: int) -> tuple[Ints, Bools]:
    """Parse numbers of `width` digits; return their values and whether all characters are digits."""
    digits = _windows(text, firsts, width) - np.uint8(_ZERO)
    good = _whole_rows(digits <= 9)
    pairs = digits.view("<u2")
    values = (pairs & 0xFF) * np.uint16(10) + (pairs >> 8)
    number = values[:, 0].astype(np.int64)
    for place in range(1, values.shape[1]):
        number = number * 100 + values[:, place]
    return number, good


def parse_hexadecimal(text: Bytes, firsts: Ints, width: int) -> tuple[Bytes, Bools]:
    """Parse bytes of two digits, (n, width / 2) rounded up; return them and whether all characters are digits."""
    if not width:
        return np.zeros((len(firsts), 0), np.uint8), np.ones(len(firsts), bool)
    characters = _windows(text, firsts, width)
    good = _whole_rows(are_hexadecimal(characters))
    nibbles = (characters & 0x0F) + np.uint8(9) * (characters >> 6)
    pairs = nibbles.view("<u2")
    return (pairs << 4 | pairs >> 8).astype(np.uint8), good


def are_hexadecimal(characters: Bytes) -> Bools:
    """Differences wrap round, so that one comparison has both ends."""
    found: Bools = (characters - np.uint8(_ZERO) <= 9) | ((characters | 0x20) - np.uint8(_LETTER_A) <= 5)
    return found


def _whole_rows(good: Bools) -> Bools:
    if good.all():
        return np.ones(len(good), bool)
    whole: Bools = np.logical_and.reduce(good, axis=1)
    return whole
