"""The record of a review in a profile, `[review]`: what was checked, when, and hashes of the files at that time."""

import tomllib
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Annotated

import msgspec

from vehicle_iface.errors import ConfigError

Sha256 = Annotated[str, msgspec.Meta(min_length=64, max_length=64)]
"""A SHA-256 in hexadecimal digits."""
RECORD_KEYS = ("reviewed", "review")
"""The keys of a profile that a review writes."""


class ReviewRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Record that `vehicle-iface commission` writes after a complete walk."""

    date: date
    checks: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    """Steps that the person in the vehicle was asked for and that were observed."""
    log: str
    """Name of the log of the walk."""
    log_sha256: Sha256
    profile_sha256: Sha256
    """Hash of the profile's values without `reviewed` and `[review]`; comments and layout do not count."""
    dbc_sha256: Sha256
    """Hash of the DBC's bytes; of several DBCs, that of their SHA-256 in the order of their buses."""
    checksums_sha256: Sha256 | None = None
    """Hash of the Python files with checksums, like `dbc_sha256`; None where the profile names no such file."""


def hash_file(path: Path) -> str:
    """Compute the SHA-256 of a file's bytes; `ConfigError` when it cannot be read."""
    try:
        return _sha256(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def hash_values(text: str) -> str:
    """Compute the SHA-256 of a profile's values without its record; comments and layout do not count."""
    import json  # only for a record: it takes a while

    document = {key: value for key, value in tomllib.loads(text).items() if key not in RECORD_KEYS}
    return _sha256(json.dumps(document, sort_keys=True, default=str).encode())


def hash_files(paths: Sequence[Path]) -> str:
    """Compute the SHA-256 of a file, or of the SHA-256 of several; `ConfigError` when one cannot be read."""
    hashes = [hash_file(path) for path in paths]
    return hashes[0] if len(hashes) == 1 else _sha256("".join(hashes).encode())


def hash_checksums(paths: Sequence[Path]) -> str | None:
    """Compute the SHA-256 of a profile's Python files with checksums; None where there are none."""
    return hash_files(paths) if paths else None


def find_changes(record: ReviewRecord, *, profile: Path, dbcs: Sequence[Path], checksums: Sequence[Path]) -> list[str]:
    """Return the files that have changed since the review, or that its record does not cover."""
    try:
        is_same = hash_values(profile.read_text(encoding="utf-8")) == record.profile_sha256
    except OSError as error:
        raise ConfigError(f"{profile}: cannot be read: {error.strerror}") from None
    changed = [] if is_same else [profile.name]
    if hash_files(dbcs) != record.dbc_sha256:
        changed.append("/".join(path.name for path in dbcs))
    if checksums and hash_checksums(checksums) != record.checksums_sha256:
        changed.append("/".join(path.name for path in checksums))
    return changed


def _sha256(content: bytes) -> str:
    import hashlib  # only for a record: it takes a while

    return hashlib.sha256(content).hexdigest()
