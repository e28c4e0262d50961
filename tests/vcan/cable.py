"""A cable that can be spoilt: vxcan, the loop on one end, the vehicle on the other, and a queue where each end sends.

What a program sends is heard on its own end at once, and on the other end when the queue lets it through.
"""

import subprocess
import time

from .contract import Frame, raw_socket, send

LOOP_END, VEHICLE_END = "vx0", "vx1"
STRANGER = 0x7FF
"""An identifier that means nothing to anybody here."""
CLOSED = ("tbf", "rate", "8bit", "burst", "16", "limit", "4000")
"""A queue with room for 250 frames that lets one through in 16 s: a bus on which nobody acknowledges."""
OPEN = ("tbf", "rate", "10mbit", "burst", "16000", "limit", "4000")
"""The same queue on a bus that is well again; what waits in it is sent."""


class Cable:
    """Both ends, up."""

    def __init__(self) -> None:
        _run("ip", "link", "add", "dev", LOOP_END, "type", "vxcan", "peer", "name", VEHICLE_END)
        for end in (LOOP_END, VEHICLE_END):
            _run("ip", "link", "set", end, "up")

    def queue(self, end: str, *how: str) -> None:
        """Send through this queue from now on; a queue of the same kind is changed and keeps what it holds.

        A stranger's frame sets it going, as a controller's interrupt does: a changed queue sleeps on.
        """
        _run("tc", "qdisc", "replace", "dev", end, "root", *how)
        with raw_socket(end) as raw:
            send(raw, Frame(0, STRANGER, b""))

    def lose_all(self, end: str, duration_s: float) -> None:
        """Nothing that is sent here arrives, for so long."""
        with subprocess.Popen(["tc", "-batch", "-"], stdin=subprocess.PIPE, text=True) as tc:
            assert tc.stdin is not None
            for command, then_s in (("add", duration_s), ("del", 0.0)):
                print(f"qdisc {command} dev {end} root netem loss 100%", file=tc.stdin, flush=True)
                time.sleep(then_s)
        assert tc.returncode == 0

    def spoil(self, end: str, can_id: int, mask: int, *how: str) -> None:
        """Send the frames with these identifiers through a netem queue, and the others past it."""
        _run("tc", "qdisc", "add", "dev", end, "root", "handle", "1:", "prio", "priomap", *["0"] * 16)
        _run("tc", "qdisc", "add", "dev", end, "parent", "1:3", "netem", *how)
        what = ("match", f"canid(sff 0x{can_id:X}:0x{mask:X})", "flowid", "1:3")
        _run("tc", "filter", "add", "dev", end, "parent", "1:", "basic", *what)

    def mend(self, end: str) -> None:
        """Take the queue away, with what it holds."""
        _run("tc", "qdisc", "del", "dev", end, "root")

    def close(self) -> None:
        """Take the cable away."""
        _run("ip", "link", "del", LOOP_END)


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)
