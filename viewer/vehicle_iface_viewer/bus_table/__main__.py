"""`python -m vehicle_iface_viewer.bus_table`: the listener's process.

The first line of input is a `ListenRequest`. It prints a `BusReport` twice a second, and ends with its input.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys

import msgspec

from vehicle_iface import clock
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import VehicleIfaceError
from vehicle_iface.profile import load_profile
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.bus_table.listener import Listener
from vehicle_iface_viewer.bus_table.monitor import BusMonitor
from vehicle_iface_viewer.bus_table.report import BusReport, ListenRequest

CYCLE_MS = 50
REPORT_NS = NS_PER_S // 2
_NICENESS = 10
"""Behind the loop, and behind the page."""


def main() -> int:
    """Listen until the input ends. Exit status 0, or 2 when the profile cannot be used, with a last report."""
    for number in (signal.SIGINT, signal.SIGTERM):  # those of a terminal are for the viewer, which ends the input
        signal.signal(number, signal.SIG_IGN)
    os.nice(_NICENESS)
    with open(0, "rb", buffering=0, closefd=False) as requests:
        request = msgspec.json.decode(requests.readline(), type=ListenRequest)
    try:
        monitor = BusMonitor(load_database(load_profile(request.profile)))
    except VehicleIfaceError as error:
        _print(BusReport(problem=f"profile {request.profile}: {error}"))
        return 2
    with contextlib.suppress(BrokenPipeError):
        _listen(Listener(request.channels), monitor)
    return 0


def _listen(listener: Listener, monitor: BusMonitor) -> None:
    commands = select.poll()
    commands.register(0, select.POLLIN)
    lost, due_ns = 0, 0
    while not commands.poll(CYCLE_MS):
        now_ns = clock.monotonic_ns()
        frames = listener.read(now_ns)
        if listener.lost != lost:
            lost = listener.lost
            monitor.forget_sequences()
        monitor.add(frames)
        if now_ns >= due_ns:
            due_ns = now_ns + REPORT_NS
            _print(monitor.report(clock.monotonic_ns(), lost=lost, problem=listener.problem))


def _print(report: BusReport) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(report) + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    sys.exit(main())
