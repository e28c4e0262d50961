"""How a drive ends: by request, killed, cut off, or refused before it began."""

import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MS, READY

from .conftest import Programs, set_link
from .driving import driven, is_standing, line_file, own_faults, summary, wait_until_driven
from .observer import Observer, decided, reasons
from .peer import Vehicle

WATCHDOG_NS = 100 * MS
STATUS_PERIOD_NS = 20 * MS
SLACK_NS = 60 * MS


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_end_request_stops_the_vehicle_and_then_releases_it(
    programs: Programs, bus: Observer, vehicle: Vehicle, number: signal.Signals
) -> None:
    loop, moving = driven(programs, bus)
    loop.send_signal(number)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, bus.wait_samples(5))
    assert decided(record) == ["NOMINAL", "SHUTDOWN"]
    stops = [pair for pair in record.pairs if pair.reason == "SHUTDOWN" and pair.is_enabled]
    releases = [pair for pair in record.pairs if not pair.is_enabled]
    assert stops
    assert all(pair.is_stop for pair in stops)
    assert releases
    assert releases[0].stamp_ns > stops[-1].stamp_ns
    assert all(abs(sample.speed_mps) < 0.06 for sample in record.samples if sample.stamp_ns >= releases[0].stamp_ns)
    assert not own_faults(record)
    assert vehicle.mode == READY
    assert summary(programs)["reason"] == "SHUTDOWN"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_second_end_request_releases_at_once_with_one_pair(
    programs: Programs, bus: Observer, vehicle: Vehicle, number: signal.Signals
) -> None:
    loop, moving = driven(programs, bus)
    loop.send_signal(number)
    bus.wait_for("the stop", "DRIVE_COMMAND", REASON="SHUTDOWN", ENABLE=1, since=moving)
    loop.send_signal(number)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, bus.wait_samples(30))
    assert len([pair for pair in record.pairs if not pair.is_enabled]) == 1
    assert not record.pairs[-1].is_enabled
    assert record.samples[-1].speed_mps > 0.1
    assert vehicle.mode == READY


@pytest.mark.parametrize("is_interrupted", [False, True], ids=["alone", "interrupted meanwhile"])
def test_the_end_of_the_duration_stops_the_vehicle_and_ends_the_loop(
    programs: Programs, bus: Observer, is_interrupted: bool
) -> None:
    programs.start("sim", "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    loop, moving = driven(programs, bus, "--trajectory", line_file(programs.folder), "--duration", "2.5")
    if is_interrupted:
        bus.wait_for("the stop", "DRIVE_COMMAND", REASON="SHUTDOWN", ENABLE=1, since=moving)
        loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, bus.wait_samples(5))
    assert decided(record) == ["NOMINAL", "SHUTDOWN"]
    assert abs(record.samples[-1].speed_mps) < 0.06
    assert not record.faults()


