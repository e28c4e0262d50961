"""`python -m vehicle_iface.recorder`: the recorder's process, started and ended by the loop through its pipes.

Its first line of input is an `Order`; it answers with an `Answer` when it records, or why it cannot. After `end`, or
a while after the input has ended without it (the loop was killed), it answers with its account and ends. Signals for
the end of the program are the loop's: it has a vehicle to stop, and that is to be recorded.
"""

import contextlib
import os
import select
import signal
import sys

import msgspec

from vehicle_iface import clock
from vehicle_iface.errors import BusError, VehicleIfaceError
from vehicle_iface.recorder.child import END, Answer
from vehicle_iface.recorder.folder import Order
from vehicle_iface.recorder.recorder import Recorder
from vehicle_iface.units import NS_PER_MS, NS_PER_S

CYCLE_MS = 25
AFTERMATH_NS = 5 * NS_PER_S
"""Recorded after a loop that was killed: what the vehicle does without it."""
DONE, LOST_SOME, BAD_USAGE, NO_BUS = 0, 1, 2, 3


def main() -> int:
    """0: all was recorded; 1: some of it is lost; 2, 3: there could be no recording."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with open(0, "rb", buffering=0, closefd=False) as orders:
        order = msgspec.json.decode(orders.readline(), type=Order)
    try:
        recorder = Recorder(order, _say)
    except VehicleIfaceError as error:
        _answer(Answer(refusal=str(error), is_bus=isinstance(error, BusError)))
        return NO_BUS if isinstance(error, BusError) else BAD_USAGE
    _answer(Answer())
    _record(recorder)
    report = recorder.close(clock.monotonic_ns())
    _answer(Answer(report=report))
    return LOST_SOME if report.loss else DONE


def _record(recorder: Recorder) -> None:
    """Until the end is asked for, or the loop has been gone for a while."""
    ear = select.poll()
    ear.register(0, select.POLLIN)
    end_ns: int | None = None
    while True:
        now_ns = clock.monotonic_ns()
        recorder.step(now_ns)
        if end_ns is not None:
            if now_ns >= end_ns:
                return
            clock.sleep_until(now_ns + CYCLE_MS * NS_PER_MS)
        elif ear.poll(CYCLE_MS):
            word = os.read(0, 64)
            end_ns = now_ns if word == END else now_ns + AFTERMATH_NS


def _answer(answer: Answer) -> None:
    """To the loop, if there is one."""
    with contextlib.suppress(OSError):
        os.write(1, msgspec.json.encode(answer) + b"\n")


def _say(text: str) -> None:
    """To the terminal, if there is one."""
    with contextlib.suppress(OSError):
        os.write(2, f"recorder: {text}\n".encode())


if __name__ == "__main__":
    sys.exit(main())
