"""What a result is about: the device's version and files, and the bench's own."""

import hashlib
import importlib.util
import shlex
import subprocess
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import msgspec

from hil_bench.device import OWN_VERSION, Commands
from hil_bench.places import CHECKOUT, PACKAGE

ANSWER_S = 20.0
"""A device that takes longer to print its version has none."""


class Device(msgspec.Struct, frozen=True, kw_only=True):
    """The device under test, as far as it can be identified."""

    command: str
    version: str
    """First line of what the version's command prints; empty if there is none."""
    hash: str
    """SHA-256 of the files that its command names; empty if it names none on this computer."""


def identify_device(commands: Commands, version_command: str | None = None) -> Device:
    """`version_command` prints the device's version; None: the program's own, if that is the device."""
    is_own = commands.start == Commands().start
    ask = (OWN_VERSION if is_own else "") if version_command is None else version_command
    return Device(
        command=commands.start or "already running, not started by the bench",
        version=_first_line(ask),
        hash=hash_files(_files_of(commands.start)) if commands.is_ours else "",
    )


def hash_bench() -> str:
    """SHA-256 of the bench's own modules."""
    return hash_files([PACKAGE])


def hash_files(paths: Iterable[Path]) -> str:
    """SHA-256 of the names and contents of files, and of all files in folders; empty if there are none."""
    files = [(path, path.name) for path in paths if path.is_file()]
    for folder in (path for path in paths if path.is_dir()):
        inside = sorted(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
        files += [(path, path.relative_to(folder.parent).as_posix()) for path in inside]
    digest = hashlib.sha256()
    for path, name in files:
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest() if files else ""


def _files_of(template: str) -> list[Path]:
    """The files and Python packages that a command line names; the program itself if it names no other."""
    words = shlex.split(template)
    modules = [_find_package(name) for flag, name in pairwise(words) if flag == "-m"]
    named = [path for word in words[1:] if (path := _absolute(word)).is_file()]
    found = [path for path in (*modules, *named) if path is not None]
    return found or [path for word in words[:1] if (path := _absolute(word)).is_file()]


def _absolute(word: str) -> Path:
    return (CHECKOUT or Path()) / word


def _find_package(name: str) -> Path | None:
    """Folder or file of a Python package; it is not imported."""
    if CHECKOUT is not None and (CHECKOUT / name).is_dir():
        return CHECKOUT / name
    try:
        found = importlib.util.find_spec(name.partition(".")[0])
    except (ImportError, ValueError):
        return None
    if found is None or found.origin is None:
        return None
    origin = Path(found.origin)
    return origin.parent if origin.name == "__init__.py" else origin


def _first_line(command: str) -> str:
    if not command:
        return ""
    try:
        done = subprocess.run(
            shlex.split(command), capture_output=True, text=True, errors="replace", timeout=ANSWER_S, cwd=CHECKOUT,
            check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired, ValueError):
        return ""
    return next(iter((done.stdout or done.stderr).splitlines()), "")
