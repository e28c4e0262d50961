"""The first processes inside the kernel that `tools/vcan` boots.

It makes the place habitable (proc, dev, shared memory, loopback, vcan0), runs the one command there, and
carries its streams over serial lines: 0 is control (one JSON object a line, both ways), 1 the command's
input, 2 its output, 3 its errors. Lines 1 to 3 carry frames: a 4-byte length, then so many bytes; a length of
0 ends the stream.
"""

import contextlib
import ctypes
import fcntl
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import tty
from collections.abc import Callable
from typing import Any, NoReturn

CHUNK = 32768
VEOF = b"\x04"

MOUNTS = (
    ("proc", "/proc", ""),
    ("sysfs", "/sys", ""),
    ("devpts", "/dev/pts", "mode=620,ptmxmode=666"),
    ("tmpfs", "/dev/shm", "mode=1777"),
    ("tmpfs", "/run", "mode=755"),
)
LINKS = {"fd": "/proc/self/fd", "stdin": "fd/0", "stdout": "fd/1", "stderr": "fd/2"}
NETWORK = "link set dev lo up\nlink add dev vcan0 type vcan\nlink set dev vcan0 up\n"

Message = dict[str, Any]


class CannotRunError(Exception):
    """The command did not start; `status` is what a shell would answer."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


def write_all(fd: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(fd, view) :]


def read_exactly(fd: int, size: int) -> bytes:
    """Returns fewer bytes only where the stream ended."""
    data = b""
    while len(data) < size and (more := os.read(fd, size - len(data))):
        data += more
    return data


def write_frame(fd: int, data: bytes) -> None:
    write_all(fd, struct.pack(">I", len(data)) + data)


def read_frame(fd: int) -> bytes:
    """Returns the next frame, b"" at the end of the stream or where the other side is gone."""
    head = read_exactly(fd, 4)
    return read_exactly(fd, struct.unpack(">I", head)[0]) if len(head) == 4 else b""


class Control:
    """The control line: messages both ways."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._lock = threading.Lock()
        self._rest = b""

    def send(self, **message: object) -> None:
        with self._lock:
            write_all(self._fd, json.dumps(message).encode() + b"\n")

    def receive(self) -> Message | None:
        """Returns None when the other side is gone."""
        while b"\n" not in self._rest:
            more = os.read(self._fd, 4096)
            if not more:
                return None
            self._rest += more
        line, self._rest = self._rest.split(b"\n", 1)
        message: Message = json.loads(line)
        return message


class OutputPump:
    """Carries one output of the command to its line."""

    def __init__(self, source: int, line: int) -> None:
        self._source = source
        self._line = line
        self._wake_out, self._wake_in = os.pipe()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        """Nobody reads this output any more: the command shall get EPIPE, as from any pipe."""
        os.write(self._wake_in, b"c")

    def finish(self) -> None:
        """Ends when what was written is carried over, even if something else still holds the pipe open."""
        os.write(self._wake_in, b"f")
        self._thread.join()

    def _run(self) -> None:
        while self._wait() and (data := self._read()):
            write_frame(self._line, data)
        os.close(self._source)
        write_frame(self._line, b"")

    def _wait(self) -> bool:
        poll = select.poll()
        poll.register(self._source, select.POLLIN)
        poll.register(self._wake_out, select.POLLIN)
        ready = dict(poll.poll())
        if self._wake_out not in ready:
            return True
        if os.read(self._wake_out, 1) == b"c":
            return False
        os.write(self._wake_in, b"f")
        return self._source in ready

    def _read(self) -> bytes:
        try:
            return os.read(self._source, CHUNK)
        except OSError:  # a terminal whose last user has gone answers EIO
            return b""


def pump_input(line: int, sink: int, end: Callable[[], None]) -> None:
    """Carries the input line to the command; what the command no longer reads is dropped."""
    with contextlib.suppress(OSError):
        while data := read_frame(line):
            write_all(sink, data)
        end()


