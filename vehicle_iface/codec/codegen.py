"""Generates two straight-line Python functions for the layout of a message: `decode(data)` and `encode(values)`.

Names in the generated source: nk and bk are the little- and big-endian words from byte k on. For the signal at position
i, ri is the raw number, vi the value, and wi the raw bits before they are placed. mi is the value of a multiplexer.
"""

import math
import sys
from collections.abc import Callable, Iterator, Sequence

from vehicle_iface.codec.cantools_classes import IdentityConversion, LinearIntegerConversion
from vehicle_iface.codec.layout import Branch, Field, Layout
from vehicle_iface.codec.packing import PackedWord, extract_expression, find_words, struct_format

_INDENT = "    "
_GREATEST_FLOAT = {16: 65504.0, 32: float.fromhex("0x1.fffffep+127"), 64: sys.float_info.max}
"""Largest finite float (IEEE 754) for each width in bits."""


def generate_decode_source(layout: Layout, checked: bool) -> str:
    formats: list[str] = []
    lines = [] if checked else [f"if len(data) > {layout.length}:", f"{_INDENT}data = data[:{layout.length}]"]
    lines += [f"v{field.index} = None" for field in layout.fields if field.parent is not None]
    lines += _decode_level(layout, layout.roots, checked, formats)
    lines.append(f"return ({''.join(_result(field) + ', ' for field in layout.fields)})")
    structs = [f"unpack{number} = Struct({text!r}).unpack" for number, text in enumerate(formats)]
    return "\n".join([*structs, "", _function("decode", "data", lines)])


def _decode_level(layout: Layout, fields: Sequence[Field], checked: bool, formats: list[str]) -> list[str]:
    """Generate the lines that decode the fields of one level and the branches below it; append the formats that
    `struct` needs to `formats`."""
    lines = []
    for is_big in sorted({field.is_big for field in fields}) or [False]:
        ordered = [field for field in fields if field.is_big is is_big]
        found = find_words(ordered, is_big, layout.length)
        targets = "".join(f"{word.name}, " for word in found)
        lines.append(f"{targets}{'= ' if found else ''}unpack{len(formats)}(data)")
        formats.append(struct_format(found, is_big, layout.length))
        for field in ordered:
            lines += _decode_field(field, found, checked)
    for field in fields:
        if layout.branches.get(field.name):
            is_whole = field.kind is IdentityConversion and not field.is_float
            number = _result(field) if is_whole else f"int({_result(field)})"

            def level(branch: Branch) -> list[str]:
                return _decode_level(layout, branch.fields, checked, formats)

            lines += _chain(layout, field, number, level)
    return lines


def _decode_field(field: Field, found: Sequence[PackedWord], checked: bool) -> list[str]:
    raw, value = f"r{field.index}", f"v{field.index}"
    bits = extract_expression(field, found)
    lines = [f"{raw} = {bits}"] if bits != raw else []
    work = _raw_check(field, fail_with=_scaling(field, raw)) if checked and not field.is_float else []
    if _has_own_value(field):
        work.append(f"{value} = {_scaling(field, raw)}")
    if checked and field.is_float:
        work += _float_check(field, value)
    if not field.missing:
        return lines + work
    absent = f"if {raw} in {{{', '.join(map(str, sorted(field.missing)))}}}:"
    return [*lines, absent, f"{_INDENT}{value} = None", "else:", *(_INDENT + line for line in work)]


def _has_own_value(field: Field) -> bool:
    """Whether the value gets a variable of its own, because it can be missing or is checked."""
    return field.parent is not None or field.is_float or bool(field.missing)


def _result(field: Field) -> str:
    if _has_own_value(field):
        return f"v{field.index}"
    return _scaling(field, f"r{field.index}")


def _scaling(field: Field, raw: str) -> str:
    if field.kind is IdentityConversion:
        return raw
    if field.offset == 0 and field.scale > 0 and not field.is_float:
        return f"{field.scale!r} * {raw}"
    return f"{field.scale!r} * {raw} + {field.offset!r}"


