"""Splits the text of a DBC into statements. A damaged statement ends where the next one begins."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from vehicle_iface.errors import ConfigError
from vehicle_iface.value import Value

STRING = r'"(?:[^"\\]|\\.)*+"'
"""A string literal; `\\"` inside is a quotation mark."""
_LINE_STRING = r'"(?:[^"\\\n]|\\.)*+"'
KEYWORDS = (
    "VERSION", "NS_DESC_", "NS_", "BS_", "BU_SG_REL_", "BU_EV_REL_", "BU_BO_REL_", "BU_", "BO_TX_BU_", "BO_",
    "SG_MUL_VAL_", "SG_", "EV_DATA_", "ENVVAR_DATA_", "EV_", "CM_", "BA_DEF_DEF_REL_", "BA_DEF_REL_", "BA_REL_",
    "BA_DEF_DEF_", "BA_DEF_SGTYPE_", "BA_SGTYPE_", "BA_DEF_", "BA_", "CAT_DEF_", "CAT_", "FILTER", "VAL_TABLE_",
    "VAL_", "SIG_VALTYPE_", "SIG_TYPE_REF_", "SIG_GROUP_", "SIGTYPE_VALTYPE_", "SGTYPE_VAL_", "SGTYPE_",
)  # fmt: skip
_LINE_KEYWORDS = frozenset({"VERSION", "NS_", "BS_", "BU_", "BO_", "SG_"})
"""Keywords of statements that end with their line; all others end with a semicolon."""
_KEYWORD = rf"(?:{'|'.join(KEYWORDS)})(?!\w)"
_BEGIN = re.compile(rf"({_KEYWORD})")
_NEXT = rf"^[ \t]*(?={_KEYWORD})"
_BLANK = re.compile(r"(?:\s+|//[^\n]*)*+")
_COMMENT_MARK = r"/(?!/)"
_LINE_BODY = re.compile(rf'((?:[^"\n/,]+|{_LINE_STRING}|{_COMMENT_MARK}|,(?:[ \t]*\n)?)*+)(?:\n|(?=//)|\Z)')
_BODY = re.compile(
    rf'((?:[^;"\n/]+|{_LINE_STRING}|{_COMMENT_MARK}|//[^\n]*|\n(?![ \t]*{_KEYWORD}))*+)(?:(;)|(?=\n)|\Z)'
)
_COMMENT_BODY = re.compile(rf'([^;"\n]*{STRING})\s*?(?:(;)|(?=\n[ \t]*{_KEYWORD})|\Z)', re.DOTALL)
_QUOTING_COMMENT = r'(CM_[^"\n]*)"(.*)"\s*;[ \t]*$'
"""A comment in one line that contains unescaped quotation marks. This pattern and `_NEXT` are compiled when a damaged
statement needs them, for that takes a while."""


class Statement(Value, frozen=True):
    """One statement, or a piece of text that is not a statement."""

    keyword: str
    """The keyword at the beginning; empty if there is none."""
    body: str
    """The text after the keyword, without the semicolon."""
    line: int
    is_whole: bool
    """False for text that is not a statement, and for a statement without its semicolon."""
    may_be_cut: bool
    """Whether the file ends with this statement before its proper end. If it cannot be parsed, the file is cut short.
    """


def read_text(path: Path) -> str:
    """Read a file as UTF-8 or, as DBC tools write it, Windows code page 1252."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    if 0 in data:
        line = data[: data.index(0)].count(b"\n") + 1
        raise ConfigError(f"{path.name}:{line}: a NUL byte: not a DBC, or in UTF-16")
    data = data.replace(b"\r\n", b"\n")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        return data.decode("cp1252")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        text = f"byte {data[error.start]:#04x} is neither UTF-8 nor code page 1252"
        raise ConfigError(f"{path.name}:{line}: {text}") from None


def split_statements(name: str, text: str) -> Iterator[Statement]:
    """Yield all statements in order, without the list of keywords below NS_.

    Raises `ConfigError` if the last one has no end: the file is cut short, and more may be missing.
    """
    last, has_line_end = len(text.rstrip()), text.endswith("\n")
    position, line, counted, in_keyword_list = 0, 1, 0, False
    while True:
        blank = _BLANK.match(text, position)
        position = blank.end() if blank else position
        line += text.count("\n", counted, position)
        counted = position
        if position == len(text):
            return
        found = _match_statement(text, position)
        is_ended = has_line_end if found.keyword in _LINE_KEYWORDS else found.is_whole
        if found.end >= last and not found.is_whole and not has_line_end:
            raise cut_short(name, line)
        in_keyword_list = found.keyword == "NS_" or (in_keyword_list and found.keyword not in ("BS_", "BU_", "BO_"))
        if not in_keyword_list:
            yield Statement(found.keyword, found.body, line, found.is_whole, found.end >= last and not is_ended)
        position = found.end


def cut_short(name: str, line: int) -> ConfigError:
    """Build the error about a file that ends in the middle of a statement."""
    return ConfigError(f"{name}:{line}: the file ends in the middle of this statement; it is cut short")


class _Match(NamedTuple):
    keyword: str
    body: str
    end: int
    is_whole: bool


def _match_statement(text: str, position: int) -> _Match:
    """Match the statement at a position. A damaged one extends to the next line that begins with a keyword."""
    begin = _BEGIN.match(text, position)
    keyword = begin[1] if begin else ""
    start = begin.end() if begin else position
    pattern = _LINE_BODY if keyword in _LINE_KEYWORDS else _COMMENT_BODY if keyword == "CM_" else _BODY
    if begin and (found := pattern.match(text, start)):
        return _Match(keyword, found[1].strip(), found.end(), keyword in _LINE_KEYWORDS or found[2] is not None)
    if begin and (quoting := re.compile(_QUOTING_COMMENT, re.MULTILINE).match(text, position)):
        inside = quoting[2].replace("\\", "/").replace('"', '\\"')
        return _Match(keyword, f'{quoting[1].removeprefix("CM_")}"{inside}"'.strip(), quoting.end(), True)
    following = re.compile(_NEXT, re.MULTILINE).search(text, position + 1)
    end = following.start() if following else len(text)
    return _Match(keyword, text[start:end].strip(), end, False)
