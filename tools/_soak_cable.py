"""A bad cable between a loop and a vehicle, and eyes at both of its ends.

    LOOP_END  vxcan pair  gateway (can-gw)  vxcan pair  VEHICLE_END

The kernel's netem loses, doubles, delays and damages what leaves the gateway, in both directions: at the loop's own
interface it would hold back frames that the loop then takes for a queue that is stuck. Each end sees what was sent
there, as it was sent, and what came over the cable, as it came.
"""

import fcntl
import os
import shutil
import socket
import struct
import subprocess
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from _soak_judge import Flap, Seen
from bus_contract import Frame

from vehicle_iface.bus.receive import BATCH, BatchReceiver, Packet

LOOP_END, VEHICLE_END = "soak0", "soak1"
DELAY_MS = 20
"""Of every frame but those that overtake; longer than a message's period, or none would be overtaken."""
_MIDDLE = {LOOP_END: "soak0g", VEHICLE_END: "soak1g"}
"""The gateway's end of each pair: what leaves it reaches the other one."""
_ROOM_BYTES = 64 << 20
_SO_TIMESTAMPNS, _SO_RCVBUFFORCE, _SO_RXQ_OVFL = 35, 33, 40
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP = 0x8913, 0x8914, 1
_EXTENDED, _REMOTE, _EFF_MASK = 0x80000000, 0x40000000, 0x1FFFFFFF
_PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"])


class CableError(Exception):
    """It cannot be made; the message says what failed."""


class Cable:
    """Makes the interfaces, and takes them away at its end."""

    def __init__(self, *faults: str) -> None:
        """`faults` in the words of netem: "loss", "1%", …"""
        self._faults = faults

    def __enter__(self) -> Self:
        with ExitStack() as unless_made:
            unless_made.callback(self._remove)
            _run(Path("/proc/sys/kernel/modprobe").read_text().strip(), "can-gw")
            for end, middle in _MIDDLE.items():
                _run("ip", "link", "add", "dev", end, "type", "vxcan", "peer", "name", middle)
                for name in (end, middle):
                    _run("ip", "link", "set", name, "up")
                _run("tc", "qdisc", "add", "dev", middle, "root", "netem", "delay", f"{DELAY_MS}ms", *self._faults)
            for come, go in (tuple(_MIDDLE.values()), tuple(reversed(_MIDDLE.values()))):
                _run("cangw", "-A", "-s", come, "-d", go)
            unless_made.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._remove()

    def flap(self, down_s: float) -> Flap:
        """The loop's link goes down, and comes up again."""
        down_ns = time.time_ns()  # the clock of the kernel's stamps
        _switch(LOOP_END, is_up=False)
        time.sleep(down_s)
        _switch(LOOP_END, is_up=True)
        return Flap(down_ns, time.time_ns())

    def _remove(self) -> None:
        for end in _MIDDLE:
            with suppress(CableError):
                _run("ip", "link", "del", end)


class Eyes:
    """Sees every frame at one end but those that say that they are none; they wait in the kernel until asked for."""

    def __init__(self, end: str) -> None:
        self._raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        for option, value in ((_SO_TIMESTAMPNS, 1), (_SO_RXQ_OVFL, 1), (_SO_RCVBUFFORCE, _ROOM_BYTES)):
            self._raw.setsockopt(socket.SOL_SOCKET, option, value)
        self._raw.bind((end,))
        self._receiver = BatchReceiver(self._raw.fileno())
        self.missed = 0
        """Frames that the kernel had no room for."""

    def look(self) -> list[Seen]:
        """What has been there since the last call."""
        found: list[Seen] = []
        while True:
            try:
                packets = self._receiver.receive(wait=False)
            except OSError:  # the link went down: said once, and what waits comes with the next call
                continue
            self.missed = max([self.missed, *(packet[4] for packet in packets)])
            found += map(_seen, packets)
            if len(packets) < BATCH:
                return found

    def close(self) -> None:
        """See nothing more."""
        self._raw.close()


def _seen(packet: Packet) -> Seen:
    word, data, is_fd, stamp_ns, _, is_own = packet
    return Seen(
        Frame(
            stamp_ns=stamp_ns,
            can_id=word & _EFF_MASK,  # damage may leave bits beyond the eleven, and then it is nobody's
            data=data,
            is_extended=bool(word & _EXTENDED),
            is_remote=bool(word & _REMOTE),
            is_fd=is_fd,
        ),
        is_own,
    )


def _switch(interface: str, *, is_up: bool) -> None:
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
