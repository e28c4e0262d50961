"""`python -m vehicle_iface.recorder`: the recorder's process, controlled by the loop through its pipes.

The first line of input is a `RecordingRequest`. The recorder sends a `RecorderReply` when it records, or cannot.
After `end`, or `AFTERMATH_NS` after the input has ended without it (the loop was killed), it sends its final status and
exits. It ignores the signals that end a program: the loop handles them, and the stop that follows is recorded.
"""

import contextlib
import os
import select
import signal
import sys

import msgspec

from vehicle_iface import clock
from vehicle_iface.errors import BusError, VehicleIfaceError
from vehicle_iface.recorder.child import END, RecorderReply
from vehicle_iface.recorder.folder import RecordingRequest
from vehicle_iface.recorder.recorder import Recorder
from vehicle_iface.units import NS_PER_MS, NS_PER_S

CYCLE_MS = 25
AFTERMATH_NS = 5 * NS_PER_S
"""Recording time after the loop was killed, to include the vehicle's reaction."""
DONE, LOST_SOME, BAD_USAGE, NO_BUS = 0, 1, 2, 3


def main() -> int:
    """Run the recorder. Exit status 0: everything was recorded; 1: some data is lost; 2, 3: recording failed."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with open(0, "rb", buffering=0, closefd=False) as requests:
        request = msgspec.json.decode(requests.readline(), type=RecordingRequest)
    try:
        recorder = Recorder(request, _notify)
    except VehicleIfaceError as error:
        _reply(RecorderReply(refusal=str(error), is_bus=isinstance(error, BusError)))
        return NO_BUS if isinstance(error, BusError) else BAD_USAGE
    _reply(RecorderReply())
    _record(recorder)
    status = recorder.close(clock.monotonic_ns())
    _reply(RecorderReply(status=status))
    return LOST_SOME if status.loss else DONE


def _record(recorder: Recorder) -> None:
    """Record until `end` arrives, or until `AFTERMATH_NS` after the loop is gone."""
    commands = select.poll()
    commands.register(0, select.POLLIN)
    stop_ns: int | None = None
    while True:
        now_ns = clock.monotonic_ns()
        recorder.step(now_ns)
        if stop_ns is not None:
            if now_ns >= stop_ns:
                return
            clock.sleep_until(now_ns + CYCLE_MS * NS_PER_MS)
        elif commands.poll(CYCLE_MS):
            command = os.read(0, 64)
            stop_ns = now_ns if command == END else now_ns + AFTERMATH_NS


def _reply(reply: RecorderReply) -> None:
    """Send a reply to the loop, if it still exists."""
    with contextlib.suppress(OSError):
        os.write(1, msgspec.json.encode(reply) + b"\n")


def _notify(text: str) -> None:
    """Print a message on the terminal, if there is one."""
    with contextlib.suppress(OSError):
        os.write(2, f"recorder: {text}\n".encode())


if __name__ == "__main__":
    sys.exit(main())
