"""The part of `tools/vcan` that runs here: finds SocketCAN, or boots a user-mode Linux kernel that has it."""

import argparse
import contextlib
import ctypes
import json
import os
import random
import re
import resource
import select
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import termios
import threading
import tty
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from vcan_kernel.guest import CHUNK, Control, read_frame, write_all, write_frame

HERE = Path(__file__).resolve().parent
TOOLS = HERE.parent
SETUP = TOOLS / "_setup.sh"
VENV = TOOLS.parent / ".venv"
MODULES = Path("/usr/lib/uml/modules")
SYSTEM_PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/local/sbin", "/usr/sbin", "/sbin"])

CREATE = "ip link add dev vcan0 type vcan && ip link set dev vcan0 up"
CREATE_BY_HAND = "sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up"

EXIT_FAILED = 125
BOOT_LIMIT_S = 60.0
SMALLEST_MEMORY = 512 << 20

SIGNALS = {
    signal.SIGHUP,
    signal.SIGINT,
    signal.SIGQUIT,
    signal.SIGTERM,
    signal.SIGUSR1,
    signal.SIGUSR2,
    signal.SIGTSTP,
    signal.SIGCONT,
    signal.SIGWINCH,
}
ENDING = {signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM}
SI_KERNEL = 0x80  # <asm-generic/siginfo.h>: sent by the terminal, so meant for everyone in front of it

DESCRIPTION = """\
Runs COMMAND where Linux SocketCAN and the interface vcan0 exist, and ends with its exit status.

Where this kernel has SocketCAN, vcan0 is created if it is missing, and COMMAND runs right here. Elsewhere a
user-mode Linux kernel is booted for it (Debian package user-mode-linux): same files, folder, environment,
streams, signals and terminal; root, one processor, a network of its own with lo and vcan0. /dev/shm and /run
start empty in there, and whatever COMMAND leaves running ends with it."""

EPILOG = f"""\
exit status: COMMAND's; 128+N if signal N ended it; 126 if it cannot be run, 127 if it is not found,
{EXIT_FAILED} if the kernel failed, 2 for bad usage."""


class VcanError(Exception):
    """Something is missing or broke; the message says how to mend it, or gives the kernel's last words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The command line."""

    command: list[str]
    mem: int | None
    verbose: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Streams:
    """What the caller's three standard streams are."""

    kinds: list[str]
    """Each of input, output, errors: tty, pipe (any other that is open), null (closed), same (as output)."""
    interactive: bool
    """The terminal is ours to switch to raw: keys, job control and colours then come from inside."""


@dataclass(slots=True)
class Machine:
    """A booted kernel, seen from outside: our ends of its four serial lines."""

    folder: Path
    lines: list[socket.socket]
    keeper_pid: int
    leash: int
    """While this pipe is open, the machine lives."""
    ready: threading.Event = field(default_factory=threading.Event)


def main() -> NoReturn:
    options = parse(sys.argv[1:])
    try:
        fill_closed_streams()
        status = run(options)
    except VcanError as error:
        print(f"tools/vcan: {error}", file=sys.stderr)
        status = EXIT_FAILED
    # Not sys.exit: a thread may be waiting for input that never comes.
    with contextlib.suppress(OSError):
        sys.stderr.flush()
    os._exit(status)


def parse(arguments: list[str]) -> Options:
    parser = argparse.ArgumentParser(
        prog="tools/vcan",
        usage="tools/vcan [--mem SIZE] [--verbose] COMMAND…",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    mem = "the booted kernel's memory, such as 512M or 4G; default: 4G, or what is free"
    parser.add_argument("--mem", type=size, metavar="SIZE", help=mem)
    parser.add_argument("--verbose", action="store_true", help="show how the kernel boots, as error output")
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="COMMAND…", help="what to run")
    found = parser.parse_args(arguments)
    command = found.command[1:] if found.command[:1] == ["--"] else found.command
    if not command:
        parser.error("which command? For example: tools/vcan candump vcan0")
    return Options(command=command, mem=found.mem, verbose=found.verbose)


