"""tools/vcan as users run it: a command run through it looks like the command itself."""

import contextlib
import fcntl
import hashlib
import os
import signal
import struct
import subprocess
import sys
import tempfile
import termios
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest
from vcan_kernel.host import reserve_processor

from .running import TOOLS

VCAN = str(TOOLS / "vcan")


def run(*command: str, stdin: bytes = b"", cwd: str | None = None) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([VCAN, *command], input=stdin, capture_output=True, cwd=cwd)


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def status(code: int) -> int:
    """As a shell gives it: tools/vcan may have become the command, and then dies by its signal itself."""
    return code if code >= 0 else 128 - code


@contextlib.contextmanager
def started(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A command that has said its first line, so that it is known to be there."""
    with subprocess.Popen([VCAN, *command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"up\n"
            yield process
        finally:
            process.kill()


class Terminal:
    """A command in front of a terminal of its own."""

    def __init__(self, *command: str, rows: int = 24, columns: int = 80) -> None:
        self.fd, inside = os.openpty()
        self.resize(rows, columns)
        # setsid makes it the controlling terminal, without which there are neither Ctrl-C nor SIGWINCH.
        self.process = subprocess.Popen(["setsid", "--ctty", *command], stdin=inside, stdout=inside, stderr=inside)
        os.close(inside)
        self.seen = b""

    def resize(self, rows: int, columns: int) -> None:
        fcntl.ioctl(self.fd, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def read_until(self, text: bytes) -> None:
        while text not in self.seen:
            self.seen += os.read(self.fd, 4096)

    def type(self, keys: bytes) -> None:
        os.write(self.fd, keys)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.fd)


@contextlib.contextmanager
def terminal(*command: str, rows: int = 24, columns: int = 80) -> Iterator[Terminal]:
    opened = Terminal(*command, rows=rows, columns=columns)
    try:
        yield opened
    finally:
        opened.close()


@pytest.fixture(autouse=True)
def heeded_signals() -> Iterator[None]:
    """A shell that starts us in the background has us ignore some, and what we start would inherit that."""
    usual = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT)
    heeded = [number for number in usual if signal.getsignal(number) is signal.SIG_IGN]
    for number in heeded:
        signal.signal(number, lambda *_: None)
    yield
    for number in heeded:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture
def folder() -> Iterator[Path]:
    """A short path: tools/vcan takes it for its own files."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def test_a_frame_sent_on_vcan0_is_received_there() -> None:
    code = """
import socket
with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as one, socket.socket(
    socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW
) as other:
    one.bind(("vcan0",))
    other.bind(("vcan0",))
    one.send(bytes([0x23, 1, 0, 0, 2, 0, 0, 0, 7, 8, 0, 0, 0, 0, 0, 0]))
    print(other.recv(16).hex())
"""
    assert run(*python(code)).stdout == b"23010000020000000708000000000000\n"


def test_pipes_stay_apart_and_are_not_taken_for_terminals_and_the_exit_status_is_the_commands() -> None:
    done = run("sh", "-c", "for fd in 0 1 2; do [ -t $fd ] && echo terminal; done; echo out; echo err >&2; exit 7")
    assert (done.stdout, done.stderr, done.returncode) == (b"out\n", b"err\n", 7)


def test_output_and_errors_into_one_pipe_keep_their_order() -> None:
    script = "for n in 1 2 3; do echo out$n; echo err$n >&2; done"
    done = subprocess.run([VCAN, "sh", "-c", script], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert done.stdout.split() == [b"out1", b"err1", b"out2", b"err2", b"out3", b"err3"]


def test_a_command_ended_by_a_signal_gives_128_and_its_number() -> None:
    assert status(run("sh", "-c", "kill -SEGV $$").returncode) == 128 + signal.SIGSEGV


def test_an_unknown_command_is_named_and_gives_127() -> None:
    done = run("no-such-command")
    assert done.returncode == 127
    assert done.stderr == b"tools/vcan: cannot run 'no-such-command': No such file or directory\n"


def test_a_file_that_is_no_program_gives_126() -> None:
    assert run("/etc/passwd").returncode == 126


def test_no_command_is_bad_usage_with_an_example() -> None:
    done = run()
    assert done.returncode == 2
    assert b"tools/vcan candump vcan0" in done.stderr


def test_every_byte_of_the_input_arrives_and_its_end_too() -> None:
    data = bytes(range(256)) * 400
    assert run("cat", stdin=data).stdout == data


def test_five_megabytes_of_output_arrive_intact() -> None:
    code = "import sys; [sys.stdout.buffer.write(bytes([n % 256]) * 5000) for n in range(1000)]"
    expected = hashlib.sha256(b"".join(bytes([n % 256]) * 5000 for n in range(1000))).hexdigest()
    assert hashlib.sha256(run(*python(code)).stdout).hexdigest() == expected


def test_a_reader_that_has_enough_ends_an_endless_command() -> None:
    script = f"'{VCAN}' yes | head -n 2"
    assert subprocess.run(["sh", "-c", script], capture_output=True).stdout == b"y\ny\n"


def test_folder_environment_and_umask_are_the_callers(folder: Path) -> None:
    script = f"umask 027; WORD='two words' exec '{VCAN}' sh -c 'pwd; echo $WORD; umask; echo hello >file'"
    done = subprocess.run(["sh", "-c", script], capture_output=True, cwd=folder)
    assert done.stdout.decode().splitlines() == [str(folder.resolve()), "two words", "0027"]
    assert (folder / "file").read_text() == "hello\n"


def test_each_signal_reaches_the_command() -> None:
    names = ("HUP", "INT", "QUIT", "TERM", "USR1", "USR2", "WINCH")
    traps = "; ".join(f"trap 'echo got {name}' {name}" for name in names)
    with started("bash", "-c", f"{traps}; echo up; while :; do sleep 0.05; done") as process:
        assert process.stdout is not None
        for name in names:
            process.send_signal(signal.Signals[f"SIG{name}"])
            assert process.stdout.readline() == f"got {name}\n".encode()


def test_the_command_has_a_terminal_of_the_callers_size_that_follows_it() -> None:
    script = "trap 'stty size; exit' WINCH; tty -s && stty size; while :; do sleep 0.05; done"
    with terminal(VCAN, "bash", "-c", script, rows=33, columns=101) as screen:
        screen.read_until(b"33 101")
        screen.resize(40, 120)
        screen.read_until(b"40 120")
        assert screen.process.wait() == 0


def test_ctrl_c_interrupts_what_is_in_front_of_the_terminal() -> None:
    with terminal(VCAN, "sh", "-c", "echo up; exec sleep 1000") as screen:
        screen.read_until(b"up")
        screen.type(b"\x03")
        assert status(screen.process.wait()) == 128 + signal.SIGINT


def test_ctrl_z_stops_it_and_fg_lets_it_go_on() -> None:
    script = f"set -m; '{VCAN}' sh -c 'echo up; exec tr a-z A-Z'; test $? -gt 128 && echo stopped; fg"
    with terminal("bash", "-c", script) as screen:
        screen.read_until(b"up")
        screen.type(b"\x1a")
        screen.read_until(b"stopped")
        screen.type(b"hello\n")
        screen.read_until(b"HELLO")
        screen.type(b"\x04")
        assert screen.process.wait() == 0


def test_typed_input_is_read_and_ctrl_d_ends_it() -> None:
    with terminal(VCAN, "sh", "-c", "echo up; exec tr a-z A-Z") as screen:
        screen.read_until(b"up")
        screen.type(b"hello\n\x04")
        screen.read_until(b"HELLO")
        assert screen.process.wait() == 0


def test_killing_it_leaves_no_kernel_and_no_files_behind(folder: Path) -> None:
    alive, held = os.pipe()
    environment = {**os.environ, "TMPDIR": str(folder)}
    command = [VCAN, "sh", "-c", "echo up; exec sleep 1000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, pass_fds=[held]) as process:
        os.close(held)
        assert process.stdout is not None
        assert process.stdout.readline() == b"up\n"
        process.kill()
    # Whoever clears up after it inherited the other end, and is gone when this one ends.
    assert os.read(alive, 1) == b""
    os.close(alive)
    assert list(folder.iterdir()) == []


def test_on_a_kernel_with_socketcan_it_restores_vcan0_and_becomes_the_command() -> None:
    script = f"ip link del vcan0; echo $$; exec '{VCAN}' sh -c 'echo $$; cat /sys/class/net/vcan0/type'"
    outer, inner, kind = run("sh", "-c", script).stdout.split()
    assert outer == inner
    assert int(kind) == 280  # ARPHRD_CAN, <linux/if_arp.h>


def test_two_kernels_do_not_share_a_processor_where_there_are_two() -> None:
    with mock.patch.object(os, "sched_getaffinity", return_value={1001, 1002}):  # no kernel that runs now has those
        first, first_reservation = reserve_processor()
        second, second_reservation = reserve_processor()
        third, third_reservation = reserve_processor()
        first_reservation.close()
        again, again_reservation = reserve_processor()
    for reservation in (second_reservation, third_reservation, again_reservation):
        reservation.close()
    assert {first, second} == {1001, 1002}
    assert third in {1001, 1002}
    assert again == first