def mount_all() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    for kind, place, options in MOUNTS:
        os.makedirs(place, exist_ok=True)
        if libc.mount(kind.encode(), place.encode(), kind.encode(), 0, options.encode()) != 0:
            raise OSError(ctypes.get_errno(), f"cannot mount {kind}", place)
    for name, target in LINKS.items():
        os.symlink(target, f"/dev/{name}")


def prepare(spec: Message) -> None:
    mount_all()
    socket.sethostname(spec["hostname"])
    # The modules live outside /lib/modules; from here on the kernel loads by itself what is asked for.
    with open("/proc/sys/kernel/modprobe", "w") as place:
        place.write(spec["modprobe"])
    subprocess.run([spec["ip"], "-batch", "-"], input=NETWORK.encode(), check=True)


def open_line(number: int) -> int:
    fd = os.open(f"/dev/ttyS{number}", os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    return fd


def set_size(fd: int, size: list[int]) -> None:
    fcntl.ioctl(fd, termios.TIOCSWINSZ, struct.pack("HHHH", *size, 0, 0))


def open_terminal(spec: Message) -> tuple[int, int]:
    """Returns both ends of a terminal like the caller's; if that one stays in charge, ours only passes on."""
    master, slave = os.openpty()
    iflag, oflag, cflag, lflag, ispeed, ospeed, cc = spec["termios"]
    if not spec["interactive"]:
        oflag &= ~termios.OPOST
        lflag &= ~(termios.ECHO | termios.ISIG)
        iflag &= ~(termios.ICRNL | termios.INLCR | termios.IXON)
    chars = [bytes([char]) for char in cc]
    termios.tcsetattr(slave, termios.TCSANOW, [iflag, oflag, cflag, lflag, ispeed, ospeed, chars])
    set_size(slave, spec["size"])
    return master, slave


class Session:
    """The command, its streams and its end."""

    def __init__(self, spec: Message, control: Control) -> None:
        self._spec = spec
        self._control = control
        self._pumps: dict[str, OutputPump] = {}
        self._terminal: tuple[int, int] | None = None
        os.setsid()
        if "tty" in spec["streams"]:
            self._terminal = open_terminal(spec)
            fcntl.ioctl(self._terminal[1], termios.TIOCSCTTY, 0)
        # Kept although only its number is used: an unreferenced one collects the exit status behind our back.
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def _pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        ours: list[int | None] = []
        theirs: list[int] = []
        for number, kind in enumerate(self._spec["streams"]):
            mine, its = self._stream(number, kind, theirs)
            ours.append(mine)
            theirs.append(its)
        self._process = self._spawn(theirs)
        for fd in set(theirs):
            os.close(fd)
        self._start_pumps(ours)

    def _stream(self, number: int, kind: str, others: list[int]) -> tuple[int | None, int]:
        """Returns our end, where it has one of its own, and the command's."""
        if kind == "tty":
            assert self._terminal is not None
            return None, os.dup(self._terminal[1])
        if kind == "same":
            return None, os.dup(others[1])
        if kind == "null":
            return None, os.open("/dev/null", os.O_RDWR)
        reader, writer = os.pipe()
        return (writer, reader) if number == 0 else (reader, writer)

    def _spawn(self, streams: list[int]) -> subprocess.Popen[bytes]:
        command = self._spec["command"]
        try:
            os.chdir(self._spec["cwd"])
        except OSError as error:
            message = f"the folder {self._spec['cwd']!r} does not exist inside the kernel: {error.strerror}"
            raise CannotRunError(126, message) from error
        try:
            # This process has only one thread yet: nothing can hold a lock at the fork.
            return subprocess.Popen(
                command,
                stdin=streams[0],
                stdout=streams[1],
                stderr=streams[2],
                env=self._spec["environment"],
                umask=self._spec["umask"],
                process_group=0,
                preexec_fn=self._before_exec,
            )
        except OSError as error:
            status = 127 if isinstance(error, (FileNotFoundError, NotADirectoryError)) else 126
            raise CannotRunError(status, f"cannot run {command[0]!r}: {error.strerror}") from error

    def _before_exec(self) -> None:
        for number in self._spec["ignored"]:
            signal.signal(number, signal.SIG_IGN)
        if self._terminal is not None:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
            os.tcsetpgrp(self._terminal[1], os.getpid())
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTTOU})

    def _start_pumps(self, ours: list[int | None]) -> None:
        kinds = self._spec["streams"]
        for number, name in ((1, "out"), (2, "err")):
            source = ours[number]
            if source is not None:
                self._pumps[name] = OutputPump(source, open_line(number + 1))
        if self._terminal is not None:
            os.close(self._terminal[1])
            name = "out" if kinds[1] == "tty" else "err"
            if name == "out" or kinds[2] == "tty":
                line = open_line(2 if name == "out" else 3)
                self._pumps[name] = OutputPump(os.dup(self._terminal[0]), line)
        if kinds[0] != "null":
            self._start_input(ours[0])

    def _start_input(self, pipe: int | None) -> None:
        line = open_line(1)
        if pipe is not None:
            arguments = (line, pipe, lambda: os.close(pipe))
        else:
            assert self._terminal is not None
            master = self._terminal[0]
            arguments = (line, master, lambda: write_all(master, VEOF))
        threading.Thread(target=pump_input, args=arguments, daemon=True).start()

    def obey(self, message: Message) -> None:
        if "signal" in message:
            self._signal(message["signal"], message["group"])
        if "size" in message and self._terminal is not None:
            set_size(self._terminal[0], message["size"])
        if "close" in message and message["close"] in self._pumps:
            self._pumps[message["close"]].close()

    def _signal(self, number: int, group: bool) -> None:
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(self._pid, number)

    def wait(self) -> int:
        """Returns the command's exit status as a shell gives it."""
        while True:
            _, status = os.waitpid(self._pid, os.WUNTRACED)
            if os.WIFSTOPPED(status):
                self._control.send(stopped=os.WSTOPSIG(status))
            else:
                code = os.waitstatus_to_exitcode(status)
                return code if code >= 0 else 128 - code

    def finish(self) -> None:
        for pump in self._pumps.values():
            pump.finish()