def size(text: str) -> int:
    """Reads 512M or 4G as bytes."""
    units = {"M": 20, "G": 30}
    digits, unit = text[:-1], text[-1:].upper()
    if unit not in units or not digits.isdecimal() or int(digits) << units[unit] < SMALLEST_MEMORY:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size of at least 512M, such as 512M or 4G")
    return int(digits) << units[unit]


CLOSED: set[int] = set()


def fill_closed_streams() -> None:
    """Keeps the numbers 0 to 2 from being given to something else, where the caller closed them."""
    for fd in (0, 1, 2):
        try:
            os.fstat(fd)
        except OSError:
            CLOSED.add(fd)
            os.open(os.devnull, os.O_RDWR)


def run(options: Options) -> int:
    if has_socketcan() and has_vcan0():
        execute(options.command)
    set_up_for(options.command)
    return boot_and_run(options)


def set_up_for(command: list[str]) -> None:
    """What a program of this folder would install for itself is installed now: in the kernel there is no network."""
    program = Path(command[0]).resolve()
    if program.parent != TOOLS or not program.is_file() or VENV.exists():
        return
    if SETUP.name.encode() not in program.read_bytes():
        return
    line = f"source '{SETUP}' && set_up"
    if subprocess.run(["bash", "-c", line, "vcan"], stdin=subprocess.DEVNULL, check=False).returncode:
        raise VcanError(f"{command[0]} could not be set up, see above")


def has_socketcan() -> bool:
    return can_open_socket() or (become_root("modprobe -a can can_raw vcan") and can_open_socket())


def can_open_socket() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def has_vcan0() -> bool:
    """Creates it if need be; False where this kernel knows CAN but has no vcan, or keeps it from us."""
    if is_up("vcan0"):
        return True
    if shutil.which("ip", path=SYSTEM_PATH) is None:
        install("iproute2", "ip")
    script = CREATE if not Path("/sys/class/net/vcan0").exists() else "ip link set dev vcan0 up"
    if become_root(script) and is_up("vcan0"):
        return True
    if root_prefix() is None:
        raise VcanError(f"only root can create vcan0, which is missing; run: {CREATE_BY_HAND}")
    return False


def is_up(name: str) -> bool:
    try:
        return bool(int(Path(f"/sys/class/net/{name}/flags").read_text(), 16) & 1)
    except OSError:
        return False


def root_prefix() -> list[str] | None:
    """Returns what makes a command run as root without asking anyone, None where nothing does."""
    if os.geteuid() == 0:
        return []
    sudo = shutil.which("sudo")
    if sudo is None or not succeeds([sudo, "-n", "true"]):
        return None
    return [sudo, "-n"]


def succeeds(command: list[str]) -> bool:
    return subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL).returncode == 0


def become_root(script: str) -> bool:
    """Runs a line of shell as root; False where that is impossible or the line failed."""
    prefix = root_prefix()
    return prefix is not None and succeeds([*prefix, "env", f"PATH={SYSTEM_PATH}", "sh", "-c", script])


def install(package: str, program: str) -> str:
    """Returns the path of a program, after installing its Debian package if need be."""
    found = shutil.which(program, path=SYSTEM_PATH)
    if found is None and shutil.which("apt-get") is not None and root_prefix() is not None:
        print(f"tools/vcan: installing {package}, which has {program}", file=sys.stderr)
        apt = f"DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends {package}"
        _ = become_root(apt) or become_root(f"apt-get update && {apt}")
        found = shutil.which(program, path=SYSTEM_PATH)
    if found is None:
        mend = f"sudo apt-get update && sudo apt-get install -y {package}"
        raise VcanError(f"{program} is missing; run: {mend}")
    return found


