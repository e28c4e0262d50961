"""The recorder as the loop knows it: a process to start, and to end; in between nothing is asked of it."""

import contextlib
import json
import logging
import select
import signal
import subprocess
from pathlib import Path
from typing import Any, Self

import msgspec

from vehicle_iface.errors import BusError, ConfigError
from vehicle_iface.process import python_module
from vehicle_iface.recorder.files import SUMMARY, Report
from vehicle_iface.recorder.folder import Order

log = logging.getLogger(__name__)

END = b"end\n"
BEGIN_S, ENDING_S = 20.0, 5.0
"""Waited for before anything drives, and after the vehicle was let go."""


class Answer(msgspec.Struct, kw_only=True, frozen=True):
    """A line of the recorder's output."""

    refusal: str = ""
    is_bus: bool = False
    report: Report | None = None


class Recording:
    """A recorder at work. `ConfigError` or `BusError` when it cannot record."""

    def __init__(self, order: Order) -> None:
        self._folder = Path(order.folder)
        self._is_stuck = self._is_over = False
        command_line, environment = python_module("vehicle_iface.recorder")
        self._process = subprocess.Popen(
            command_line,
            env=environment,
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the loop: how the vehicle is stopped is to be recorded
        )
        answer = self._begin(msgspec.json.encode(order) + b"\n")
        if answer.refusal:
            self._process.wait()
            raise (BusError if answer.is_bus else ConfigError)(answer.refusal)
        signal.signal(signal.SIGCHLD, self._look)

    def end(self) -> dict[str, Any]:
        """Its account, for the summary; a recorder that does not give one in `ENDING_S` is killed."""
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        self._is_over = True
        try:
            output, _ = self._process.communicate(END, ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._is_stuck = True
            return self._told("has not ended in time and was killed; what it had not written is LOST")
        try:
            report = msgspec.json.decode(output, type=Answer).report
        except msgspec.MsgspecError:
            report = None
        if report is None:
            return self._told(f"was gone before the end, status {self._process.returncode}; what came then is LOST")
        return self._told(report.in_words, written=report.written, lost=report.lost, trouble=report.trouble)

    def save_summary(self, summary: dict[str, Any]) -> None:
        """Beside the rest; not where the recorder got stuck, for so would we."""
        if self._is_stuck:
            return
        try:
            with open(self._folder / SUMMARY, "x", encoding="utf-8") as file:
                file.write(json.dumps(summary, indent=2) + "\n")
        except OSError as error:
            log.error("recorder: %s cannot be written: %s", self._folder / SUMMARY, error.strerror)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._is_over:
            self.end()

    def _begin(self, order: bytes) -> Answer:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(order)
        ear = select.poll()  # select knows no descriptor above 1023
        ear.register(self._process.stdout, select.POLLIN)
        if not ear.poll(BEGIN_S * 1e3):
            self._process.kill()
            return Answer(refusal=f"--record {self._folder}: the recorder has not begun within {BEGIN_S:.0f} s")
        try:
            return msgspec.json.decode(self._process.stdout.readline(), type=Answer)
        except msgspec.MsgspecError:
            return Answer(refusal=f"--record {self._folder}: the recorder has ended by itself, see above")

    def _look(self, *_: object) -> None:
        """A child has ended; say so when it is this one."""
        status = self._process.poll()
        if status is not None:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            log.error("the recorder is gone (status %d): nothing more is recorded, the drive goes on", status)

    def _told(self, text: str, **account: Any) -> dict[str, Any]:
        return {"folder": str(self._folder), "text": f"{self._folder}: {text}"} | account
