"""Faults of the link: the interface goes down or away, and the cable is bad."""

from collections.abc import Iterator
from contextlib import contextmanager

from hil_bench.faults.base import Injection
from hil_bench.rig import Rig


def take_link_down(down_s: float | None = None, *, bus: int = 0) -> Injection:
    """Take the interface of a bus down, and up again at the end or after `down_s`."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.set_link(up=False, bus=bus)
        rig.mark_injection()
        try:
            if down_s is not None:
                rig.run_for(down_s)
                rig.set_link(up=True, bus=bus)
            yield
        finally:
            rig.set_link(up=True, bus=bus)

    return inject


def recreate_link() -> Injection:
    """Delete the interface, and create it again under its name at the end."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        channel = rig.device_channel
        rig.run_command(["ip", "link", "del", channel])
        rig.mark_injection()
        try:
            yield
        finally:
            rig.run_command(["ip", "link", "add", channel, "type", "vcan"])
            rig.run_command(["ip", "link", "set", channel, "mtu", "72", "up"])
            rig.bus.reopen()

    return inject


def shape_queue(*options: str, at: str = "{device}") -> Injection:
    """Put a queueing discipline (`tc qdisc`) on one end of the cable, and remove it at the end."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        end = at.format(device=rig.device_channel, bench=rig.bus.channel)
        rig.run_command(["tc", "qdisc", "replace", "dev", end, "root", *options])
        rig.mark_injection()
        try:
            yield
        finally:
            rig.run_command(["tc", "qdisc", "del", "dev", end, "root"])

    return inject