def execute(command: list[str]) -> NoReturn:
    """Becomes the command."""
    for fd in CLOSED:
        os.close(fd)
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Python ignores it, and an ignored signal is inherited
    try:
        os.execvp(command[0], command)
    except OSError as error:
        status = 127 if isinstance(error, (FileNotFoundError, NotADirectoryError)) else 126
        print(f"tools/vcan: cannot run {command[0]!r}: {error.strerror}", file=sys.stderr)
        sys.stderr.flush()
        os._exit(status)


def boot_and_run(options: Options) -> int:
    streams = look_at_streams()
    ignored = [number for number in SIGNALS if signal.getsignal(number) == signal.SIG_IGN]
    folder = make_folder()
    try:
        kernel = build_command_line(options, folder)
        write_files(options, folder, streams, ignored)
        environment = kernel_environment(folder, kernel.tempdir)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    # Blocked before anything is started: what arrives from here on is kept until it can be passed on.
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS - set(ignored))
    machine = start(kernel.arguments, environment, folder, options.verbose)
    return Visit(machine, streams, SIGNALS - set(ignored)).run()


def look_at_streams() -> Streams:
    kinds = ["null" if fd in CLOSED else "tty" if os.isatty(fd) else "pipe" for fd in (0, 1, 2)]
    in_front = kinds[0] == "tty" and os.tcgetpgrp(0) == os.getpgrp()
    if kinds[0] == "tty" and not in_front:
        kinds[0] = "null"  # to read from a terminal in the background is to be stopped
    if kinds[1] == kinds[2] == "pipe" and os.path.sameopenfile(1, 2):
        kinds[2] = "same"  # one pipe keeps the order of what is written to both
    return Streams(kinds=kinds, interactive=in_front and kinds[1] == "tty")


HIDDEN = ("/dev", "/proc", "/run", "/sys")


def make_folder() -> Path:
    """Makes the folder of one run, at a path that a kernel's command line can hold and that exists inside."""
    candidates = [os.path.realpath(place) for place in (tempfile.gettempdir(), "/tmp", "/var/tmp")]
    place = next(place for place in candidates if is_plain(place))
    return Path(tempfile.mkdtemp(prefix="vcan-", dir=place))


def is_plain(place: str) -> bool:
    hidden = any(Path(place).is_relative_to(root) for root in HIDDEN)
    return not hidden and re.fullmatch(r"[A-Za-z0-9_./-]{1,60}", place) is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernel:
    """How to start it."""

    arguments: list[str]
    tempdir: str


def build_command_line(options: Options, folder: Path) -> Kernel:
    if os.uname().machine != "x86_64":
        raise VcanError("this kernel has no SocketCAN, and only x86-64 can boot its own; try: sudo modprobe vcan")
    program = install("user-mode-linux", "linux.uml")
    tempdir, mem = choose_memory(options.mem)
    arguments = [
        program,
        f"mem={mem >> 20}M",
        "rootfstype=hostfs",
        "root=/dev/root",
        "rw",
        f"init={folder}/init",
        f"uml_dir={folder}/",
        "umid=vcan",
        "con=null",
        "ssl=null",
        "panic=-1",
    ]
    return Kernel(arguments=arguments, tempdir=tempdir)