def test_after_the_loop_is_killed_nothing_is_sent_and_the_vehicles_watchdog_brakes(
    programs: Programs, bus: Observer
) -> None:
    programs.start("sim", "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    loop, moving = driven(programs, bus)
    loop.kill()
    killed_ns = time.time_ns()  # the clock of the kernel's stamps
    index, fault = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    bus.wait_until("the vehicle stands", is_standing, since=index)
    sent = bus.sent_by_controller(moving, bus.wait_samples(30))
    assert [frame for frame in sent if frame.stamp_ns > killed_ns] == []
    last = bus.record(moving, index).pairs[-1]
    watched_ns = fault.stamp_ns - last.stamp_ns
    assert WATCHDOG_NS - STATUS_PERIOD_NS <= watched_ns <= WATCHDOG_NS + STATUS_PERIOD_NS + SLACK_NS


def test_after_the_vehicle_is_killed_the_loop_stops_goes_silent_and_exits_with_4(
    programs: Programs, bus: Observer
) -> None:
    sim = programs.start("sim", "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    loop, moving = driven(programs, bus)
    sim.kill()
    loop.wait_for_line("SILENT .STATE_STALE")
    record = bus.record(moving)
    assert reasons(record.pairs) == ["NOMINAL", "STATE_STALE"]
    assert all(pair.is_enabled for pair in record.pairs)
    assert not own_faults(record)
    silent = bus.now()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    assert bus.sent_by_controller(silent) == []


def test_a_summary_that_cannot_be_written_changes_neither_the_status_4_nor_the_table(
    programs: Programs, bus: Observer
) -> None:
    sim = programs.start("sim", "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    loop, _ = driven(programs, bus, "--trajectory", line_file(programs.folder), "--summary", "/dev/full")
    sim.kill()
    loop.wait_for_line("SILENT .STATE_STALE")
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    loop.wait_for_line(r"  latched fault +STATE_STALE")
    loop.wait_for_line("--summary /dev/full: cannot be written: No space left on device")


def test_a_link_that_goes_down_silences_the_loop_and_it_drives_again_only_when_armed(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, _ = driven(programs, bus)
    set_link("down")
    loop.wait_for_line("SILENT .LINK_DOWN")
    cut = bus.now()
    set_link("up")
    loop.wait_for_line("link RECOVERING")
    bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=cut)
    vehicle.make_ready()
    quiet = bus.wait_samples(80)
    assert bus.sent_by_controller(cut, quiet) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=quiet)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()


def test_an_absent_interface_is_rejected_with_the_command_that_creates_it(programs: Programs) -> None:
    loop = programs.start("run", "--channel", "vcan7", "--route", "figure8", "--arm")
    assert loop.wait_for_end() == 3
    assert "sudo ip link add dev vcan7 type vcan" in loop.text
    assert len(loop.lines) == 1


def test_an_interface_that_is_down_is_rejected_with_the_command_that_brings_it_up(programs: Programs) -> None:
    set_link("down")
    loop = programs.run("--route", "figure8", "--arm")
    assert loop.wait_for_end() == 3
    assert "sudo ip link set vcan0 up" in loop.text
    assert len(loop.lines) == 1


def bad_profile(folder: Path) -> list[str]:
    """The reference profile with a key that does not exist."""
    reference = Path(__file__).resolve().parents[2] / "dbc" / "reference.toml"
    (folder / "bad.toml").write_text(reference.read_text().replace("wheelbase_m", "wheelbas_m"))
    (folder / "reference.dbc").write_bytes(reference.with_suffix(".dbc").read_bytes())
    return ["--route", "line", "--profile", str(folder / "bad.toml")]


def bad_csv(folder: Path) -> list[str]:
    """A trajectory with a word in its third line."""
    path = folder / "bad.csv"
    path.write_text("time_s,x_m,y_m,heading_rad,speed_mps\n0,0,0,0,1\n1,1,zero,0,1\n")
    return ["--trajectory", str(path)]


@pytest.mark.usefixtures("vehicle")
@pytest.mark.parametrize(
    ("bad", "complaint"), [(bad_profile, "wheelbas_m"), (bad_csv, "bad.csv, line 3, column 3")], ids=["profile", "csv"]
)
def test_a_bad_file_is_rejected_before_the_first_frame(
    programs: Programs, bus: Observer, bad: Callable[[Path], list[str]], complaint: str
) -> None:
    loop = programs.run("--arm", *bad(programs.folder))
    assert loop.wait_for_end() == 2
    assert complaint in loop.text
    assert len(loop.lines) == 1
    assert bus.sent_by_controller() == []


def test_engaging_is_aborted_after_three_seconds_without_the_vehicle(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    vehicle.engages = False
    loop = programs.run("--arm", "--route", "line")
    index, first = bus.wait_for("engaging", "DRIVE_COMMAND", ENABLE=1)
    _, last = bus.wait_for("giving up", "DRIVE_COMMAND", ENABLE=0, REASON="VEHICLE_NOT_AUTONOMOUS", since=index)
    assert 2_900 * MS < last.stamp_ns - first.stamp_ns < 3_300 * MS
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    assert all(decoded["MODE"] != AUTONOMOUS for decoded in bus.record().of("VEHICLE_STATUS"))
