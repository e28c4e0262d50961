"""The device under test: started and ended by commands, or already there.

A command line is a template: {channel}, {profile}, {trajectory} and {route} are filled in. What was started here, and
is no door to another computer, can also be stopped, killed and looked after by the operating system.
"""

import os
import re
import resource
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from hil.process import Process

ROOT = Path(__file__).resolve().parents[2]
WORDS = ("channel", "profile", "trajectory", "route", "record", "port")
WITH_OPEN_FILES = """
import os, resource, sys
count, most = int(sys.argv[1]), resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (min(2 * count, most), most))
for _ in range(count):
    os.set_inheritable(os.open(os.devnull, os.O_RDONLY), True)
os.execvp(sys.argv[2], sys.argv[2:])
"""
"""Takes the lowest descriptors, and becomes the program that its further arguments name."""
OWN = f"{sys.executable} -m vehicle_iface run --channel {{channel}} --profile {{profile}} --trajectory {{trajectory}}"
OWN_RECORDING = f"{OWN} --arm --record {{record}}"
OWN_VIEWER = f"{sys.executable} -m vehicle_iface view --port {{port}}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """How the device is handled."""

    start: str = f"{OWN} --arm"
    """Empty: it is there already."""
    listen: str = OWN
    """Started without being armed; empty: it has no such way."""
    record: str = OWN_RECORDING
    """Started so that it writes its drive down in the new folder {record}; empty: it has no such way."""
    view: str = OWN_VIEWER
    """A program beside it that shows it to browsers at {port} of this computer; empty: there is none."""
    stop: str = ""
    """Ends it in an orderly way; empty: SIGINT to what was started."""
    rearm: str = ""
    """The operator's edge; empty: SIGUSR1 to what was started."""
    is_here: bool = True
    """What is started is the device itself, not a door to another computer."""

    @property
    def is_ours(self) -> bool:
        """Whether the operating system may be used against it."""
        return bool(self.start) and self.is_here


def misspelt(template: str) -> str:
    """What is wrong with a command line; empty when it can be filled in."""
    try:
        filled(template, dict.fromkeys(WORDS, ""))
    except KeyError as error:
        return f"{{{error.args[0]}}} is not known; a brace that is meant is written twice"
    except (ValueError, IndexError) as error:
        return str(error)
    return ""


def filled(template: str, words: Mapping[str, str]) -> list[str]:
    """The command line's words."""
    return [part.format_map(words) for part in shlex.split(template)]


class Device:
    """One life of the device."""

    def __init__(
        self, commands: Commands, log: Path, words: Mapping[str, str], run: Callable[[Sequence[str]], None]
    ) -> None:
        """`run` runs a program while the vehicle goes on."""
        self._commands, self._words, self.log, self._run = commands, words, log, run
        self._process: subprocess.Popen[bytes] | None = None
        self.status: int | None = None
        """Exit status, once it has ended."""

    @property
    def is_started(self) -> bool:
        """Whether it was started here, so that its end can be seen."""
        return self._process is not None

    def start(self, *, armed: bool = True, recorded: bool = False, open_files: int = 0) -> None:
        """Begin its life, with so many descriptors open before its own; one that is there already goes on with it."""
        commands = self._commands
        template = commands.record if recorded else commands.start if armed else commands.listen
        if not template:
            return
        opener = [sys.executable, "-c", WITH_OPEN_FILES, str(open_files)] if open_files else []
        with open(self.log, "ab") as log:
            self._process = subprocess.Popen(
                [*opener, *self._filled(template)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                cwd=ROOT,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )

    def rearm(self) -> None:
        """The operator's edge."""
        if self._commands.rearm:
            self._run(self._filled(self._commands.rearm))
        else:
            self.send(signal.SIGUSR1)

    def stop(self) -> None:
        """Ask it to end in an orderly way; `poll` tells when it has."""
        if self._commands.stop:
            self._run(self._filled(self._commands.stop))
        elif self._process is not None:
            self.send(signal.SIGINT)

    def send(self, number: signal.Signals) -> None:
        """A signal, if it still lives."""
        if self.poll() is None and self._process is not None:
            self._process.send_signal(number)

    def writers(self, folder: Path) -> list[Process]:
        """The processes that it has begun, however indirectly, and that have a file in this folder open."""
        found, left = [], [] if self.poll() is not None or self._process is None else [self._process.pid]
        while left:
            pid = left.pop()
            with suppress(FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
                for children in Path(f"/proc/{pid}/task").glob("*/children"):
                    left += [int(child) for child in children.read_text().split()]
                if any(folder in Path(os.readlink(file)).parents for file in Path(f"/proc/{pid}/fd").iterdir()):
                    found.append(Process(pid))
        return found

    @contextmanager
    def without_memory(self) -> Iterator[None]:
        """Meanwhile it gets no more memory than it has, if it still lives."""
        if self.poll() is not None or self._process is None:
            yield
            return
        pid = self._process.pid
        held = dict(re.findall(r"(\w+):\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text()))
        with ExitStack() as stack:
            for limit, name in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
                before = resource.prlimit(pid, limit, (int(held[name]) * 1024, resource.prlimit(pid, limit)[1]))
                stack.callback(self._give_back, limit, before)
            yield

    def poll(self) -> int | None:
        """Its exit status; None while it lives, or where it was not started here."""
        if self._process is not None and self.status is None:
            self.status = self._process.poll()
        return self.status

    def kill(self) -> list[str]:
        """End whatever is left of it; returns what had to be killed."""
        if self._process is None:
            return []
        left = []
        if self.poll() is None:
            left.append(f"the device (process {self._process.pid}) still ran")
            self._process.kill()
            self.status = self._process.wait()
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            return left
        time.sleep(0.05)
        return left or ["a process that the device had started was still there"]

    def _give_back(self, limit: int, before: tuple[int, int]) -> None:
        if self.poll() is None and self._process is not None:
            resource.prlimit(self._process.pid, limit, before)

    def _filled(self, template: str) -> list[str]:
        return filled(template, self._words)
