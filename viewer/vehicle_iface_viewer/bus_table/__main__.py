"""`python -m vehicle_iface_viewer.bus_table`: the listener's process.

The first line of input is a `ListenRequest`; each further one is a `PlotRequest`. It prints a `BusReport` twice a
second, and `BusSamples` in each cycle while there are some. It ends with its input.
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
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.listener import Listener
from vehicle_iface_viewer.bus_table.monitor import BusMonitor
from vehicle_iface_viewer.bus_table.report import BusReport, BusSamples, ListenRequest, PlotRequest
from vehicle_iface_viewer.bus_table.sampler import SignalSampler

CYCLE_MS = 50
REPORT_NS = NS_PER_S // 2
_READ_BYTES = 1 << 16
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
        finder = MessageFinder(load_database(load_profile(request.profile)))
    except VehicleIfaceError as error:
        _print(BusReport(problem=f"profile {request.profile}: {error}"))
        return 2
    with contextlib.suppress(BrokenPipeError):
        _listen(Listener(request.channels), finder)
    return 0


def _listen(listener: Listener, finder: MessageFinder) -> None:
    monitor, sampler = BusMonitor(finder), SignalSampler(finder)
    commands = select.poll()
    commands.register(0, select.POLLIN)
    lost, due_ns, chosen, unread = 0, 0, 0, b""
    while True:
        if commands.poll(CYCLE_MS):
            chunk = os.read(0, _READ_BYTES)
            if not chunk:
                return
            *lines, unread = (unread + chunk).split(b"\n")
            for line in lines[-1:]:
                wanted = msgspec.json.decode(line, type=PlotRequest)
                chosen = wanted.number
                sampler.choose(wanted.signals)
        now_ns = clock.monotonic_ns()
        frames = listener.read(now_ns)
        if listener.lost != lost:
            lost = listener.lost
            monitor.forget_sequences()
        monitor.add(frames)
        sampler.add(frames)
        samples = sampler.take()
        if any(each.times_ns for each in samples):
            _print(BusSamples(request=chosen, signals=samples))
        if now_ns >= due_ns:
            due_ns = now_ns + REPORT_NS
            _print(monitor.report(clock.monotonic_ns(), lost=lost, problem=listener.problem))


def _print(line: BusReport | BusSamples) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(line) + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    sys.exit(main())
