"""Files that an option names."""

from pathlib import Path

from vehicle_iface.errors import ConfigError


def check_writable(path: str, option: str) -> None:
    """Make the file, empty where there is none, before anything else is done; `ConfigError` when that fails."""
    try:
        with open(path, "a", encoding="utf-8"):
            pass
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be written: {error.strerror}") from None


def write_text(path: str, text: str, option: str) -> None:
    """Write the file; `ConfigError` when that fails."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be written: {error.strerror}") from None
