"""The other processes of a browser test."""

import signal
import subprocess
from pathlib import Path

from vehicle_iface.process import module_command


class _Process:
    """A Python module as a process that greets with one line."""

    def __init__(self, module: str, *arguments: str) -> None:
        command, environment = module_command(module)
        self._process = subprocess.Popen(
            [*command, *arguments],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.greeting = self.read_line()

    def read_line(self) -> str:
        """Return the next line that it prints."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    @property
    def pid(self) -> int:
        return self._process.pid

    def end(self, number: int) -> tuple[int, str]:
        """Send a signal; the exit status and all that was printed after the greeting."""
        self._process.send_signal(number)
        printed, _ = self._process.communicate(timeout=20)
        return self._process.returncode, printed

    def send(self, number: int) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def close(self) -> None:
        """End it, unless it has ended already."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.send_signal(signal.SIGCONT)
        self._process.communicate(timeout=20)


class Publisher(_Process):
    """A process that publishes a drive, and takes orders."""

    def __init__(self, address: str, *options: str) -> None:
        super().__init__("tests.browser.publisher", address, *options)

    def order(self, word: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{word}\n")
        self._process.stdin.flush()


class Viewer(_Process):
    """A viewer process, with the address of its page."""

    def __init__(self, address: str | None, *options: str) -> None:
        """Without an address the page offers the loops of this machine."""
        connect = ["--connect", address] if address is not None else []
        super().__init__("vehicle_iface_viewer", *connect, "--port", "0", *options)
        self.url = self.greeting.partition(" ")[2].partition(" ")[0]


class Replay(_Process):
    """A viewer process that plays a recording back, with the address of its page."""

    def __init__(self, folder: Path, *options: str) -> None:
        super().__init__("vehicle_iface_viewer", str(folder), "--port", "0", *options)
        self.url = self.greeting.partition(" ")[2].partition(" ")[0]
