"""Paths of telemetry files."""

import contextlib
import os
import re
from pathlib import Path

from vehicle_iface.errors import ConfigError

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
    import tempfile  # only for a name: it takes a while

    memory = Path("/dev/shm")
    folders = [memory] if memory.is_dir() and os.access(memory, os.W_OK) else []
    with contextlib.suppress(FileNotFoundError):  # this user may have no writable one
        folders.append(Path(tempfile.gettempdir()))
    if not folders:
        raise ConfigError(
            f"telemetry address {address!r}: neither {memory} nor a folder for temporary files is writable"
        )
    return tuple(folder / f"vehicle-iface-{os.getuid()}-{address}" for folder in folders)
