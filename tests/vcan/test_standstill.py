"""Both witnesses of a machine that stood still report it when it did."""

import ctypes
import signal
import threading
import time

from vehicle_bus_contract.reference import READY

from . import peer
from .peer import Vehicle
from .standstill import Witness
from .witness import LATE_S


def test_the_witness_reports_how_long_it_could_not_run_and_cannot_be_preempted() -> None:
    witness = Witness()
    try:
        end_s = time.monotonic() + 0.3
        while time.monotonic() < end_s:
            pass  # a process that wants all of the processor is no standstill
        busy = witness.take_delays_s()
        witness.send_signal(signal.SIGSTOP)
        time.sleep(0.2)
        witness.send_signal(signal.SIGCONT)
        time.sleep(0.1)
        stopped = witness.take_delays_s()
    finally:
        witness.close()
    assert 0.1 < max(stopped) < 1.0
    assert max(busy, default=0.0) < max(stopped)


def test_many_short_pauses_add_up() -> None:
    witness = Witness()
    try:
        witness.take_delays_s()
        for _ in range(40):
            witness.send_signal(signal.SIGSTOP)
            time.sleep(0.8 * LATE_S)  # too short to be reported alone
            witness.send_signal(signal.SIGCONT)
            time.sleep(0.002)
        time.sleep(0.05)
        assert max(witness.take_delays_s()) > LATE_S
    finally:
        witness.close()


def test_the_tests_own_vehicle_reports_when_it_was_late(vehicle: Vehicle) -> None:
    hold_s, held = 0.2, threading.Event()
    peer.take_delays_s()

    def hold_up() -> None:
        held.set()
        ctypes.PyDLL(None).usleep(round(hold_s * 1e6))  # keeps the interpreter's lock

    holder = threading.Thread(target=hold_up)
    holder.start()
    held.wait()
    holder.join()
    time.sleep(0.1)
    assert vehicle.mode == READY
    assert 0.5 * hold_s < max(peer.take_delays_s()) < 5 * hold_s
