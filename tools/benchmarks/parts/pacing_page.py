"""The onlookers of the `pacing` benchmark: a viewer, and a Chromium with its page; both can be frozen."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Self

from playwright.sync_api import Error, Playwright

from benchmarks.parts.report import BenchmarkError

CHROMIUM = "/usr/bin/chromium"
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--no-first-run",
)
PATIENCE_MS = 60_000
PLACE = "() => document.getElementById('n-x')?.textContent ?? ''"
SETTLING_S = 1.0
"""A page that was just loaded, or woken up, is busy for so long."""


class Onlookers:
    """A viewer at a telemetry address and a browser with a new profile folder; frozen at first."""

    def __init__(self, playwright: Playwright, address: str, folder: Path) -> None:
        if not Path(CHROMIUM).exists():
            raise BenchmarkError(f"{CHROMIUM} is missing: sudo apt-get install chromium")
        command = [sys.executable, "-P", "-m", "vehicle_iface_viewer", "--connect", address, "--port", "0"]
        self._viewer = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
        assert self._viewer.stdout is not None
        self._url = self._viewer.stdout.readline().partition(" ")[2].partition(" ")[0]
        self._context = playwright.chromium.launch_persistent_context(
            str(folder),
            executable_path=CHROMIUM,
            args=list(FLAGS),
            headless=True,
            viewport={"width": 1100, "height": 700},
        )
        self._context.set_default_timeout(PATIENCE_MS)
        self._page = self._context.new_page()
        self._browser = _descendants({_with_argument(str(folder))})
        self._open()
        self.freeze()

    def _open(self) -> None:
        """Load the page anew, until its banner is there."""
        self._page.goto(self._url)
        self._page.wait_for_selector("#banner", state="attached")
        time.sleep(SETTLING_S)

    def place(self) -> str:
        """Where the page says that the vehicle is."""
        try:
            return str(self._page.evaluate(PLACE))
        except Error:  # between two pages
            return ""

    def reload(self) -> None:
        """Reload, without waiting for everything on it."""
        self._page.reload(wait_until="commit")

    def freeze(self) -> None:
        """Neither takes any time from now on."""
        self.hang()
        self._viewer.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Both go on where they were."""
        self._viewer.send_signal(signal.SIGCONT)
        _signal(self._browser, signal.SIGCONT)
        time.sleep(SETTLING_S)

    def hang(self) -> None:
        """The browser alone hangs; its connection stays."""
        self._browser = _descendants(self._browser)
        _signal(self._browser, signal.SIGSTOP)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._viewer.send_signal(signal.SIGCONT)
        _signal(self._browser, signal.SIGCONT)
        with suppress(Error):
            self._context.close()
        self._viewer.terminate()
        self._viewer.wait(20)


def _signal(processes: Iterable[int], number: signal.Signals) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


def _with_argument(part: str) -> int:
    """The browser's first process: the only one of ours that was given that folder and is of no special type."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
            if any(part in word for word in words) and not any(word.startswith("--type=") for word in words):
                return int(folder.name)
    raise BenchmarkError("the browser's process is not to be found")


def _descendants(roots: set[int]) -> set[int]:
    """They and all that they have started."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
    found, size = set(roots), 0
    while len(found) != size:
        size = len(found)
        found |= {child for child, parent in parents.items() if parent in found}
    return found
