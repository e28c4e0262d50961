"""Whoever says that the machine stood still says so when it did."""

import signal
import time

from .standstill import Witness


def test_the_witness_says_for_how_long_it_could_not_wake_and_nothing_can_keep_it_from_waking() -> None:
    witness = Witness()
    try:
        end_s = time.monotonic() + 0.3
        while time.monotonic() < end_s:
            pass  # a process that wants all of the processor is no standstill
        busy = witness.news()
        witness.tell(signal.SIGSTOP)
        time.sleep(0.2)
        witness.tell(signal.SIGCONT)
        time.sleep(0.1)
        stopped = witness.news()
    finally:
        witness.close()
    assert 0.1 < max(stopped) < 1.0
    assert max(busy, default=0.0) < max(stopped)
