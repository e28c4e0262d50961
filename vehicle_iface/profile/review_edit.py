"""Write the record of a review into the text of a profile; every other line stays as it is."""

import json
import os
import re
import tempfile
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile.load import is_packaged
from vehicle_iface.profile.review_record import RECORD_KEYS, ReviewRecord

_HEADER = re.compile(r"\s*\[")
_OWN_HEADER = re.compile(r"\s*\[\s*review\s*\]\s*(#.*)?$")
_KEY = re.compile(r"(\s*reviewed\s*=\s*)(true|false)\b")
_PLACES = (re.compile(r"\s*dbc\s*="), re.compile(r"\s*name\s*="))
"""Keys after which a missing `reviewed` is inserted: after the first that is present."""


def require_editable(path: Path) -> None:
    """Raise `ConfigError` with a remedy for a profile of the package, or a read-only file or folder."""
    copy = f"copy it and its DBC to a folder of your own, and give --profile {path.name} there"
    if is_packaged(path):
        raise ConfigError(f"{path}: is part of vehicle-iface and not written; {copy}")
    if not os.access(path, os.W_OK) or not os.access(path.parent, os.W_OK):
        raise ConfigError(f"{path}: may not be written; {copy}, or make file and folder writable")


def write_review(path: Path, record: ReviewRecord) -> None:
    """Set `reviewed = true` and the table `[review]` in a profile's file; `ConfigError` when that cannot be done."""
    require_editable(path)
    try:
        with open(path, encoding="utf-8", newline="") as file:
            text = file.read()
        _replace_file(path, insert_review(text, record))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None
    except ValueError as error:
        lines = "\n".join(["reviewed = true", *_write_table(record)])
        raise ConfigError(f"{path}: {error}; nothing was written. Write it by hand:\n{lines}") from None


def insert_review(text: str, record: ReviewRecord) -> str:
    """Insert the record into the text of a profile; `ValueError` where its layout makes this uncertain."""
    end = "\r\n" if "\r\n" in text else "\n"
    lines = _drop_table(text.split(end))
    first = next((number for number, line in enumerate(lines) if _HEADER.match(line)), len(lines))
    _set_reviewed(lines, first)
    while lines and not lines[-1].strip():
        lines.pop()
    edited = end.join([*lines, "", *_write_table(record), ""])
    if not _differs_only_by_record(text, edited, record):
        raise ValueError("where reviewed and [review] belong is not certain from the layout of this file")
    return edited


def _differs_only_by_record(text: str, edited: str, record: ReviewRecord) -> bool:
    try:
        old, new = tomllib.loads(text), tomllib.loads(edited)
        written = msgspec.convert(new.pop("review", None), ReviewRecord)
    except (tomllib.TOMLDecodeError, msgspec.ValidationError):
        return False
    is_reviewed = new.pop("reviewed", False)
    for key in RECORD_KEYS:
        old.pop(key, None)
    return is_reviewed is True and written == record and new == old


def _set_reviewed(lines: list[str], first: int) -> None:
    """Set the key among the lines before number `first`, that of the first table."""
    for number in range(first):
        if _KEY.match(lines[number]):
            lines[number] = _KEY.sub(r"\g<1>true", lines[number], count=1)
            return
    for place in _PLACES:
        for number in range(first):
            if place.match(lines[number]):
                lines.insert(number + 1, "reviewed = true")
                return
    lines.insert(0, "reviewed = true")


def _drop_table(lines: Sequence[str]) -> list[str]:
    """Remove an earlier `[review]`: its header, its keys, and blank lines before it."""
    begin = next((number for number, line in enumerate(lines) if _OWN_HEADER.match(line)), None)
    if begin is None:
        return list(lines)
    end = next((n for n, line in enumerate(lines) if n > begin and _HEADER.match(line)), len(lines))
    while end > begin + 1 and lines[end - 1].lstrip().startswith("#"):
        end -= 1  # a comment above the next table is that table's
    while begin and not lines[begin - 1].strip():
        begin -= 1
    return [*lines[:begin], *([""] if end < len(lines) else []), *lines[end:]]


def _write_table(record: ReviewRecord) -> list[str]:
    checks = ", ".join(_quote(check) for check in record.checks)
    has_checksums = record.checksums_sha256 is not None
    return [
        "[review]                       # written by vehicle-iface commission",
        f"date = {record.date.isoformat()}",
        f"checks = [{checks}]",
        f"log = {_quote(record.log)}",
        f'log_sha256 = "{record.log_sha256}"',
        f'profile_sha256 = "{record.profile_sha256}"',
        f'dbc_sha256 = "{record.dbc_sha256}"',
        *([f'checksums_sha256 = "{record.checksums_sha256}"'] if has_checksums else []),
    ]


def _quote(text: str) -> str:
    """Return a basic string of TOML, whose escapes are those of JSON."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")


def _replace_file(path: Path, text: str) -> None:
    """Replace the file atomically; it keeps its permissions."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with open(handle, "w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, path.stat().st_mode & 0o7777)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
