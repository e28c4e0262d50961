"""A shell that runs the system's programs: starting them from the bench would hold up the vehicle while they load."""

import os
import shlex
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress

DONE = "shell-command-done"


class Shell:
    """Runs one command at a time, without blocking."""

    def __init__(self) -> None:
        path = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
        self._process = subprocess.Popen(
            ["sh"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ | {"PATH": path},
            bufsize=0,
            start_new_session=True,  # a signal that interrupts the bench must not end its shell
        )
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._read = b""
        self.status = 0
        """Exit status of the command that ended last, and its output."""
        self.output = ""

    def start(self, command: Sequence[str], *, background_log: str = "") -> None:
        """Begin a command; with `background_log`, in the background: it prints `process=PID` and is done at once."""
        assert self._process.stdin is not None
        redirect = f">>{shlex.quote(background_log)} 2>&1 & echo process=$!" if background_log else ""
        self._read = b""
        self._process.stdin.write(f"{shlex.join(command)} </dev/null {redirect}\necho {DONE} $?\n".encode())

    def is_done(self) -> bool:
        """True once the command has ended; `status` and `output` are then its own."""
        assert self._process.stdout is not None
        self._read += self._process.stdout.read() or b""
        output, mark, status = self._read.rpartition(DONE.encode())
        if not mark or not status.endswith(b"\n"):
            return False
        self.output, self.status = output.decode(errors="replace").strip(), int(status)
        return True

    def close(self) -> None:
        """Kill it with all of its background commands. May be called twice."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()
