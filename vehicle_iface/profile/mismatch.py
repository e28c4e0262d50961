"""Describe a value that its type does not allow: msgspec's message, and what it leaves out."""

import re
import typing

_PLACEHOLDER = "TODO"
"""What `new-profile` writes where a value is needed."""


def describe_mismatch(message: str, value: object, kind: object, place: str) -> str:
    """Return msgspec's message after its place, with the value or with the allowed words."""
    text, _, inner = message.replace("`", "").replace("-0.0", "0.0").replace(" | null", "").rpartition(" - at ")
    text = re.sub(r"\bobject\b", "table", text)
    text, path = (text, inner.removeprefix("$")) if text else (inner, "")
    if _find(value, path) == _PLACEHOLDER:
        text = f"is still {_PLACEHOLDER}; replace it by {'a number' if 'float' in text else 'its value'}"
    elif text.startswith("Invalid enum value"):
        import difflib  # only where there is a fault: it takes a while

        allowed = [str(word) for word in _words_of(kind)]
        wrong = _find(value, path)
        near = difflib.get_close_matches(wrong, allowed, n=1) if isinstance(wrong, str) else []
        text += f"; must be one of: {', '.join(allowed)}{f'; nearest: {near[0]}' if near else ''}"
    elif ", got " not in text and isinstance(found := _find(value, path), int | float | str):
        text += f", not {found!r}"
    return f"{place}{path}: {text}"


def _words_of(kind: object) -> list[object]:
    """Return all words that the enumerations in a type allow."""
    if typing.get_origin(kind) is typing.Literal:
        return list(typing.get_args(kind))
    return [word for part in typing.get_args(kind) for word in _words_of(part)]


def _find(value: object, path: str) -> object:
    """Return the value at a path such as `[2][0]` below another one; None where the path does not say which it is."""
    for step in re.findall(r"\[(.*?)\]|\.(\w+)", path):
        if isinstance(value, list) and step[0].isdigit():
            value = value[int(step[0])]
        elif isinstance(value, dict) and step[1]:
            value = value.get(step[1])
        else:
            return None
    return value
