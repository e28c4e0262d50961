"""`run --wait`: an interface that is down or absent at the start is waited for, in plain sight."""

import signal
import time
from pathlib import Path

import pytest

from .conftest import Program, Programs, set_link
from .driving import line_file, wait_until_driven
from .observer import Observer

NO_BUS = 3


@pytest.mark.usefixtures("vehicle")
def test_the_loop_waits_for_a_link_that_is_down_at_the_start_and_then_drives(programs: Programs, bus: Observer) -> None:
    set_link("down")
    loop = programs.run("--arm", "--wait", "--trajectory", line_file(programs.folder))
    loop.wait_for_line(r"waiting \(\d s so far\): .*sudo ip link set vcan0 up")
    up = bus.now()
    set_link("up")
    driving = wait_until_driven(bus, since=up)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0


def test_waiting_is_reported_repeatedly_and_ends_with_status_3_or_on_request(programs: Programs) -> None:
    def start(*wait: str) -> Program:
        return programs.start("run", "--channel", "vcan7", "--route", "line", "--arm", "--wait", *wait)

    limited, patient = start("1"), start()
    for loop in (limited, patient):
        loop.wait_for_line(r"waiting \(\d s so far\): .*sudo ip link add dev vcan7 type vcan")
    assert limited.wait_for_end() == NO_BUS
    assert limited.lines[-1].startswith("vehicle-iface: ")
    assert "sudo ip link add dev vcan7 type vcan" in limited.lines[-1]
    patient.send_signal(signal.SIGUSR1)
    patient.wait_for_line(r"waiting \([5-9] s so far\)")
    patient.send_signal(signal.SIGTERM)
    assert patient.wait_for_end() == 0


@pytest.mark.usefixtures("vehicle")
def test_an_end_request_while_the_recorder_starts_sends_nothing(programs: Programs, bus: Observer) -> None:
    set_link("down")
    loop = programs.run("--arm", "--wait", "--route", "line", "--record", str(programs.folder / "drive"))
    loop.wait_for_line(r"waiting \(0 s so far\)")
    set_link("up")
    while not Path(programs.telemetry).exists():  # made when the waiting is over
        assert loop.is_running, loop.text
        time.sleep(0.001)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    loop.wait_for_line("interrupted before the loop started")
    assert bus.sent_by_controller() == []
