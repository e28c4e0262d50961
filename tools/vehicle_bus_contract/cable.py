"""A cable between a loop and a vehicle that can be made bad: vxcan pairs, and the kernel's queues where frames leave.

Two kinds:

    LOOP_END  vxcan pair  VEHICLE_END
    LOOP_END  vxcan pair  gateway (can-gw)  vxcan pair  VEHICLE_END

On the short one a queue at an end holds frames back before they leave, as a bus without an acknowledgement does. On the
long one the frames have left: netem in the gateway loses, doubles, delays and damages them in both directions. Each
end sees at once what was sent there, and what came over the cable as it comes.
"""

import fcntl
import os
import shutil
import socket
import struct
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from vehicle_bus_contract.reference import Frame
from vehicle_bus_contract.socketcan import open_socket, send

LOOP_END, VEHICLE_END = "vx0", "vx1"
_GATEWAY_ENDS = {LOOP_END: "vx0g", VEHICLE_END: "vx1g"}
"""What leaves the gateway here reaches the end."""
UNUSED_ID = 0x7FF
CLOSED = ("tbf", "rate", "8bit", "burst", "16", "limit", "4000")
"""A queue with room for 250 frames that lets one through in 16 s: a bus on which nobody acknowledges."""
OPEN = ("tbf", "rate", "10mbit", "burst", "16000", "limit", "4000")
"""The same queue on a bus that works again; what waits in it is sent."""
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP = 0x8913, 0x8914, 1
_PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"])


class CableError(Exception):
    """The cable cannot be made or changed; the message says what failed."""


class Cable:
    """Both ends, up; the interfaces exist until `close`."""

    def __init__(self, gateway_faults: Sequence[str] = ()) -> None:
        """With faults in netem's words ("delay", "20ms", "loss", "1%"), the long cable. Raises `CableError`."""
        try:
            if gateway_faults:
                self._add_gateway(gateway_faults)
            else:
                _add_pair(LOOP_END, VEHICLE_END)
        except CableError:
            self.close()
            raise

    def close(self) -> None:
        """Remove the interfaces."""
        for end in _GATEWAY_ENDS:  # of the short cable the second end goes with the first
            with suppress(CableError):
                _run("ip", "link", "del", end)

    def queue(self, end: str, *how: str) -> None:
        """Send through this queue from now on; a queue of the same kind is changed and keeps what it holds.

        A frame that means nothing sets it going, as a controller's interrupt does: a changed queue sleeps on.
        """
        _run("tc", "qdisc", "replace", "dev", end, "root", *how)
        with open_socket(end) as raw:
            send(raw, Frame(0, UNUSED_ID, b""))

    def lose_all(self, end: str, duration_s: float) -> None:
        """Lose every frame that is sent here, for so long."""
        with subprocess.Popen(["tc", "-batch", "-"], stdin=subprocess.PIPE, text=True) as tc:
            assert tc.stdin is not None
            for command, then_s in (("add", duration_s), ("del", 0.0)):
                print(f"qdisc {command} dev {end} root netem loss 100%", file=tc.stdin, flush=True)
                time.sleep(then_s)
        assert tc.returncode == 0

    def queue_some(self, end: str, can_id: int, mask: int, *how: str) -> None:
        """Send the frames with these identifiers through a netem queue, and the others past it."""
        _run("tc", "qdisc", "add", "dev", end, "root", "handle", "1:", "prio", "priomap", *["0"] * 16)
        _run("tc", "qdisc", "add", "dev", end, "parent", "1:3", "netem", *how)
        what = ("match", f"canid(sff 0x{can_id:X}:0x{mask:X})", "flowid", "1:3")
        _run("tc", "filter", "add", "dev", end, "parent", "1:", "basic", *what)

    def remove_queue(self, end: str) -> None:
        """Remove the queue, with what it holds."""
        _run("tc", "qdisc", "del", "dev", end, "root")

    def interrupt(self, down_s: float) -> tuple[int, int]:
        """Take the loop's link down and up again; from when to when, in ns of the wall clock."""
        down_ns = time.time_ns()  # the clock of the kernel's stamps
        set_link(LOOP_END, is_up=False)
        time.sleep(down_s)
        set_link(LOOP_END, is_up=True)
        return down_ns, time.time_ns()

    def _add_gateway(self, faults: Sequence[str]) -> None:
        _run(Path("/proc/sys/kernel/modprobe").read_text().strip(), "can-gw")
        for end, gateway_end in _GATEWAY_ENDS.items():
            _add_pair(end, gateway_end)
            _run("tc", "qdisc", "add", "dev", gateway_end, "root", "netem", *faults)
        for source, target in (tuple(_GATEWAY_ENDS.values()), tuple(reversed(_GATEWAY_ENDS.values()))):
            _run("cangw", "-A", "-s", source, "-d", target)


def _add_pair(one: str, other: str) -> None:
    _run("ip", "link", "add", "dev", one, "type", "vxcan", "peer", "name", other)
    for name in (one, other):
        _run("ip", "link", "set", name, "up")


def set_link(interface: str, *, is_up: bool) -> None:
    """Take an interface up or down at once, by a system call. Raises `OSError`."""
    name = interface.encode()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        answer = fcntl.ioctl(control, _SIOCGIFFLAGS, struct.pack("16sH22x", name, 0))
        flags = struct.unpack_from("16xH", answer)[0] & ~_IFF_UP
        fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH22x", name, flags | is_up * _IFF_UP))


def _run(program: str, *arguments: str) -> None:
    command = [shutil.which(program, path=_PATH) or program, *arguments]
    try:
        done = subprocess.run(command, check=False, capture_output=True, text=True)
    except OSError as error:
        raise CableError(f"{program}: {error.strerror}") from error
    if done.returncode:
        raise CableError(f"{' '.join([program, *arguments])}: {done.stderr.strip() or done.stdout.strip()}")
