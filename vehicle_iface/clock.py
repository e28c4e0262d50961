"""The one module that reads a clock. Everything else gets `now_ns` as an argument.

Stamps are integer nanoseconds of CLOCK_MONOTONIC, which all processes of one machine share and which cannot be
set. The wall clock is for log headers and for mapping kernel receive stamps.
"""

import time

from vehicle_iface.units import NS_PER_S

monotonic_ns = time.monotonic_ns
"""Now, in nanoseconds of the machine's monotonic clock; read ten times a pass, so without a call of our own."""


def wall_ns() -> int:
    """Now, in nanoseconds since 1970 (UTC). May jump; never use it for control."""
    return time.time_ns()


def sleep_until(deadline_ns: int) -> None:
    """Sleep until the monotonic clock shows `deadline_ns`; return at once when it already does."""
    remaining_ns = deadline_ns - time.monotonic_ns()
    if remaining_ns > 0:
        time.sleep(remaining_ns / NS_PER_S)
