"""The recorder's process, as the loop starts and stops it."""

import contextlib
import fcntl
import logging
import os
import select
import signal
import subprocess
from pathlib import Path
from typing import Self

import msgspec

from vehicle_iface.errors import BusError, ConfigError
from vehicle_iface.process import module_command
from vehicle_iface.recorder.files import SUMMARY, RecorderStatus
from vehicle_iface.recorder.folder import RecordingRequest
from vehicle_iface.telemetry.details import RecorderSummary

log = logging.getLogger(__name__)

END = b"end\n"
START_TIMEOUT_S, STOP_TIMEOUT_S = 20.0, 5.0
"""Time limits for the recorder's start, before the loop drives, and its end, after the vehicle was released."""


INPUTS_TIMEOUT_S = 1.0
INPUTS_PIPE_BYTES = 1 << 20
"""Room in the pipe for the inputs of more than ten seconds."""


class RecorderReply(msgspec.Struct, kw_only=True, frozen=True):
    """A line of the recorder's output."""

    refusal: str = ""
    is_bus: bool = False
    status: RecorderStatus | None = None


class RecorderProcess:
    """A running recorder. `ConfigError` or `BusError` when it cannot record."""

    def __init__(self, request: RecordingRequest) -> None:
        self._folder = Path(request.folder or request.black_box)
        self.records_inputs = bool(request.folder)
        """Whether it records more than black boxes."""
        self._is_stuck = self._is_over = False
        command_line, environment = module_command("vehicle_iface.recorder")
        reader, self._writer = _open_pipe()
        if self.records_inputs:
            request = msgspec.structs.replace(request, inputs_fd=reader)
        self._process = subprocess.Popen(
            command_line,
            env=environment,
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the loop: the stop it causes is recorded
            pass_fds=(reader,),
        )
        os.close(reader)
        reply = self._start(msgspec.json.encode(request) + b"\n")
        if reply.refusal:
            self._process.wait()
            os.close(self._writer)
            raise (BusError if reply.is_bus else ConfigError)(reply.refusal)
        signal.signal(signal.SIGCHLD, self._on_child_exit)

    def write_inputs(self, data: bytes | bytearray) -> int:
        """Hand inputs of the loop to the recorder without waiting; return how many bytes it took.

        A recorder that is gone takes all: nothing is recorded any more, and its exit was logged.
        """
        try:
            return os.write(self._writer, data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def write_last_inputs(self, data: bytes) -> None:
        """Hand over the rest; a recorder that takes nothing for `INPUTS_TIMEOUT_S` gets no more."""
        output = select.poll()
        output.register(self._writer, select.POLLOUT)
        while data and output.poll(INPUTS_TIMEOUT_S * 1e3):
            data = data[self.write_inputs(data) :]

    def end(self) -> RecorderSummary:
        """Stop the recorder and return its result. A recorder that does not stop within `STOP_TIMEOUT_S` is killed."""
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        self._is_over = True
        os.close(self._writer)
        try:
            output, _ = self._process.communicate(END, STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._is_stuck = True
            return self._summary("did not end in time and was killed; unwritten data is LOST")
        try:
            status = msgspec.json.decode(output, type=RecorderReply).status
        except msgspec.MsgspecError:
            status = None
        if status is None:
            return self._summary(f"exited early with status {self._process.returncode}; later data is LOST")
        ended = self._summary(status.text)
        return msgspec.structs.replace(ended, written=status.written, lost=status.lost, trouble=status.trouble)

    def save_summary(self, summary: bytes) -> None:
        """Write `summary.json`, unless the recorder got stuck: this process would, too."""
        if self._is_stuck or not self.records_inputs:
            return
        try:
            with open(self._folder / SUMMARY, "xb") as file:
                file.write(summary)
        except OSError as error:
            log.error("recorder: %s cannot be written: %s", self._folder / SUMMARY, error.strerror)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._is_over:
            self.end()

    def _start(self, request: bytes) -> RecorderReply:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(request)
        output = select.poll()  # select cannot handle descriptors above 1023
        output.register(self._process.stdout, select.POLLIN)
        if not output.poll(START_TIMEOUT_S * 1e3):
            self._process.kill()
            return RecorderReply(
                refusal=f"--record {self._folder}: the recorder did not start within {START_TIMEOUT_S:.0f} s"
            )
        try:
            return msgspec.json.decode(self._process.stdout.readline(), type=RecorderReply)
        except msgspec.MsgspecError:
            return RecorderReply(refusal=f"--record {self._folder}: the recorder exited, see above")

    def _on_child_exit(self, *_: object) -> None:
        """Log the end of the recorder."""
        status = self._process.poll()
        if status is not None:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            log.error("the recorder exited (status %d): recording has stopped, the drive continues", status)

    def _summary(self, text: str) -> RecorderSummary:
        return RecorderSummary(folder=str(self._folder), text=f"{self._folder}: {text}")


def _open_pipe() -> tuple[int, int]:
    """Open the pipe for the loop's inputs, as large as this user may have it: reader and writer."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(OSError, AttributeError):
        fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, INPUTS_PIPE_BYTES)
    return reader, writer
