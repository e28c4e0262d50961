"""The whole of it: vehicle, loop and viewer as three processes on vcan0, for a lap and longer."""

import re
import signal
import urllib.request
from dataclasses import dataclass

import pytest
from vehicle_bus_contract.judge import Record, lateral_errors_m
from vehicle_bus_contract.reference import NAMES, S

from vehicle_iface.trajectories.shapes import make_route

from .conftest import Program, Programs
from .driving import own_faults, summary, wait_until_driven
from .observer import Observer, decided
from .peer import Vehicle

DRIVE_S = 45
"""Of the figure of eight, a lap and more."""
LATERAL_LIMIT_M = 0.3


@dataclass(frozen=True)
class Drive:
    """What a drive with a viewer left behind."""

    bus: Observer
    begin: int
    """Index at which the vehicle was under way."""
    end: int
    """Index after the lap."""
    killed: int
    """Index at which the viewer had been killed."""
    restarted: int
    """Index at which another one served its page."""
    over: int
    """Index at which the loop was asked to end."""
    status: int
    """The loop's exit status."""
    found: dict[str, object]
    """The loop's summary."""


def view(programs: Programs) -> Program:
    """A viewer that serves its page."""
    viewer = programs.start("view", "--connect", programs.telemetry, "--port", "0")
    address = viewer.wait_for_line(r"viewer: (http://\S+)").group(1)
    with urllib.request.urlopen(address, timeout=20.0) as page:
        assert page.status == 200
    return viewer


@pytest.fixture(scope="module")
def drive(vcan0: None, tmp_path_factory: pytest.TempPathFactory) -> Drive:  # noqa: ARG001
    """A lap of the figure of eight; then the viewer is killed and started again while it goes on.

    Nothing of it runs any more when the tests look at it.
    """
    bus, programs = Observer(), Programs(tmp_path_factory.mktemp("drive"))
    try:
        return _drive(bus, programs)
    except BaseException:
        print(programs.text)
        raise
    finally:
        programs.kill_all()
        bus.close()


def _drive(bus: Observer, programs: Programs) -> Drive:
    x_m, y_m, heading_rad = make_route("figure8").start
    start = f"--start={x_m:.6f},{y_m:.6f},{heading_rad:.6f}"
    programs.start("sim", start, "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    viewer = view(programs)
    loop = programs.run("--arm", "--route", "figure8")
    begin = wait_until_driven(bus)
    first_ns = bus.frames[begin].stamp_ns
    end, _ = bus.wait_until(
        "a lap", lambda decoded: decoded.stamp_ns - first_ns >= DRIVE_S * S, since=begin, patience_s=DRIVE_S + 30
    )
    viewer.kill()
    killed = bus.now()
    bus.wait_samples(100)
    view(programs)
    restarted = bus.now()
    over = bus.wait_samples(100)
    loop.send_signal(signal.SIGTERM)
    status = loop.wait_for_end()
    return Drive(bus, begin, end, killed, restarted, over, status, summary(programs))


@pytest.fixture(scope="module")
def lap(drive: Drive) -> Record:
    """The drive's lap, judged."""
    return drive.bus.record(drive.begin, drive.end)


@pytest.mark.timeout(300)
def test_three_processes_drive_the_figure_of_eight_for_a_lap_within_30_cm(lap: Record) -> None:
    route = make_route("figure8")
    errors_m = lateral_errors_m(lap.samples, route.x_m.tolist(), route.y_m.tolist())
    assert (lap.end_ns - lap.begin_ns) / S >= DRIVE_S - 1
    assert max(errors_m) < LATERAL_LIMIT_M
    way_m = sum(sample.speed_mps for sample in lap.samples) * 0.01
    assert way_m > route.length_m


def test_a_lap_has_no_crc_error_and_no_counter_gap(lap: Record) -> None:
    assert lap.crc_errors == []
    assert lap.counter_gaps == []
    assert set(lap.frames) == set(NAMES.values())


def test_in_a_lap_each_sample_is_answered_by_exactly_one_pair(lap: Record) -> None:
    assert lap.unanswered == []
    assert lap.doubled == []
    assert len(lap.answers) > 0.95 * 100 * DRIVE_S
    assert abs(len(lap.pairs) - len(lap.samples) - lap.stale_stops) <= 3  # cut at both ends


def test_in_a_lap_every_command_is_within_its_limits(lap: Record) -> None:
    assert lap.violations == []
    assert decided(lap) == ["NOMINAL"]


def test_a_viewer_that_is_killed_and_restarted_changes_nothing_on_the_bus(drive: Drive) -> None:
    record = drive.bus.record(drive.killed - 400, drive.over)
    assert drive.killed < drive.restarted < drive.over
    assert decided(record) == ["NOMINAL"]
    assert record.faults() == []


def test_after_the_drive_the_vehicle_is_at_standstill_and_the_loop_exits_with_0(drive: Drive) -> None:
    record = drive.bus.record(drive.over)
    assert drive.status == 0
    assert not own_faults(record)
    assert not record.pairs[-1].is_enabled
    assert abs(record.samples[-1].speed_mps) < 0.06


def test_an_independent_vehicle_is_driven_along_the_figure_of_eight_too(programs: Programs, bus: Observer) -> None:
    route = make_route("figure8")
    vehicle = Vehicle(*route.start)
    vehicle.start()
    try:
        loop = programs.run("--arm", "--route", "figure8")
        begin = wait_until_driven(bus)
        end = bus.wait_samples(1000, since=begin)
        loop.send_signal(signal.SIGTERM)
        assert loop.wait_for_end() == 0
    finally:
        vehicle.close()
    record = bus.record(begin, end)
    assert record.faults() == []
    assert decided(record) == ["NOMINAL"]
    assert max(lateral_errors_m(record.samples, route.x_m.tolist(), route.y_m.tolist())) < LATERAL_LIMIT_M
    assert re.search(r"samples +\d+ complete, 0 incomplete", loop.text)
