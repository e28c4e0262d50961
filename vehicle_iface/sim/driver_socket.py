"""The driver's controls over a Unix stream socket: one line in, one line out.

`send_line(path, "brake 1")` returns `ok`. `driver_commands` defines the lines.
It never waits for a client, and buffers at most a few short lines of each.
"""

import contextlib
import os
import re
import socket
import stat
from collections.abc import Callable
from pathlib import Path

from vehicle_iface.errors import ConfigError

LONGEST_LINE = 256
"""Maximum bytes of one line, its end included; a longer line closes the connection."""
MOST_CLIENTS = 8
"""Maximum number of connections; the oldest is closed for a new one."""
LINES_PER_POLL = 4
"""Maximum number of lines of a client in one poll, so that a busy client cannot delay a tick."""
_LONGEST_ANSWER = 65_536


def default_path(channel: str) -> str:
    """Return the socket path of the vehicle on `channel`: in the user's runtime directory, else in /tmp."""
    runtime = Path(f"/run/user/{os.getuid()}")
    directory = runtime if runtime.is_dir() else Path("/tmp")
    return str(directory / f"vehicle-iface-sim-{re.sub(r'[^A-Za-z0-9_.-]', '_', channel)}.sock")


class DriverSocket:
    """Server end of the driver's controls: only its own user can connect, and `close` removes it."""

    def __init__(self, path: str) -> None:
        """Listen at `path`; a socket without a listener is replaced.

        Raises `ConfigError` when a vehicle listens there, when something else is there, or when it cannot be made.
        """
        self.path = path
        _make_room(path)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            _bind_private(self._listener, path)
            self._inode = os.stat(path).st_ino
            self._listener.listen(MOST_CLIENTS)
        except OSError as error:
            self._listener.close()
            raise ConfigError(f"driver socket: {path}: {error.strerror or error}") from error
        self._listener.setblocking(False)
        self._clients: dict[socket.socket, bytearray] = {}

    def poll(self, answer: Callable[[str], str]) -> int:
        """Answer the received lines without waiting; return their number."""
        self._accept()
        return sum(self._serve(client, answer) for client in list(self._clients))

    def close(self) -> None:
        """Close all connections and remove the socket, unless another has replaced it. May be called twice."""
        for client in list(self._clients):
            self._close_client(client)
        self._listener.close()
        with contextlib.suppress(OSError):
            if os.stat(self.path).st_ino == self._inode:
                os.unlink(self.path)

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:  # nobody there, or gone again, or out of descriptors: the vehicle drives on
                return
            client.setblocking(False)
            if len(self._clients) >= MOST_CLIENTS:
                self._close_client(next(iter(self._clients)))
            self._clients[client] = bytearray()

    def _serve(self, client: socket.socket, answer: Callable[[str], str]) -> int:
        """Answer a few complete lines; close the connection at its end and on an invalid line."""
        buffer = self._clients[client]
        is_over = self._read_until_end(client, buffer)
        count = 0
        while count < LINES_PER_POLL and b"\n" in buffer and client in self._clients:
            line, _, rest = bytes(buffer).partition(b"\n")
            buffer[:] = rest
            self._send(client, answer(line.decode("utf-8", "replace")))
            count += 1
        if len(buffer) >= LONGEST_LINE and b"\n" not in buffer:
            self._send(client, f"error: line too long: at most {LONGEST_LINE - 1} bytes")
            is_over = True
        if is_over:
            self._close_client(client)
        return count

    def _read_until_end(self, client: socket.socket, buffer: bytearray) -> bool:
        """Fill the buffer to one line's length once it has no complete line; return whether the input has ended."""
        if b"\n" in buffer:
            return False
        try:
            chunk = client.recv(LONGEST_LINE - len(buffer))
        except BlockingIOError:
            return False
        except OSError:
            return True
        buffer += chunk
        return not chunk

    def _send(self, client: socket.socket, text: str) -> None:
        """Send one line, or close the connection of a client that does not read."""
        try:
            whole = client.send(text.encode() + b"\n") == len(text.encode()) + 1
        except OSError:
            whole = False
        if not whole:
            self._close_client(client)

    def _close_client(self, client: socket.socket) -> None:
        self._clients.pop(client, None)
        client.close()


def send_line(path: str, line: str, *, timeout_s: float = 2.0) -> str:
    """Send one line to the vehicle that listens at `path`; return its answer without the line end.

    Raises `ConfigError` when no vehicle listens there or no answer arrives within `timeout_s`.
    """
    if "\n" in line or len(line.encode()) >= LONGEST_LINE:
        raise ConfigError(f"driver socket: {line[:40]!r}: must be one line of less than {LONGEST_LINE} bytes")
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            client.settimeout(timeout_s)
            client.connect(path)
            client.sendall(line.encode() + b"\n")
            return _read_line(client)
    except OSError as error:
        why = "no answer" if isinstance(error, TimeoutError) else error.strerror or str(error)
        raise ConfigError(f"driver socket: {path}: {why}; is `vehicle-iface sim` running?") from error


def _read_line(client: socket.socket) -> str:
    text = bytearray()
    while b"\n" not in text and len(text) < _LONGEST_ANSWER:
        chunk = client.recv(4096)
        if not chunk:
            break
        text += chunk
    return text.partition(b"\n")[0].decode()


def _make_room(path: str) -> None:
    """Remove a dead socket; reject anything else."""
    try:
        mode = os.lstat(path).st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise ConfigError(f"driver socket: {path}: {error.strerror}") from error
    if not stat.S_ISSOCK(mode):
        raise ConfigError(f"driver socket: {path}: is not a socket; choose another with --driver-socket")
    if _is_listened_on(path):
        raise ConfigError(f"driver socket: {path}: another simulator uses it; choose another with --driver-socket")
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)


def _is_listened_on(path: str) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(path)
        except ConnectionRefusedError:
            return False
        except OSError:  # a full queue, or not ours to ask
            return True
        return True


def _bind_private(listener: socket.socket, path: str) -> None:
    """Bind with mode 0600 from the first moment on."""
    mask = os.umask(0o177)
    try:
        listener.bind(path)
    finally:
        os.umask(mask)
