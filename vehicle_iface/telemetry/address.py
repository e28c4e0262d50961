"""Paths of telemetry files."""

import contextlib
import os
import re
from pathlib import Path

from vehicle_iface.errors import ConfigError

_MEMORY = Path("/dev/shm")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def telemetry_path(address: str) -> Path:
    """Return the path of `address`: a bare name is a file of this user in memory, anything with a slash is a path.

    Raises `ConfigError` for anything else.
    """
    return paths_of(address)[0]


def paths_of(address: str) -> tuple[Path, ...]:
    """Return the possible paths of `address`, in order of preference: the second is used when memory is full."""
    if "/" in address:
        return (Path(address),)
    if not _NAME.fullmatch(address):
        raise ConfigError(
            f"telemetry address {address!r}: must be a path with a '/', or a name of up to 64 letters, "
            "digits, '_', '.' and '-'"
        )
    folders = telemetry_folders()
    if not folders:
        raise ConfigError(
            f"telemetry address {address!r}: neither {_MEMORY} nor a folder for temporary files is writable"
        )
    return tuple(folder / f"{_prefix()}{address}" for folder in folders)


def telemetry_folders() -> list[Path]:
    """Return the writable folders of named telemetry, in order of preference."""
    import tempfile  # only for a name: it takes a while

    folders = [_MEMORY] if _MEMORY.is_dir() and os.access(_MEMORY, os.W_OK) else []
    with contextlib.suppress(FileNotFoundError):  # this user may have no writable one
        folders.append(Path(tempfile.gettempdir()))
    return folders


def known_addresses() -> list[str]:
    """Return the names whose telemetry files of this user exist, of loops that run or have been killed."""
    found: set[str] = set()
    for folder in telemetry_folders():
        with contextlib.suppress(OSError):
            found |= {path.name.removeprefix(_prefix()) for path in folder.glob(f"{_prefix()}*")}
    return sorted(name for name in found if _NAME.fullmatch(name))


def _prefix() -> str:
    return f"vehicle-iface-{os.getuid()}-"
