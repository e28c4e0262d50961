"""Text for the page: escaped, of bounded length, in one line."""

from __future__ import annotations

import html
from enum import IntEnum

_MAX_TEXT = 160
MAX_SHOWN = 1e12
"""A number that is not smaller is not shown."""


def plain(value: object) -> str:
    """Escape `value` as text without markup, of bounded length, in one line."""
    text = str(value)
    text = text if len(text) <= _MAX_TEXT else text[: _MAX_TEXT - 1] + "…"
    return html.escape("".join(c if c.isprintable() else "�" for c in text), quote=True)


def enum_name(kind: type[IntEnum], value: int) -> str:
    """Return the name of a code; its kind and number where this version does not know it."""
    try:
        return str(kind(value).name)
    except ValueError:
        return f"{kind.__name__} {value}"


def css(color: tuple[int, int, int]) -> str:
    """Return a colour as CSS writes it."""
    return "rgb({},{},{})".format(*color)
