"""Handles files that an option or an argument names."""

from pathlib import Path

from vehicle_iface.errors import ConfigError


def find_log(path: str) -> Path:
    """Return the log at a path: the file itself, or the frames in the folder of a recorded drive."""
    from vehicle_iface.recorder.files import FRAMES  # `run` needs none of it

    log = Path(path)
    if not log.is_dir():
        return log
    if not (log / FRAMES).is_file():
        raise ConfigError(f"{log}: is a folder without {FRAMES}; name a log, or the folder that `run --record` wrote")
    return log / FRAMES


def check_writable(path: str, option: str) -> None:
    """Create the file, or open an existing one for writing, before any other work.

    Raises `ConfigError` if that fails.
    """
    try:
        with open(path, "a", encoding="utf-8"):
            pass
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be written: {error.strerror}") from None


def write_text(path: str, text: str, option: str) -> None:
    """Write the file; raises `ConfigError` if that fails."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be written: {error.strerror}") from None
