"""Create the folder of a recording. Nothing is overwritten, and a full disk is detected before the drive."""

import contextlib
import errno
import hashlib
import os
import platform
import shutil
from importlib import metadata
from pathlib import Path

import msgspec

from vehicle_iface import clock
from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder.files import FORMAT, INPUT_FILES, META, PROFILE, Meta, RunOptions
from vehicle_iface.telemetry import SessionInfo

_REMEDIES = {
    errno.ENOSPC: "make room there (`df -h {0}`), or choose a folder on another disk",
    errno.EDQUOT: "make room there (`quota`), or choose a folder on another disk",
    errno.EROFS: "`mount -o remount,rw` what it is on, or choose a folder on another disk",
}
_REMEDY = "choose a folder that this user may write to"
_PACKAGES = ("vehicle-iface", "numpy", "cantools", "msgspec")


class RecordingRequest(msgspec.Struct, kw_only=True, frozen=True):
    """What to record, and where."""

    folder: str
    """Of the recording; empty for black boxes only."""
    telemetry: str
    channels: list[str]
    """The SocketCAN interface of each bus; none where the bus has no frames on a socket."""
    profile: str
    """The profile's file."""
    named_files: list[str]
    """The DBCs and Python files that the profile names."""
    command_line: list[str]
    run: RunOptions | None = None
    input_files: list[str] = []
    """The files of trajectory and controller."""
    black_box: str = ""
    """The folder of the black boxes; empty for none."""
    inputs_fd: int = -1
    """Where the loop's inputs come from: a descriptor of the recorder's process; −1: none are recorded."""


def not_writable_error(folder: Path, error: OSError) -> ConfigError:
    """Return the error of a folder that cannot be written, with a remedy."""
    remedy = _REMEDIES.get(error.errno or 0, _REMEDY).format(folder)
    return ConfigError(f"--record {folder}: cannot be written: {error.strerror or error}; {remedy}")


def create_folder(request: RecordingRequest, info: SessionInfo) -> Path:
    """Create the folder with `meta.json` and the profile; `OSError`, or `ConfigError` when it is not empty."""
    folder = Path(request.folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"--record {folder}: is not an empty folder; nothing is overwritten: choose another name")
    folder.mkdir(parents=True, exist_ok=True)
    copies = folder / PROFILE
    copies.mkdir()
    for file in (request.profile, *request.named_files):
        copy = copies / _relative_place(file, request.profile)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    if request.input_files:
        (folder / INPUT_FILES).mkdir()
    for file in request.input_files:
        shutil.copyfile(file, folder / INPUT_FILES / Path(file).name)
    meta = Meta(
        format=FORMAT,
        session=info,
        wall_ns=clock.wall_ns(),
        monotonic_ns=clock.monotonic_ns(),
        frames=f"SocketCAN {', '.join(request.channels)}" if request.channels else _no_frames(info),
        command_line=request.command_line,
        versions=_versions(),
        sha256={
            path.relative_to(copies).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(copies.rglob("*"))
            if path.is_file()
        },
        run=request.run,
    )
    text = msgspec.json.format(msgspec.json.encode(meta)) + b"\n"
    (folder / META).write_bytes(text)
    return folder


def _relative_place(file: str, profile: str) -> Path:
    """Where the profile finds a file that it names, relative to its folder; the name where that is not below it."""
    place = Path(os.path.relpath(file, Path(profile).parent))
    return Path(place.name) if ".." in place.parts else place


def _no_frames(info: SessionInfo) -> str:
    return f"none: {info.bus} has no frames on a socket"


def empty_folder(folder: Path) -> None:
    """Remove what `create_folder` has created, so that the same name can be used again."""
    with contextlib.suppress(OSError):
        for entry in os.scandir(folder):
            shutil.rmtree(entry.path, ignore_errors=True) if entry.is_dir() else os.unlink(entry.path)


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version(), "kernel": platform.release(), "machine": platform.machine()}
    for name in _PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed as a package"
    return versions
