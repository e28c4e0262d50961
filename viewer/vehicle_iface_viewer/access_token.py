"""The secret that a browser must send: where it comes from, and how it gets to this machine's browser.

Neither way shows it in a process's command line, which every user of the machine can read.
"""

from __future__ import annotations

import contextlib
import html
import os
import stat
import tempfile
import webbrowser
from collections.abc import Iterator
from pathlib import Path

from vehicle_iface.errors import ConfigError

TOKEN_VARIABLE = "VEHICLE_IFACE_TOKEN"
MIN_TOKEN_LENGTH = 16

_MAX_FILE_BYTES = 4096


def read_token(path: Path | None) -> str | None:
    """Return the token of a file, otherwise that of the environment variable; None if neither is given.

    Raises `ConfigError` for a file that cannot be read, or that other users can read or replace.
    """
    if path is None:
        return os.environ.get(TOKEN_VARIABLE)
    try:
        # Bytes, for a text decoder would quote the secret in its error.
        with path.open("rb") as file:
            _require_private(path, os.fstat(file.fileno()))
            content = file.read(_MAX_FILE_BYTES + 1)
    except OSError as error:
        raise ConfigError(
            f"--token-file {path}: {error.strerror}; `(umask 077; openssl rand -hex 16 > FILE)` makes one"
        ) from None
    if len(content) > _MAX_FILE_BYTES:
        raise ConfigError(
            f"--token-file {path}: more than {_MAX_FILE_BYTES} bytes; it holds the token and nothing else"
        )
    return content.decode("ascii", "replace").strip()


def require_sound_token(token: str) -> None:
    """Raise `ConfigError` for a token that is short, or that a browser would not return as a cookie."""
    advice = "`openssl rand -hex 16` makes a good one"
    if len(token) < MIN_TOKEN_LENGTH:
        raise ConfigError(f"token of {len(token)} characters: at least {MIN_TOKEN_LENGTH}; {advice}")
    # RFC 6265, cookie-octet
    if unfit := [c for c in token if not "!" <= c <= "~" or c in '",;\\']:
        allowed = 'only ASCII letters, digits and marks other than " , ; \\ are allowed'
        raise ConfigError(f"token with {unfit[0]!a}: {allowed}; {advice}")


def _require_private(path: Path, found: os.stat_result) -> None:
    if found.st_uid not in (os.geteuid(), 0):
        raise ConfigError(f"--token-file {path}: belongs to user {found.st_uid}; it must be yours, or root's")
    mode = stat.S_IMODE(found.st_mode)
    if mode & 0o077:
        raise ConfigError(f"--token-file {path}: mode {mode:04o} lets other users in; `chmod 600` it")


@contextlib.contextmanager
def opened_in_browser(url: str, *, is_secret: bool) -> Iterator[None]:
    """Open `url` in this machine's browser. A secret one goes by a private file that redirects, removed at the end:
    a browser is started with the address in its command line."""
    if not is_secret:
        webbrowser.open(url)
        yield
        return
    with tempfile.NamedTemporaryFile("w", prefix="vehicle-iface-", suffix=".html", encoding="utf-8") as file:
        file.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={html.escape(url)}">\n')
        file.flush()
        webbrowser.open(Path(file.name).as_uri())
        yield
