"""A virtual bus' time in place of the machine's, for device and bench alike."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from vehicle_bus_contract.reference import S
from virtual_drive import BenchBus

WALL_NS = 1_800_000_000 * S
"""Wall clock at the bus' time 0."""


@contextmanager
def virtual_time(bus: BenchBus) -> Iterator[None]:
    """Until the end of the context, clocks show the bus' time; to sleep is to let it pass, and the wall clock may be
    set."""
    apart_ns = WALL_NS

    def set_wall(_clock: int, to_s: float) -> None:
        nonlocal apart_ns
        apart_ns = round(to_s * S) - bus.now_ns

    with patch.multiple(
        time,
        monotonic_ns=lambda: bus.now_ns,
        monotonic=lambda: bus.now_ns / S,
        time_ns=lambda: bus.now_ns + apart_ns,
        time=lambda: (bus.now_ns + apart_ns) / S,
        clock_settime=set_wall,
        sleep=lambda seconds: bus.pass_until(bus.now_ns + round(seconds * S)),
    ):
        yield
