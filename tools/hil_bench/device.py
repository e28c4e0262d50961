"""The device under test: started and ended by commands, or already running.

A command line is a template: {channels}, {channel}, {profile}, {trajectory} and {route} are filled in. {channels} is
`--channel can0` or, of several buses, `--channel NAME=can0` for each; {channel} is the first interface. A device that
was started on this computer can also be stopped, killed and observed by the operating system.
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

from hil_bench.places import CHECKOUT
from hil_bench.process import Process

CHANNELS = "{channels}"
PLACEHOLDERS = ("channels", "channel", "profile", "trajectory", "route", "record", "port", "page")
WITH_OPEN_FILES = """
import os, resource, sys
count, most = int(sys.argv[1]), resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (min(2 * count, most), most))
for _ in range(count):
    os.set_inheritable(os.open(os.devnull, os.O_RDONLY), True)
os.execvp(sys.argv[2], sys.argv[2:])
"""
"""Opens the lowest descriptors, then executes the program that its further arguments name."""
TELEMETRY = "--telemetry bench-{channel}"
"""Devices on different interfaces run at the same time."""
OWN = (
    f"{sys.executable} -m vehicle_iface run {{channels}} --profile {{profile}} --trajectory {{trajectory}} {TELEMETRY}"
)
OWN_VERSION = f"{sys.executable} -m vehicle_iface --version"
OWN_RECORDING = f"{OWN} --arm --record {{record}}"
OWN_EXPORT = f"{sys.executable} -m vehicle_iface export {{record}} --html {{page}}"
OWN_VIEWER = f"{sys.executable} -m vehicle_iface view --port {{port}} --connect bench-{{channel}}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """The commands that handle the device."""

    start: str = f"{OWN} --arm"
    """Empty: it is already running."""
    listen: str = OWN
    """Starts it without arming; empty: not possible."""
    record: str = OWN_RECORDING
    """Starts it so that it records its drive in the new folder {record}; empty: not possible."""
    view: str = OWN_VIEWER
    """Starts a viewer that serves {port} of this computer; empty: there is none."""
    export: str = ""
    """Writes the file {page}, which shows the drive in {record}; empty: drives are not shown."""
    stop: str = ""
    """Ends it in an orderly way; empty: SIGINT to the started process."""
    rearm: str = ""
    """Arms it again; empty: SIGUSR1 to the started process."""
    is_here: bool = True
    """The command starts the device itself, not a remote shell."""

    @property
    def is_ours(self) -> bool:
        """True if the device is a process of this computer that the bench started."""
        return bool(self.start) and self.is_here


def find_template_error(template: str) -> str:
    """Why a template cannot be filled in; empty if it can."""
    try:
        fill_template(template, dict.fromkeys(PLACEHOLDERS, ""))
    except KeyError as error:
        return f"{{{error.args[0]}}} is not known; write a literal brace twice"
    except (ValueError, IndexError) as error:
        return str(error)
    return ""


def fill_template(template: str, values: Mapping[str, str]) -> list[str]:
    """The command with its arguments; {channels} are several, if it is a word of its own."""
    parts = (
        shlex.split(values["channels"]) if part == CHANNELS else [part.format_map(values)]
        for part in shlex.split(template)
    )
    return [word for words in parts for word in words]


class Device:
    """One start of the device, until its end."""

    def __init__(
        self, commands: Commands, log: Path, values: Mapping[str, str], run: Callable[[Sequence[str]], None]
    ) -> None:
        """`run` runs a program while the vehicle continues."""
        self._commands, self._values, self.log, self._run = commands, values, log, run
        self._process: subprocess.Popen[bytes] | None = None
        self.status: int | None = None
        """Exit status, once it has ended."""

    @property
    def is_started(self) -> bool:
        """True if it was started here, so that its end can be observed."""
        return self._process is not None

    def start(self, *, armed: bool = True, recorded: bool = False, open_files: int = 0) -> None:
        """Start it, with `open_files` descriptors open; does nothing if it is already running."""
        commands = self._commands
        template = commands.record if recorded else commands.start if armed else commands.listen
        if not template:
            return
        opener = [sys.executable, "-c", WITH_OPEN_FILES, str(open_files)] if open_files else []
        with open(self.log, "ab") as log:
            self._process = subprocess.Popen(
                [*opener, *self._fill(template)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                cwd=CHECKOUT,  # where `python -m vehicle_iface` finds it even if this Python does not have it installed
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )

    def rearm(self) -> None:
        """Arm it again, as the operator does."""
        if self._commands.rearm:
            self._run(self._fill(self._commands.rearm))
        else:
            self.send(signal.SIGUSR1)

    def stop(self) -> None:
        """Request an orderly end; `poll` returns a status once it has ended."""
        if self._commands.stop:
            self._run(self._fill(self._commands.stop))
        elif self._process is not None:
            self.send(signal.SIGINT)

    def send(self, number: signal.Signals) -> None:
        """Send a signal, if it still runs."""
        if self.poll() is None and self._process is not None:
            self._process.send_signal(number)

    def writers(self, folder: Path) -> list[Process]:
        """Its processes, direct or indirect children, that have a file in this folder open."""
        found = []
        for pid in self.find_processes():
            with suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
                if any(folder in Path(os.readlink(file)).parents for file in Path(f"/proc/{pid}/fd").iterdir()):
                    found.append(Process(pid))
        return found

    def find_processes(self) -> list[int]:
        """Its processes, with direct and indirect children; none where it does not run on this computer."""
        is_running = self._commands.is_ours and self.poll() is None and self._process is not None
        found, left = [], [self._process.pid] if is_running and self._process is not None else []
        while left:
            pid = left.pop()
            found.append(pid)
            with suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
                for children in Path(f"/proc/{pid}/task").glob("*/children"):
                    left += [int(child) for child in children.read_text().split()]
        return found

    @contextmanager
    def without_memory(self) -> Iterator[None]:
        """Limit it to the memory that it has, if it still runs."""
        if self.poll() is not None or self._process is None:
            yield
            return
        pid = self._process.pid
        held = dict(re.findall(r"(\w+):\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text()))
        with ExitStack() as stack:
            for limit, name in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
                before = resource.prlimit(pid, limit, (int(held[name]) * 1024, resource.prlimit(pid, limit)[1]))
                stack.callback(self._restore_limit, limit, before)
            yield

    def poll(self) -> int | None:
        """Its exit status; None while it runs, or if it was not started here."""
        if self._process is not None and self.status is None:
            self.status = self._process.poll()
        return self.status

    def kill(self) -> list[str]:
        """Kill what is left of it; returns what had to be killed."""
        if self._process is None:
            return []
        left = []
        if self.poll() is None:
            left.append(f"the device (process {self._process.pid}) was still running")
            self._process.kill()
            self.status = self._process.wait()
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            return left
        time.sleep(0.05)
        return left or ["a process that the device had started was still running"]

    def _restore_limit(self, limit: int, before: tuple[int, int]) -> None:
        if self.poll() is None and self._process is not None:
            resource.prlimit(self._process.pid, limit, before)

    def _fill(self, template: str) -> list[str]:
        return fill_template(template, self._values)
