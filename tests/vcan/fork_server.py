"""Starts `vehicle-iface` processes by a fork of one that has already imported it.

In a kernel of `tools/vcan` four fifths of a program's start are its imports, and the tests start hundreds of programs.
What a fork runs is the same `python -m vehicle_iface`, in a process, session and environment of its own.
What is read at exec, such as `MALLOC_…` and `PYTHON…`, is the server's.
"""

import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import TypedDict

_LONGEST = 1 << 20
_MODULES = ("vehicle_iface.cli", "vehicle_iface.compose")


class _Job(TypedDict):
    """What a child runs."""

    arguments: list[str]
    environment: dict[str, str]
    folder: str


class Forked:
    """A program that the server has started: what the tests need of `subprocess.Popen`."""

    def __init__(self, pid: int, output: int, status: int) -> None:
        """`output` and `status` are file descriptors that this object closes."""
        self.pid = pid
        self.stdout = open(output, encoding="utf-8")  # noqa: SIM115, its reader closes it
        self._status_fd = status
        self._status: int | None = None
        self._lock = threading.Lock()

    def poll(self) -> int | None:
        """Its exit status, negative for a signal; None while it runs."""
        return self._read_status(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Its exit status; raises `subprocess.TimeoutExpired`."""
        status = self._read_status(timeout)
        if status is None:
            raise subprocess.TimeoutExpired("vehicle-iface", timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        """To the process, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def _read_status(self, timeout_s: float | None) -> int | None:
        with self._lock:
            if self._status is None and select.select([self._status_fd], [], [], timeout_s)[0]:
                text = os.read(self._status_fd, 16)
                os.close(self._status_fd)
                assert text, "the fork server has ended before its child"
                self._status = int(text)
            return self._status


class ForkServer:
    """The client's side."""

    def __init__(self, root: Path) -> None:
        """Starts the server with the sources of `root`."""
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket = ours
        environment = os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONPATH": str(root)}
        command = [sys.executable, str(Path(__file__).resolve()), str(its.fileno())]
        self._server = subprocess.Popen(
            command,
            env=environment,
            pass_fds=[its.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,  # a pipe like that of its children, which take over what Python knows of it
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        its.close()

    def start(self, arguments: list[str], environment: dict[str, str], folder: Path) -> Forked:
        """`vehicle-iface ARGUMENTS…`; its output and errors are one text."""
        job = _Job(arguments=arguments, environment=environment, folder=str(folder))
        read_output, write_output = os.pipe()
        read_status, write_status = os.pipe()
        socket.send_fds(self._socket, [json.dumps(job).encode()], [write_output, write_status])
        os.close(write_output)
        os.close(write_status)
        pid = self._socket.recv(16)
        assert pid, f"the fork server has ended: {self._server.communicate()[0].decode()}"
        return Forked(int(pid), read_output, read_status)

    def close(self) -> None:
        """End the server; the programs go on."""
        self._socket.close()
        self._server.communicate()


def serve(requests: socket.socket) -> _Job | None:
    """Fork for each request until the client closes its end; returns a job in each child."""
    wake_read, wake_write = os.pipe()
    os.set_blocking(wake_write, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake_write)
    status_fds: dict[int, int] = {}
    while True:
        ready, _, _ = select.select([requests.fileno(), wake_read], [], [])
        if wake_read in ready:
            os.read(wake_read, 4096)
            _report_ended(status_fds)
        if requests.fileno() not in ready:
            continue
        request, fds, _, _ = socket.recv_fds(requests, _LONGEST, 2)
        if not request:
            return None
        output, status_fd = fds
        pid = os.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.dup2(output, 1)
            os.dup2(output, 2)
            for number in (wake_read, wake_write, output, status_fd, *status_fds.values()):
                os.close(number)
            requests.close()
            os.setsid()
            job: _Job = json.loads(request)
            return job
        os.close(output)
        status_fds[pid] = status_fd
        requests.send(str(pid).encode())


def _report_ended(status_fds: dict[int, int]) -> None:
    while status_fds:
        pid, wait_status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            return
        status_fd = status_fds.pop(pid)
        try:
            os.write(status_fd, str(os.waitstatus_to_exitcode(wait_status)).encode())
        except BrokenPipeError:
            pass  # nobody asks for it any more
        finally:
            os.close(status_fd)


def main() -> None:
    """The server's process, and each of its children."""
    for module in _MODULES:
        __import__(module)
    assert len(os.listdir("/proc/self/task")) == 1, "a fork would lose the other threads"
    sys.path.pop(0)  # this file's folder, which `python -m` would not have
    job = serve(socket.socket(fileno=int(sys.argv[1])))
    if job is not None:
        os.environ.clear()
        os.environ.update(job["environment"])
        os.chdir(job["folder"])
        sys.path.insert(0, job["folder"])
        sys.argv[1:] = job["arguments"]
        runpy.run_module("vehicle_iface", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
