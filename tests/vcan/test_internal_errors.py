"""What only the program or its surroundings can get wrong: frames that may not leave, rights, the order of modes."""

import random
import shutil
import signal
import sys
from pathlib import Path

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MANUAL, MS, READY, DecodedFrame
from vehicle_bus_contract.socketcan import open_socket, receive_frames

from .conftest import ROOT, Programs
from .driving import driven, line_file, own_faults, summary, wait_until_driven
from .observer import CHANNEL, Observer, decided
from .peer import Vehicle

EMERGENCY_STOP = 4
WITH_FRAMES_TOO_MANY = """
import sys
from types import SimpleNamespace
from vehicle_iface.cli import main
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.reports import Reports

make, send_due = Reports.__init__, Reports.send_due

def made(self, *arguments, **named):
    make(self, *arguments, **named)
    self._body = (self._body[0], SimpleNamespace(is_due=lambda _: True))

def sent(self, now_ns):
    send_due(self, now_ns)
    self._transmitter._send((CanFrame(0x7FF, bytes(8)),))

Reports.__init__, Reports.send_due = made, sent
sys.exit(main(sys.argv[1:]))
"""
"""Lights with each command instead of ten times a second, and a foreign identifier beside each."""
WINDOW_NS, MOST_IN_WINDOW = 250 * MS, 4


@pytest.mark.usefixtures("vehicle")
def test_unlisted_and_excess_frames_are_not_sent_and_nothing_else_changes(programs: Programs, bus: Observer) -> None:
    what = ["run", "--arm", "--channel", "vcan0", "--trajectory", line_file(programs.folder)]
    with open_socket(CHANNEL, can_ids=[0x7FF]) as ear:
        outputs = ["--summary", str(programs.folder / "summary.json"), "--telemetry", programs.telemetry]
        loop = programs.start_python("-c", WITH_FRAMES_TOO_MANY, *what, *outputs, name="run")
        moving = wait_until_driven(bus)
        end = bus.wait_samples(150, since=moving)
        assert receive_frames(ear) == []
    record = bus.record(moving, end)
    lights = [decoded.stamp_ns for decoded in record.of("BODY_COMMAND")]
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    assert len(lights) > 10
    assert all(b - a > WINDOW_NS - 20 * MS for a, b in zip(lights, lights[MOST_IN_WINDOW:], strict=False))
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    refused = summary(programs)["tx_blocked"]
    assert refused["not on the list"] > 100
    assert refused["too often"] > 100


@pytest.mark.usefixtures("vehicle")
def test_without_permission_for_real_time_it_drives_and_reports_the_remedy(programs: Programs, bus: Observer) -> None:
    setpriv = shutil.which("setpriv")
    assert setpriv is not None, "util-linux is missing"
    bounds = "-sys_nice,-ipc_lock,-sys_resource"
    loop = programs.start_command(
        *(setpriv, f"--bounding-set={bounds}", f"--inh-caps={bounds}", "prlimit", "--rtprio=0", "--memlock=65536"),
        *(sys.executable, "-m", "vehicle_iface", "run", "--arm", "--channel", "vcan0"),
        *("--trajectory", line_file(programs.folder), "--telemetry", programs.telemetry),
        name="run",
    )
    loop.wait_for_line("rtprio")
    moving = wait_until_driven(bus)
    record = bus.record(moving, bus.wait_samples(60, since=moving))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)


def test_no_order_of_vehicle_modes_enables_driving_without_a_new_arming(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    vehicle.driver_brake = True
    taken, _ = bus.wait_for("the driver", "VEHICLE_STATUS", MODE=MANUAL, since=moving)
    bus.wait_samples(5, since=taken)
    vehicle.driver_brake, vehicle.watches, vehicle.engages = False, False, False
    chance, begin = random.Random(5), bus.now()
    for _ in range(40):
        vehicle.mode = chance.choice((MANUAL, READY, AUTONOMOUS, FAULT, EMERGENCY_STOP))
        end = bus.wait_samples(5)
    enabled = {pair.drive["ENABLE"] for pair in bus.pairs(begin, end)}
    assert enabled <= {0.0}
    vehicle.watches = vehicle.engages = True
    vehicle.make_ready()
    quiet = bus.wait_samples(60)
    assert not any(pair.is_enabled for pair in bus.pairs(begin, quiet))
    loop.send_signal(signal.SIGUSR1)
    wait_until_driven(bus, since=quiet)


@pytest.mark.parametrize("where", [("--channel", "lo"), ("--interface", "slcan", "--channel", "/dev/ttyACM0")])
def test_a_possibly_real_bus_is_rejected_with_an_unreviewed_profile(
    programs: Programs, bus: Observer, where: tuple[str, ...]
) -> None:
    loop = programs.start("run", "--arm", *where, "--route", "circle", "--telemetry", programs.telemetry)
    loop.wait_for_line("is a real bus and reference is not reviewed")
    assert loop.wait_for_end() == 2
    assert bus.sent_by_controller() == []


def test_a_stop_steers_along_the_path_while_the_state_is_good_and_straight_while_it_is_not(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    _, moving = driven(programs, bus, "--profile", tracking(programs.folder), "--route", "circle")
    bus.wait_until(
        "it turns", lambda decoded: decoded.name == "CHASSIS" and decoded["FRONT_WHEEL_ANGLE"] > 0.1, since=moving
    )
    vehicle.pose_valid = False
    index, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_INVALID", since=moving)
    bus.wait_until("straight wheels", is_straight, since=index)
    vehicle.pose_valid = True
    again = wait_until_driven(bus, since=bus.now())
    bus.wait_until(
        "it turns", lambda decoded: decoded.name == "CHASSIS" and decoded["FRONT_WHEEL_ANGLE"] > 0.1, since=again
    )
    loop = programs.started[-1]
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    stops = [pair for pair in bus.pairs(again) if pair.is_stop]
    moving_stops = stops[: len(stops) // 2]
    assert {pair.reason for pair in stops} == {"SHUTDOWN"}
    assert all(pair.steer["FRONT_WHEEL_ANGLE_REQUEST"] > 0.05 for pair in moving_stops)


def is_straight(decoded: DecodedFrame) -> bool:
    """Whether it asks for straight wheels."""
    return decoded.name == "STEER_COMMAND" and decoded["FRONT_WHEEL_ANGLE_REQUEST"] == 0.0


def tracking(folder: Path) -> str:
    """The reference profile with stops that steer along the path."""
    text = (ROOT / "dbc" / "reference.toml").read_text()
    assert 'stop_steering = "straight"' in text
    (folder / "tracking.toml").write_text(text.replace('stop_steering = "straight"', 'stop_steering = "track"'))
    shutil.copy(ROOT / "dbc" / "reference.dbc", folder)
    return str(folder / "tracking.toml")