def choose_memory(wanted: int | None) -> tuple[str, int]:
    """Returns the folder for the kernel's memory file, tmpfs if it fits there, and the file's size."""
    free = {place: free_bytes(place) for place in ("/dev/shm", tempfile.gettempdir(), "/tmp", "/var/tmp")}
    mem = wanted if wanted is not None else min(4 << 30, available_memory() * 3 // 4)
    roomiest = max(free, key=lambda place: free[place])
    place = next((place for place, has in free.items() if has > mem), roomiest)
    fits = min(mem, free[place])
    if fits < (wanted or SMALLEST_MEMORY):
        raise VcanError(
            f"the kernel's memory of {max(mem, SMALLEST_MEMORY) >> 20} MiB does not fit: {place} has "
            f"{free[place] >> 20} MiB that may be executed; free some, or run: tools/vcan --mem 512M COMMAND…"
        )
    return place, fits


def free_bytes(place: str) -> int:
    """Counts a folder that forbids executing as full: the kernel maps its memory executable."""
    try:
        info = os.statvfs(place)
    except OSError:
        return 0
    usable = not info.f_flag & os.ST_NOEXEC and os.access(place, os.W_OK | os.X_OK)
    return info.f_bavail * info.f_frsize if usable else 0


def available_memory() -> int:
    lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    return int(lines["MemAvailable"].split()[0]) * 1024


def write_files(options: Options, folder: Path, streams: Streams, ignored: list[signal.Signals]) -> None:
    if not any(MODULES.glob("*/modules.dep.bin")):
        mend = "sudo apt-get install -y --reinstall user-mode-linux"
        raise VcanError(f"{MODULES} has no kernel modules; run: {mend}")
    (folder / "lib").mkdir()
    (folder / "lib/modules").symlink_to(MODULES)
    (folder / "spec").write_text(json.dumps(describe(options, folder, streams, ignored)))
    guest = [sys.executable, "-I", "-S", str(HERE / "guest.py"), f"{folder}/spec"]
    write_script(folder / "init", shlex.join(guest))
    modprobe = install("kmod", "modprobe")
    write_script(folder / "modprobe", f'{modprobe} -d {folder} "$@"')


def write_script(path: Path, line: str) -> None:
    path.write_text(f"#!/bin/sh\nexec {line}\n")
    path.chmod(0o755)


def describe(options: Options, folder: Path, streams: Streams, ignored: list[signal.Signals]) -> dict[str, Any]:
    umask = os.umask(0)
    os.umask(umask)
    terminal = next((fd for fd, kind in enumerate(streams.kinds) if kind == "tty"), None)
    return {
        "command": options.command,
        "cwd": os.getcwd(),
        "environment": dict(os.environ),
        "hostname": socket.gethostname(),
        "ignored": ignored,
        "interactive": streams.interactive,
        "ip": install("iproute2", "ip"),
        "modprobe": f"{folder}/modprobe",
        "size": None if terminal is None else terminal_size(terminal),
        "streams": streams.kinds,
        "termios": None if terminal is None else terminal_settings(terminal),
        "umask": umask,
    }


def terminal_size(fd: int) -> list[int]:
    columns, rows = os.get_terminal_size(fd)
    return [rows, columns]


def terminal_settings(fd: int) -> list[Any]:
    *numbers, chars = termios.tcgetattr(fd)
    return [*numbers, [char[0] if isinstance(char, bytes) else char for char in chars]]


def kernel_environment(folder: Path, tempdir: str) -> dict[str, str]:
    environment = {"PATH": SYSTEM_PATH, "TMPDIR": tempdir}
    if " amx_tile " in Path("/proc/cpuinfo").read_text():
        environment["LD_PRELOAD"] = build_xstate_library(folder)
    return environment


def build_xstate_library(folder: Path) -> str:
    """Compiles what lets this kernel run on CPUs with AMX; the source says why."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang") or install("gcc", "gcc")
    target = str(folder / "xstate.so")
    command = [compiler, "-O2", "-shared", "-fPIC", "-nostdlib", "-o", target, str(HERE / "xstate.c")]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode != 0:
        reason = done.stderr.strip()
        raise VcanError(f"{shlex.join(command)} failed: {reason}; try: sudo apt-get install -y gcc")
    return target


def start(arguments: list[str], environment: dict[str, str], folder: Path, verbose: bool) -> Machine:
    pairs = [socket.socketpair() for _ in range(4)]
    inside = [pair[1].fileno() for pair in pairs]
    lines = [f"ssl{number}=fd:{fd}" for number, fd in enumerate(inside)]
    log = os.dup(2) if verbose else os.open(folder / "log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    leash_out, leash_in = os.pipe()
    keeper = os.fork()
    if keeper == 0:
        os.close(leash_in)
        for pair in pairs:
            pair[0].close()
        keep([*arguments, *lines, f"con0=null,fd:{log}"], environment, inside, log, leash_out, folder)
    os.close(leash_out)
    os.close(log)
    for pair in pairs:
        pair[1].close()
    return Machine(folder=folder, lines=[pair[0] for pair in pairs], keeper_pid=keeper, leash=leash_in)


def keep(
    arguments: list[str], environment: dict[str, str], inside: list[int], log: int, leash: int, folder: Path
) -> NoReturn:
    """Keeps the kernel while the leash is held and clears everything away after, even if we were killed."""
    try:
        os.setsid()
        become_subreaper()
        processor, reservation = reserve_processor()
        kernel = subprocess.Popen(
            arguments,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            pass_fds=[*inside, log],
            start_new_session=True,
            preexec_fn=lambda: before_kernel(processor),
        )
        for fd in {0, 1, 2, log, *inside}:
            os.close(fd)
        wait_for_either(kernel.pid, leash)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(kernel.pid, signal.SIGKILL)
        bury_all()
        reservation.close()
        wait_for_end(leash)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os._exit(0)


def reserve_processor() -> tuple[int, socket.socket]:
    """A processor that no other kernel runs on, if there is one; reserved until the socket is closed."""
    reservation = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    processors = sorted(os.sched_getaffinity(0))
    for processor in processors:
        with contextlib.suppress(OSError):
            reservation.bind(f"\0vehicle-iface kernel on processor {processor}")
            return processor, reservation
    return random.choice(processors), reservation


def before_kernel(processor: int) -> None:
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # It and its processes take turns, one system call after the other. If each turn wakes another processor,
    # a system call takes 80 µs instead of 8 (measured on a virtual machine with two).
    os.sched_setaffinity(0, {processor})


def become_subreaper() -> None:
    """Makes the kernel's helpers ours when it dies; nobody else may be there to bury them."""
    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER, <linux/prctl.h>


def wait_for_either(pid: int, leash: int) -> None:
    poll = select.poll()
    poll.register(os.pidfd_open(pid), select.POLLIN)
    poll.register(leash, select.POLLIN)
    poll.poll()


def wait_for_end(leash: int) -> None:
    os.read(leash, 1)


def bury_all() -> None:
    with contextlib.suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)


