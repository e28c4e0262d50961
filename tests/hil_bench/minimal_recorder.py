"""Records the minimal controller's drive through another process, so that a slow disk does not delay the controller."""

import fcntl
import os
import subprocess
from pathlib import Path

F_SETPIPE_SZ, PIPE_BYTES = 1031, 4096


class Recorder:
    """Writes one line for each pair. A line that the process does not accept is lost; with `blocks`, writing waits
    instead.

    With `is_required`, writing raises `OSError` after the process has ended.
    """

    def __init__(self, folder: Path, *, blocks: bool, is_required: bool) -> None:
        self._is_required = is_required
        folder.mkdir(parents=True)
        with open(folder / "drive.csv", "wb") as file:
            self._writer = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=file, stderr=subprocess.DEVNULL)
        assert self._writer.stdin is not None
        self._pipe = self._writer.stdin.fileno()
        fcntl.fcntl(self._pipe, F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(self._pipe, blocks)
        self.lost = 0

    def write(self, *values: float) -> None:
        """Write one line, or count it as lost."""
        try:
            os.write(self._pipe, (",".join(f"{value:.6f}" for value in values) + "\n").encode())
        except BlockingIOError:
            self.lost += 1
        except BrokenPipeError:
            self.lost += 1
            if self._is_required:
                raise

    def close(self) -> None:
        """Wait until the last line is written."""
        self._writer.communicate()