def listen(control: Control, obey: Callable[[Message], None]) -> None:
    """Obeys the host until it is gone, and then has no reason to stay."""
    with contextlib.suppress(OSError):
        while (message := control.receive()) is not None:
            obey(message)
    power_off()


def power_off() -> NoReturn:
    os.sync()
    ctypes.CDLL(None).reboot(0x4321FEDC)  # LINUX_REBOOT_CMD_POWER_OFF, <linux/reboot.h>
    raise SystemExit("the kernel did not switch itself off")


def run(spec: Message, control: Control) -> Message:
    """Returns the last message: what the host is told at the end."""
    session = Session(spec, control)
    try:
        session.start()
    except CannotRunError as error:
        return {"exit": error.status, "failed": str(error)}
    threading.Thread(target=listen, args=(control, session.obey), daemon=True).start()
    control.send(ready=True)
    status = session.wait()
    session.finish()
    return {"exit": status}


def serve(spec: Message) -> NoReturn:
    control = Control(open_line(0))
    last = run(spec, control)
    with contextlib.suppress(ProcessLookupError):
        os.kill(-1, signal.SIGKILL)  # whoever is left must not write to the host's files after the last sync
    os.sync()
    control.send(**last)
    while True:
        signal.pause()


def bury_all() -> None:
    """What the first process owes the others: it inherits every orphan."""
    with contextlib.suppress(ChildProcessError):
        while True:
            os.wait()


def main(spec_path: str) -> None:
    with open(spec_path) as file:
        spec = json.load(file)
    prepare(spec)
    # A second process leads the session, as a shell does: Ctrl-Z never stops children of the first.
    if os.fork() == 0:
        serve(spec)
    bury_all()


if __name__ == "__main__":
    main(sys.argv[1])