class Visit:
    """One command inside one machine: carries streams and signals until it ends."""

    def __init__(self, machine: Machine, streams: Streams, signals: set[signal.Signals]) -> None:
        self._machine = machine
        self._streams = streams
        self._signals = signals
        self._control = Control(machine.lines[0].fileno())
        self._settings: list[Any] | None = None
        self._outputs: list[threading.Thread] = []
        self._interrupted: signal.Signals | None = None

    def run(self) -> int:
        threading.Thread(target=self._pass_signals, daemon=True).start()
        try:
            return self._run()
        finally:
            self._leave_raw()
            self._release()

    def _run(self) -> int:
        first = self._first_message()
        if "ready" in first:
            self._start_streams()
            first = self._follow()
        for thread in self._outputs:
            thread.join()
        if "failed" in first:
            print(f"tools/vcan: {first['failed']}", file=sys.stderr)
        status: int = first["exit"]
        return status

    def _first_message(self) -> dict[str, Any]:
        poll = select.poll()
        poll.register(self._machine.lines[0], select.POLLIN)
        if not poll.poll(BOOT_LIMIT_S * 1000):
            raise VcanError(f"the kernel did not come up within {BOOT_LIMIT_S:.0f} s{self._last_words()}")
        message = self._receive()
        if self._interrupted is not None:
            return {"exit": 128 + self._interrupted}
        if message is None:
            raise VcanError(f"the kernel did not come up{self._last_words()}")
        return message

    def _receive(self) -> dict[str, Any] | None:
        try:
            return self._control.receive()
        except ConnectionError:
            return None

    def _start_streams(self) -> None:
        self._machine.ready.set()
        if self._streams.interactive:
            self._enter_raw()
        kinds = self._streams.kinds
        if kinds[0] != "null":
            threading.Thread(target=self._carry_input, daemon=True).start()
        for fd, name in ((1, "out"), (2, "err")):
            if kinds[fd] == "pipe" or (kinds[fd] == "tty" and (fd == 1 or kinds[1] != "tty")):
                thread = threading.Thread(target=self._carry_output, args=(fd, name), daemon=True)
                thread.start()
                self._outputs.append(thread)

    def _follow(self) -> dict[str, Any]:
        """Returns the last message."""
        while (message := self._receive()) is not None:
            if "exit" in message:
                return message
            if "stopped" in message:
                self._leave_raw()
                os.killpg(0, signal.SIGSTOP)  # all in front of a terminal stop together
        raise VcanError(f"the kernel died{self._last_words()}")

    def _carry_input(self) -> None:
        line = self._machine.lines[1].fileno()
        with contextlib.suppress(OSError):
            while data := os.read(0, CHUNK):
                write_frame(line, data)
            write_frame(line, b"")

    def _carry_output(self, fd: int, name: str) -> None:
        line = self._machine.lines[fd + 1].fileno()
        wanted = True
        while data := read_frame(line):
            try:
                if wanted:
                    write_all(fd, data)
            except OSError:  # its reader is gone
                wanted = False
                self._control.send(close=name)

    def _pass_signals(self) -> None:
        while True:
            arrived = signal.sigwaitinfo(self._signals)
            number = signal.Signals(arrived.si_signo)
            if not self._machine.ready.is_set():
                self._signal_while_booting(number)
                continue
            with contextlib.suppress(OSError):
                self._pass_signal(number, arrived.si_code == SI_KERNEL)

    def _signal_while_booting(self, number: signal.Signals) -> None:
        if number in ENDING:
            self._interrupted = number
            self._machine.lines[0].shutdown(socket.SHUT_RDWR)  # wakes who waits for the first message

    def _pass_signal(self, number: signal.Signals, from_terminal: bool) -> None:
        if number == signal.SIGCONT and self._streams.interactive:
            self._enter_raw()
        if number in (signal.SIGCONT, signal.SIGWINCH) and "tty" in self._streams.kinds:
            self._control.send(size=terminal_size(self._streams.kinds.index("tty")))
        if number != signal.SIGWINCH or "tty" not in self._streams.kinds:
            job = number in (signal.SIGCONT, signal.SIGTSTP)
            self._control.send(signal=number, group=from_terminal or job)

    def _enter_raw(self) -> None:
        if self._settings is None and os.tcgetpgrp(0) == os.getpgrp():
            self._settings = termios.tcgetattr(0)
            tty.setraw(0, termios.TCSADRAIN)  # keeps what was typed ahead

    def _leave_raw(self) -> None:
        if self._settings is not None:
            termios.tcsetattr(0, termios.TCSADRAIN, self._settings)
            self._settings = None

    def _release(self) -> None:
        """Lets go of the machine and waits until nothing is left of it."""
        os.close(self._machine.leash)
        os.waitpid(self._machine.keeper_pid, 0)

    def _last_words(self) -> str:
        """Returns the end of the kernel's log up to its panic; the stack after that tells a user nothing."""
        try:
            lines = (self._machine.folder / "log").read_text(errors="replace").splitlines()
        except OSError:
            return "; its messages are above"
        panic = next((number for number, line in enumerate(lines) if "Kernel panic" in line), len(lines))
        return "; its last words:\n  " + "\n  ".join(lines[max(0, panic - 12) : panic + 1])
