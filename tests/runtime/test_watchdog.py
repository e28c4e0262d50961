"""A loop that hangs is ended, and says where."""

import subprocess
import sys
import threading
import time
from pathlib import Path

from vehicle_iface.runtime.watchdog import Watchdog

ROOT = Path(__file__).resolve().parents[2]
LATCHED_FAULT = 4
HANGS = """
import sys, time
from vehicle_iface.runtime.watchdog import Watchdog
def a_controller_that_never_returns():
    while True:
        time.sleep(1e-4) if sys.argv[1] == "sleeping" else None
with Watchdog(look_s=0.02) as watchdog:
    watchdog.feed()
    a_controller_that_never_returns()
"""


def test_a_loop_that_hangs_is_ended_and_the_place_is_named() -> None:
    for how in ("sleeping", "computing"):
        done = subprocess.run(
            [sys.executable, "-c", HANGS, how], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == LATCHED_FAULT
        assert "the loop hangs, nothing is sent any more" in done.stderr
        assert "a_controller_that_never_returns" in done.stderr


def test_a_hang_is_found_after_three_looks() -> None:
    ended = threading.Event()
    with Watchdog(ended.set) as watchdog:
        watchdog.feed()
        begin_s = time.monotonic()
        assert ended.wait(8.0)
        took_s = time.monotonic() - begin_s
    assert 2.09 <= took_s <= 4.0  # a busy machine wakes the watchdog late, and does so four times


def test_a_loop_that_lives_is_left_alone_and_the_watch_ends_with_it() -> None:
    ended = threading.Event()
    with Watchdog(ended.set, look_s=0.01) as watchdog:
        for _ in range(30):
            watchdog.feed()
            assert not ended.wait(0.01)
    assert not any(thread.name == "watchdog" for thread in threading.enumerate())
