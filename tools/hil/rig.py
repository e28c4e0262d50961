"""One case's set-up while it runs: bus, vehicle and device, a hundred ticks a second, in one thread."""

import fcntl
import os
import random
import re
import shlex
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from bus_contract import AUTONOMOUS, MS, Frame, S

from hil import faults
from hil.bus import Bus, Heard, candump_line
from hil.device import Commands, Device, filled
from hil.plant import Plant
from hil.process import Process
from hil.result import Event, EventKind
from hil.vehicle import PERIOD_NS, Vehicle
from hil.wire import Wire

ANSWER_S = 0.005
"""Within half a period a device has answered, or it has not."""
STUCK_TICKS = 2000
"""Longer than any trajectory of the catalogue lets it wait for a change of direction."""
LATE_NS = 30 * MS
"""What is said later than this makes what the bench saw doubtful: with a period it comes near the 50 ms without state
after which a device stops."""
BENCH_END, DEVICE_END = "hil0", "hil1"
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
COMMAND_S = 10.0
DONE = "hands-are-done"


class RigError(Exception):
    """The bench itself cannot go on."""


class StrangerError(RigError):
    """Somebody else speaks for the vehicle: there may be one. The bench says nothing more on this bus."""


class Hands:
    """A shell that runs the system's programs: to start them from here would hold up the vehicle while they load."""

    def __init__(self) -> None:
        path = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
        self._shell = subprocess.Popen(
            ["sh"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ | {"PATH": path},
            bufsize=0,
            start_new_session=True,  # what interrupts the bench must not take its hands away
        )
        assert self._shell.stdout is not None
        os.set_blocking(self._shell.stdout.fileno(), False)
        self._heard = b""
        self.status = 0
        self.said = ""

    def ask(self, words: Sequence[str], *, beside: str = "") -> None:
        """Have a command run; with `beside`, where its output goes, it says the process and does not wait for it."""
        assert self._shell.stdin is not None
        line = f"{shlex.join(words)} </dev/null {beside}{' & echo process=$!' if beside else ''}"
        self._heard = b""
        self._shell.stdin.write(f"{line}\necho {DONE} $?\n".encode())

    def is_done(self) -> bool:
        """Whether it has ended, and how."""
        assert self._shell.stdout is not None
        self._heard += self._shell.stdout.read() or b""
        said, mark, status = self._heard.rpartition(DONE.encode())
        if not mark or not status.endswith(b"\n"):
            return False
        self.said, self.status = said.decode(errors="replace").strip(), int(status)
        return True

    def close(self) -> None:
        """With all that still runs beside. May be called twice."""
        with suppress(ProcessLookupError):
            os.killpg(self._shell.pid, signal.SIGKILL)
        self._shell.communicate()


class Rig:
    """Raises `RigError` and `OSError` where the bench, not the device, is at fault."""

    def __init__(
        self, wire: Wire, channel: str, commands: Commands, folder: Path, words: dict[str, str], seed: int, name: str
    ) -> None:
        self.wire, self.folder, self.name = wire, folder, name
        self.random: random.Random = faults.rng(seed, name)
        self.device_channel = words["channel"]
        self.bus = Bus(channel, wire.names)
        self.vehicle = Vehicle(wire, Plant(wheelbase_m=float(wire.profile["geometry"]["wheelbase_m"])))
        self.vehicle_speaks = True
        self.words, self._commands = words, commands
        self.device = Device(commands, folder / f"{name}.log", words, self.command)
        self._hands = Hands()
        self.heard: list[Heard] = []
        self.events: list[Event] = []
        self.every_tick: list[Callable[[], None]] = []
        self.delay_s: Callable[[], float] = lambda: 0.0
        self.late: list[str] = []
        """Ticks of the bench that came too late."""
        self.begin_ns = self.inject_ns = self.end_ns = self.then_ns = self.healthy_ns = self.exit_ns = 0
        self.touched_ns = 0
        """The bench began to do something; the fault may come a little later."""
        self.exit_status: int | None = None
        self._next_ns = 0
        self._device_ids = {wire.ids[name] for name in wire.of_device}

    def begin(self) -> None:
        """Time runs from here; the vehicle speaks."""
        self.begin_ns = self._next_ns = time.monotonic_ns()

    def tick(self) -> None:
        """Hear, move, speak."""
        now_ns = time.monotonic_ns()
        if now_ns < self._next_ns:
            time.sleep((self._next_ns - now_ns) / S)
            now_ns = time.monotonic_ns()
        due_ns = self._next_ns
        self._next_ns = (now_ns if now_ns - due_ns > LATE_NS else due_ns) + PERIOD_NS
        self._drain(now_ns)
        if not self.exit_ns and self.device.poll() is not None:
            self.exit_ns = now_ns
        self.vehicle.move(PERIOD_NS / S, now_ns)
        spoken = self.vehicle.speak()
        if self.vehicle_speaks:
            delay_s = self.delay_s()
            if delay_s > 0.0:
                time.sleep(delay_s)
            refused = self.bus.refused
            for frame in spoken:
                self.bus.send(frame)
            if self.bus.refused > refused:
                self.late.append(f"{self._now_s():.3f} s: its queue had no room")
        self._note_lateness(time.monotonic_ns() - due_ns)
        for call in tuple(self.every_tick):
            call()

    def run_for(self, duration_s: float) -> None:
        """Go on for so long."""
        end_ns = time.monotonic_ns() + round(duration_s * S)
        while time.monotonic_ns() < end_ns:
            self.tick()

    def wait_for(self, is_true: Callable[[], bool], within_s: float, what: str) -> bool:
        """Go on until it is true; False when time is over, which is then on the time line."""
        end_ns = time.monotonic_ns() + round(within_s * S)
        while not is_true():
            if time.monotonic_ns() > end_ns:
                self.note(EventKind.CLEAN_UP, f"waited {within_s:.0f} s in vain for {what}")
                return False
            self.tick()
        return True

    def note(self, kind: EventKind, text: str, at_ns: int = 0) -> None:
        """Onto the time line."""
        self.events.append(Event(at_s=((at_ns or time.monotonic_ns()) - self.begin_ns) / S, kind=kind, text=text))

    def injects(self) -> None:
        """The fault is there from now on."""
        self.inject_ns = time.monotonic_ns()

    @property
    def is_engaged(self) -> bool:
        """Whether the vehicle obeys, and is not being stopped."""
        drive = self.vehicle.told.get(self.wire.command[0])
        return (
            self.vehicle.mode == AUTONOMOUS and drive is not None and not drive["SAFE_STOP"] and bool(drive["ENABLE"])
        )

    @property
    def is_at_end(self) -> bool:
        """Whether the device says that the trajectory is over, and the vehicle stands."""
        drive = self.vehicle.told.get(self.wire.command[0])
        return drive is not None and drive.reason.startswith("PAST_END") and self.vehicle.stands

    @property
    def is_stuck(self) -> bool:
        """Whether the vehicle stands and is not driven on."""
        return len(self.vehicle.history) > STUCK_TICKS and not any(
            instant.speed_mps for instant in self.vehicle.history[-STUCK_TICKS:]
        )

    def command(self, words: Sequence[str]) -> None:
        """Run a program of the system while the vehicle goes on. Raises `RigError` when it fails."""
        self._hands.ask(words)
        if not self.wait_for(self._hands.is_done, COMMAND_S, words[0]):
            raise RigError(f"{' '.join(words)}: did not end")
        if self._hands.status:
            raise RigError(f"{' '.join(words)}: {self._hands.said or self._hands.status}")

    def beside(self, words: Sequence[str]) -> Process:
        """Let a program run beside the vehicle, until `rest`. What it says is kept in a file. May raise `RigError`."""
        log = self.folder / f"{self.name}.beside.log"
        self._hands.ask(["exec", *words], beside=f">>{shlex.quote(str(log))} 2>&1")
        if not self.wait_for(self._hands.is_done, COMMAND_S, words[0]):
            raise RigError(f"{' '.join(words)}: did not begin")
        number = re.search(r"^process=(\d+)$", self._hands.said, re.MULTILINE)
        try:
            return Process(int(number[1]) if number else 0)
        except OSError as error:
            raise RigError(f"{' '.join(words)}: {error}; see {log}") from None

    @property
    def viewer(self) -> list[str]:
        """What begins a viewer of the device."""
        return filled(self._commands.view, self.words)

    def rest(self, process: Process) -> None:
        """End what runs beside, if it still does."""
        process.send(signal.SIGCONT)
        process.send(signal.SIGTERM)
        process.close()

    def set_link(self, *, up: bool) -> None:
        """At once, by a system call."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
            name = self.device_channel.encode()
            request = fcntl.ioctl(any_socket, SIOCGIFFLAGS, struct.pack("16sh14x", name, 0))
            flags = struct.unpack("16sh14x", request)[1]
            flags = flags | IFF_UP if up else flags & ~IFF_UP
            fcntl.ioctl(any_socket, SIOCSIFFLAGS, struct.pack("16sh14x", name, flags))

    def hear_answers(self) -> None:
        """To the sample just sent."""
        time.sleep(ANSWER_S)
        self._drain(time.monotonic_ns())

    def device_frames(self) -> list[Frame]:
        """What the device sent, whole or not."""
        return [heard.frame for heard in self.heard if self._is_devices(heard)]

    def judged_frames(self) -> list[Frame]:
        """What a judge of the device looks at: the state as it was on the bus, and the device's own frames."""
        return [
            heard.frame
            for heard in self.heard
            if not heard.frame.is_error
            and (self._is_devices(heard) or (heard.is_ours and not self._is_of_device(heard)))
        ]

    def write_candump(self, path: Path) -> None:
        """Everything heard, as `candump -L` writes it."""
        offset_ns = time.time_ns() - time.monotonic_ns()
        with open(path, "w", encoding="ascii") as log:
            for heard in self.heard:
                log.write(candump_line(heard.frame, self.bus.channel, offset_ns) + "\n")

    def close(self) -> None:
        """May be called twice."""
        self.bus.close()
        self._hands.close()

    def _note_lateness(self, late_ns: int) -> None:
        """Before the device speaks nothing depends on it."""
        if late_ns > LATE_NS and self.vehicle.told:
            self.late.append(f"{self._now_s():.3f} s: {late_ns / MS:.0f} ms")

    def _now_s(self) -> float:
        return (self._next_ns - self.begin_ns) / S

    def _drain(self, now_ns: int) -> None:
        for heard in self.bus.drain():
            self.heard.append(heard)
            if self._is_of_device(heard) and not heard.frame.is_error:
                self.vehicle.hear(heard.frame, now_ns)
            elif not heard.is_ours and self.vehicle_speaks:
                self._mistrust(heard.frame)

    def _mistrust(self, frame: Frame) -> None:
        told = None if frame.is_error else self.wire.intact(frame)
        if told is not None:
            self.vehicle_speaks = False
            self.every_tick.clear()
            raise StrangerError(f"somebody else says {told.name} (0x{frame.can_id:03X}) on this bus")

    def _is_of_device(self, heard: Heard) -> bool:
        return heard.frame.can_id in self._device_ids and not heard.frame.is_extended

    def _is_devices(self, heard: Heard) -> bool:
        return not heard.is_ours and not heard.frame.is_error and self._is_of_device(heard)


def make_cable() -> None:
    """A vxcan pair: the vehicle on one end, the device on the other. Raises `RigError`."""
    remove_cable()
    for words in (
        ["ip", "link", "add", BENCH_END, "type", "vxcan", "peer", "name", DEVICE_END],
        ["ip", "link", "set", BENCH_END, "mtu", "72", "up"],
        ["ip", "link", "set", DEVICE_END, "mtu", "72", "up"],
    ):
        done = subprocess.run(words, capture_output=True, check=False, text=True)
        if done.returncode:
            raise RigError(f"{' '.join(words)}: {done.stderr.strip()}")


def remove_cable() -> None:
    """If it is there."""
    with suppress(OSError):
        subprocess.run(["ip", "link", "del", BENCH_END], capture_output=True, check=False, start_new_session=True)


def make_disk(place: Path, size_mib: int) -> None:
    """A small disk in memory. Raises `RigError`."""
    place.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size_mib}m", "tmpfs", str(place)],
        capture_output=True,
        check=False,
        text=True,
    )
    if done.returncode:
        raise RigError(f"mount {place}: {done.stderr.strip()}")


def remove_disk(place: Path) -> None:
    """With what is on it, if it is there."""
    subprocess.run(["umount", "-l", str(place)], capture_output=True, check=False, start_new_session=True)
    with suppress(OSError):
        place.rmdir()
