"""The lines of one field: its signal with the reason, further candidates, or what is missing."""

from collections.abc import Container, Iterator, Mapping, Sequence

from vehicle_iface.codec.quantities import unit_of_field
from vehicle_iface.drafting.draft import Draft, FieldDraft, FieldValue
from vehicle_iface.drafting.rules import FieldRule, Kind, Section
from vehicle_iface.drafting.scoring import Candidate
from vehicle_iface.profile.forms import FieldForm

_COLUMN, _LONG = 56, 84
_MOST_NAMED = 4
_SPOKEN = {"lat": "lateral", "long": "longitudinal", "accel": "acceleration"}


def write_fields(
    draft: Draft, section: Section, needed: Mapping[str, str], unused: Container[str], keys: Sequence[str] = ()
) -> Iterator[str]:
    """Write all fields of a section, except those in `unused` without a candidate.

    `needed` are fields that the profile must have, with what they stand for. Fields that are not in `keys`, where
    there are such, are written as comments: this version of the program does not have them.
    """
    for (own, name), field in draft.fields.items():
        if own != section:
            continue
        if field.value is not None:
            yield from _write_bound(field, is_key=not keys or name in keys)
        elif field.is_question:
            yield align(f"# {name} = …", f"TODO {field.remark}:")
        elif field.others:
            yield align(f"# {name} = {quote(field.others[0].signal.dotted)}", f"not bound: {field.remark}")
            continue
        elif name in needed:
            yield align(f"# missing: {name}", f"TODO needed: {needed[name]}")
        elif name not in unused:
            yield align(f"# missing: {name}", f"optional: {describe_wanted(field.rule)}")
        yield from (align(f"#   or {quote(one.signal.dotted)}", _describe([one])) for one in field.others)


def _write_bound(field: FieldDraft, *, is_key: bool) -> Iterator[str]:
    key = f"{'' if is_key else '# '}{field.rule.field} = {format_value(field.value or '')}"
    remark = f"; {field.remark}" if field.remark else ""
    yield align(key, f"{_describe(field.chosen)}{remark}")


def _describe(found: Sequence[Candidate]) -> str:
    lines = ", ".join(str(one.signal.line) for one in found)
    return f"line{'s' * (len(found) > 1)} {lines}: {', '.join(found[0].reasons)}"


def describe_wanted(rule: FieldRule) -> str:
    """Describe the kind of signal that the field needs."""
    unit = unit_of_field(rule.field)
    kinds = {
        Kind.NUMBER: f"a number in {unit.name if unit else '?'}",
        Kind.SHARE: "a pedal's value",
        Kind.FLAG: "a flag",
        Kind.NAMES: "an enumeration",
        Kind.CODE: "a whole number",
    }
    example = max(rule.phrases, key=lambda phrase: phrase.weight).text
    spoken = " ".join(_SPOKEN.get(word, word) for word in example.split())
    return f'{kinds[rule.kind]}, named like "{spoken}"'


def align(text: str, comment: str, column: int = _COLUMN) -> str:
    """Return a line with a comment after it, or above it where it is long."""
    return f"{text.ljust(column)} # {comment}" if len(text) <= _LONG else f"# {comment}\n{text}"


def name_some(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def format_value(value: FieldValue) -> str:
    """Format a binding as TOML."""
    if isinstance(value, FieldForm):
        return f"{{ mean = {format_value(value.mean or ())} }}"
    if isinstance(value, str):
        return quote(value)
    return "[" + ", ".join(map(quote, value)) + "]"


def quote(text: str) -> str:
    """Format a string as TOML."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
