"""Writes the minimal controller's drive down: through a process of its own, so that a disk holds nobody up."""

import fcntl
import os
import subprocess
from pathlib import Path

F_SETPIPE_SZ, PIPE_BYTES = 1031, 4096


class Diary:
    """A line for each pair. What the process does not take is lost; where it `blocks`, it is waited for.

    Where the diary `matters`, it is an `OSError` that the process is gone.
    """

    def __init__(self, folder: Path, *, blocks: bool, matters: bool) -> None:
        self._matters = matters
        folder.mkdir(parents=True)
        with open(folder / "drive.csv", "wb") as file:
            self._writer = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=file, stderr=subprocess.DEVNULL)
        assert self._writer.stdin is not None
        self._pipe = self._writer.stdin.fileno()
        fcntl.fcntl(self._pipe, F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(self._pipe, blocks)
        self.lost = 0

    def note(self, *values: float) -> None:
        """One line, or nothing."""
        try:
            os.write(self._pipe, (",".join(f"{value:.6f}" for value in values) + "\n").encode())
        except BlockingIOError:
            self.lost += 1
        except BrokenPipeError:
            self.lost += 1
            if self._matters:
                raise

    def close(self) -> None:
        """The last line is written."""
        self._writer.communicate()