def _raw_check(field: Field, fail_with: str) -> list[str]:
    raw = f"r{field.index}"
    low, high, named = field.allowed_raw()
    if named is not None:
        condition = f"{raw} not in {{{', '.join(map(str, sorted(named)))}}}"
    else:
        ends = [f"{raw} > {high}"] if high < field.raw_maximum else []
        ends += [f"{raw} < {low}"] if low > field.raw_minimum else []
        condition = " or ".join(ends)
    return [f"if {condition}:", f"{_INDENT}refuse({field.index}, {fail_with})"] if condition else []


def _float_check(field: Field, value: str) -> list[str]:
    low, high = field.lowest, field.highest
    condition = f"not isfinite({value})"
    if math.isfinite(low) or math.isfinite(high):
        condition += f" or not {_number(low)} <= {value} <= {_number(high)}"
    return [f"if {condition}:", f"{_INDENT}refuse({field.index}, {value})"]


def _number(value: float) -> str:
    return repr(value) if math.isfinite(value) else f"({'-' if value < 0 else ''}inf)"


def _chain(layout: Layout, multiplexer: Field, number: str, level: Callable[[Branch], list[str]]) -> list[str]:
    """Generate if … elif … over the branches of a multiplexer."""
    index = multiplexer.index
    lines = [f"m{index} = {number}"]
    word = "if"
    for branch in layout.branches[multiplexer.name]:
        ids = branch.ids
        condition = f"== {ids[0]}" if len(ids) == 1 else f"in {{{', '.join(map(str, ids))}}}"
        lines.append(f"{word} m{index} {condition}:")
        lines += [_INDENT + line for line in level(branch) or ["pass"]]
        word = "elif"
    return lines if layout.is_partial else [*lines, "else:", f"{_INDENT}unknown({index}, m{index})"]


def generate_encode_source(layout: Layout, checked: bool, base: bytes = b"") -> str:
    """Generate the source of `encode`. `base` contains the bits of all signals that are not in the layout."""
    count = len(layout.fields)
    lines = [f"if len(values) != {count}:", _INDENT + "wrong_count(values)"]
    lines += [f"{''.join(f'v{i}, ' for i in range(count))}= values"] if count else []
    lines += [f"w{field.index} = 0" for field in layout.fields if field.parent is not None]
    lines += _encode_level(layout, layout.roots, checked)
    lines.append(f"return {_assembly(layout, base)}")
    return _function("encode", "values", lines)


def _encode_level(layout: Layout, fields: Sequence[Field], checked: bool) -> list[str]:
    lines = []
    for field in fields:
        lines += _encode_field(field, checked)
    for field in fields:
        if layout.branches.get(field.name):

            def level(branch: Branch, parent: Field = field) -> list[str]:
                inner = _encode_level(layout, branch.fields, checked)
                return inner + (_absent(layout, parent, branch) if checked else [])

            lines += _chain(layout, field, f"int(v{field.index})", level)
    return lines


def _absent(layout: Layout, multiplexer: Field, branch: Branch) -> list[str]:
    """Generate the lines that reject values for signals that this branch does not carry."""
    hidden = [child for child in layout.fields if child.parent == multiplexer.name]
    hidden = [child for child in hidden if child not in branch.fields]
    lines = []
    for field in [deeper for child in hidden for deeper in layout.below(child)]:
        lines += [f"if v{field.index} is not None:", f"{_INDENT}absent({field.index}, v{field.index})"]
    return lines


def _encode_field(field: Field, checked: bool) -> list[str]:
    index = field.index
    raw, value = f"r{index}", f"v{index}"
    lines = _value_check(field, value) if checked else []
    if field.is_float:
        lines += [f"{raw} = {_unscaling(field, value)}"]
        if checked:
            greatest = repr(_GREATEST_FLOAT[field.width])
            lines += [f"if not -{greatest} <= {raw} <= {greatest}:", f"{_INDENT}refuse({index}, {value})"]
        return [*lines, f"w{index} = bits{field.width}({raw})"]
    if field.kind is LinearIntegerConversion:
        difference = f"{value} - {int(field.offset)}" if field.offset else value
        lines += [f"d = {difference}", f"q, m = divmod(d, {int(field.scale)})"]
        lines += [f"{raw} = round(d / {int(field.scale)}) if m else round(q)"]
    else:
        lines += [f"{raw} = round({_unscaling(field, value)})"]
    lines += _fit_check(field, checked)
    if field.parent is not None:
        lines.append(f"w{index} = {_placed_bits(field)}")
    return lines


