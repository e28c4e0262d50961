"""The newest report and samples for the page: starts the listener's process for the session that is shown, and reads
its output."""

from __future__ import annotations

import contextlib
import os
import subprocess
from typing import Protocol

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.process import module_command
from vehicle_iface.profile import load_profile, profile_names
from vehicle_iface.telemetry import SessionInfo
from vehicle_iface_viewer.bus_table.bus_signals import BusSignals
from vehicle_iface_viewer.bus_table.report import BusReport, BusSamples, ListenRequest, PlotRequest, SignalKey
from vehicle_iface_viewer.feed import View

_SOCKETCAN = "SocketCAN "
_READ_BYTES = 1 << 16
NO_FRAMES = "The bus of this demo is inside the program: there are no frames to list."


class BusTableSource(Protocol):
    """What the page asks for the table of messages, and for the signals that are plotted."""

    @property
    def signals(self) -> BusSignals: ...

    def read(self, view: View) -> BusReport | None:
        """Return the newest report for the session of `view`; None before the first one."""

    def fork(self) -> BusTableSource:
        """Return one for another drive, or another time of it."""

    def close(self) -> None:
        """Release all resources."""


class ListenerProcess:
    """Runs one listener at a time: that of the newest session."""

    def __init__(self, profile: str | None) -> None:
        """`profile` is a name or a file; without it, the session's is used if it is shipped with the program.

        Raises `ConfigError` when `profile` cannot be loaded.
        """
        self._profile = profile
        self._name = load_profile(profile).name if profile is not None else ""
        self._session = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._unread = self._unsent = b""
        self._report: BusReport | None = None
        self.signals = BusSignals()
        """Those of the session, for all browsers."""
        self._request, self._plotted = 0, list[SignalKey]()

    def read(self, view: View) -> BusReport | None:
        """Return the newest report for the session of `view`; None before the first one."""
        if view.session != self._session and view.info is not None:
            self._session = view.session
            self.close()
            self._start(view.info)
        if self._process is not None:
            self._choose_signals(self._process)
            self._read_output(self._process)
        self.signals.update(self._report)
        return self._report

    def fork(self) -> ListenerProcess:
        """Return one for another loop."""
        return ListenerProcess(self._profile)

    def close(self) -> None:
        """End the listener."""
        process, self._process, self._report = self._process, None, None
        self._unread = self._unsent = b""
        self._plotted = []
        self.signals.clear()
        if process is not None:
            process.kill()  # it has nothing to lose, and may still be reading a large DBC
            process.communicate()

    def _start(self, info: SessionInfo) -> None:
        if not has_frames(info):
            self._report = BusReport(note=NO_FRAMES)
            return
        try:
            request = self._listen_request(info)
        except ConfigError as error:
            self._report = BusReport(problem=str(error))
            return
        command, environment = module_command("vehicle_iface_viewer.bus_table")
        self._process = subprocess.Popen(
            command,
            env=environment,
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        os.set_blocking(self._process.stdin.fileno(), False)
        self._unsent = msgspec.json.encode(request) + b"\n"
        self._send(self._process)

    def _listen_request(self, info: SessionInfo) -> ListenRequest:
        if self._profile is not None and self._name != info.profile:
            raise ConfigError(f"view --profile is {self._name}, and the loop drives {info.profile}: give its profile")
        if self._profile is None and info.profile not in profile_names():
            raise ConfigError(
                f"profile {info.profile} is not shipped with this program: start view with --profile FILE, as the loop"
            )
        return ListenRequest(profile=self._profile or info.profile, channels=parse_channels(info.channel))

    def _choose_signals(self, process: subprocess.Popen[bytes]) -> None:
        """Have the listener sample what is plotted now; later, if it has not read the last request yet."""
        wanted = self.signals.advance()
        if wanted != self._plotted and not self._unsent:
            self._plotted = wanted
            self._request += 1
            self._unsent = msgspec.json.encode(PlotRequest(number=self._request, signals=wanted)) + b"\n"
        self._send(process)

    def _send(self, process: subprocess.Popen[bytes]) -> None:
        if self._unsent:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                self._unsent = self._unsent[process.stdin.write(self._unsent) or 0 :]

    def _read_output(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        while chunk := process.stdout.read(_READ_BYTES):
            self._unread += chunk
        *lines, self._unread = self._unread.split(b"\n")
        for line in lines:
            with contextlib.suppress(msgspec.MsgspecError):
                self._receive(msgspec.json.decode(line, type=BusReport | BusSamples))
        if process.poll() is not None and not (self._report and self._report.problem):
            self._report = BusReport(problem=f"the listener has ended (status {process.returncode}); restart view")

    def _receive(self, line: BusReport | BusSamples) -> None:
        if isinstance(line, BusReport):
            self._report = line
        elif line.request == self._request:
            self.signals.extend(self._plotted, line.signals)


def has_frames(info: SessionInfo | None) -> bool:
    """Whether the session's buses have frames that a second program can receive; True as long as nothing is known."""
    return info is None or info.bus.startswith(_SOCKETCAN)


def parse_channels(text: str) -> dict[str, str]:
    """Return the interfaces by bus from `can0`, or from `vehicle=can0, ins=can1`."""
    pairs = [part.strip().rpartition("=") for part in text.split(",")]
    return {name: channel for name, _, channel in pairs}
