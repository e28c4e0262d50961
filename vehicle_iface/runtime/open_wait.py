"""Waits at the start for a bus that cannot be opened yet, and logs that it waits."""

import logging
from collections.abc import Callable

from vehicle_iface.bus.base import Bus
from vehicle_iface.errors import BusError
from vehicle_iface.units import NS_PER_MS, NS_PER_S

log = logging.getLogger(__name__)

LOOK_NS = 100 * NS_PER_MS
SAY_AGAIN_NS = 5 * NS_PER_S


def wait_until_open(
    open_bus: Callable[[], Bus],
    *,
    limit_s: float,
    is_over: Callable[[], bool],
    now_ns: Callable[[], int],
    sleep_until: Callable[[int], None],
) -> bool:
    """Return True as soon as the bus can be opened, False once `is_over`.

    Logs what it waits for: at once, on every change, and every five seconds. Raises the `BusError` of the last attempt
    after `limit_s`, which may be infinite.
    """
    begin_ns, said, said_ns = now_ns(), "", 0
    while not is_over():
        try:
            open_bus().close()
            return True
        except BusError as error:
            waited_ns = now_ns() - begin_ns
            if waited_ns >= limit_s * NS_PER_S:
                raise
            if str(error) != said or now_ns() - said_ns >= SAY_AGAIN_NS:
                said, said_ns = str(error), now_ns()
                log.warning("waiting (%.0f s so far): %s", waited_ns / NS_PER_S, said)
        sleep_until(now_ns() + LOOK_NS)
    return False