def _unscaling(field: Field, value: str) -> str:
    if field.kind is IdentityConversion:
        return value
    return f"({value} - {field.offset!r}) / {field.scale!r}" if field.offset else f"{value} / {field.scale!r}"


def _value_check(field: Field, value: str) -> list[str]:
    """Generate the check against the DBC's range. NaN fails both comparisons and is therefore rejected."""
    low, high = field.lowest, field.highest
    if field.is_float:
        return _float_check(field, value)
    if not (math.isfinite(low) or math.isfinite(high)):
        return []
    condition = f"not {_number(low)} <= {value} <= {_number(high)}"
    return [f"if {condition}:", f"{_INDENT}refuse({field.index}, {value})"]


def _fit_check(field: Field, checked: bool) -> list[str]:
    """Generate the check that rejects raw values that exceed the bits or are not named in the VAL_ table."""
    index = field.index
    low, high, named = field.raw_minimum, field.raw_maximum, None
    enumerated = checked and field.enumeration()
    if enumerated:
        low, high, named = field.allowed_raw()
    if named is not None:
        condition = f"r{index} not in {{{', '.join(map(str, sorted(named)))}}}"
    elif checked and not enumerated and _range_implies(field, low, high):
        return []
    else:
        condition = f"not {low} <= r{index} <= {high}"
    if enumerated:  # between two names there is no third
        condition = f"r{index} != v{index} or {condition}"
    return [f"if {condition}:", f"{_INDENT}refuse({index}, v{index})"]


def _range_implies(field: Field, low: int, high: int) -> bool:
    """Whether every value that passed the range check rounds to a raw number from `low` to `high`."""
    if field.scale == 0 or not (math.isfinite(field.lowest) and math.isfinite(field.highest)):
        return False
    ends = [(end - field.offset) / field.scale for end in (field.lowest, field.highest)]
    return all(low - 0.4 < end < high + 0.4 for end in ends)


def _placed_bits(field: Field) -> str:
    return f"r{field.index} & {hex((1 << field.width) - 1)}" if field.is_signed else f"r{field.index}"


def _assembly(layout: Layout, base: bytes) -> str:
    little = _union(field for field in layout.fields if not field.is_big)
    big = _union(field for field in layout.fields if field.is_big)
    if any(base):
        constant = hex(int.from_bytes(base, "big" if big else "little"))
        big, little = (f"{big} | {constant}", little) if big else ("", f"{little} | {constant}" if little else constant)
    size = layout.length
    if not big:
        return f"({little or 0}).to_bytes({size}, 'little')"
    if not little:
        return f"({big}).to_bytes({size}, 'big')"
    return f"({big} | from_bytes(({little}).to_bytes({size}, 'little'), 'big')).to_bytes({size}, 'big')"


def _union(fields: Iterator[Field]) -> str:
    terms = []
    for field in fields:
        plain = field.parent is None and not field.is_float
        bits = f"({_placed_bits(field)})" if plain and field.is_signed else f"r{field.index}"
        bits = bits if plain else f"w{field.index}"
        terms.append(f"{bits} << {field.shift}" if field.shift else bits)
    return " | ".join(terms)


def _function(name: str, argument: str, lines: list[str]) -> str:
    body = "\n".join(2 * _INDENT + line for line in lines)
    return (
        f"def {name}({argument}):\n{_INDENT}try:\n{body}\n"
        f"{_INDENT}except SignalError:\n{2 * _INDENT}raise\n"
        f"{_INDENT}except FOREIGN as error:\n{2 * _INDENT}explain_{name}({argument}, error)"
    )
