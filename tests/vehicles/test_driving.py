"""Vehicles of other vendors are driven by their profiles alone: loop and simulated vehicle on an embedded bus."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec import UNSET

from tests import harness
from tests.harness import Drive, Sent
from tests.vehicles.files import load_text, load_vehicle
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.summary import table
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.route import RouteConfig
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.trajectories.source import FixedTrajectory

VEHICLES = tuple(sorted(path.stem for path in Path(__file__).parent.glob("*.toml")))
FIGURE = make_route("figure8", RouteConfig(half_width_m=18.0))


@pytest.fixture(autouse=True)
def _keep_frames_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness takes the reference vehicle's commands apart, and these are none."""
    monkeypatch.setattr(harness, "decode_sent", _keep)


def _keep(frame: CanFrame, at_ns: int, step: int) -> Sent:
    return Sent(at_ns, step, "CMD", 0, {}, frame)


def drive_of(name: str, folder: Path) -> Drive:
    """Along a straight, in the vehicle's own frame of reference."""
    database = load_vehicle(name, folder)
    return Drive(FixedTrajectory(harness.straight(frame_id=database.profile.state.frame_id)), database=database)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_drives_a_figure_of_eight(name: str, tmp_path: Path) -> None:
    database = load_vehicle(name, tmp_path)
    source = RecedingRoute(FIGURE, frame_id=database.profile.state.frame_id)
    drive, aside_m, lap_m = Drive(source, database=database).engage(), 0.0, 0.0
    while lap_m < FIGURE.length_m - 2.0:
        drive.run_s(0.2)
        state, lap_m = drive.vehicle.state, max(lap_m, source.progress_m)
        aside_m = max(aside_m, float(np.min(np.hypot(FIGURE.x_m - state.x_m, FIGURE.y_m - state.y_m))))
        assert drive.mode() is Mode.ENGAGED, drive.loop.reason
        assert drive.now_s < 60.0
    assert aside_m < 0.5
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS
    assert drive.vehicle.counters["commands_dropped"] == 0
    assert drive.loop._decoder.drops == {}
    measured, true = drive.state, drive.vehicle.state
    near_m = 0.4 if name == "odometry" else 0.15
    assert math.hypot(measured.x_m - true.x_m, measured.y_m - true.y_m) < near_m


@pytest.mark.parametrize("name", VEHICLES)
def test_a_driver_who_brakes_has_the_vehicle(name: str, tmp_path: Path) -> None:
    drive = drive_of(name, tmp_path).engage(1.0)
    drive.send_line("brake 1")
    drive.run_s(0.1)
    assert drive.mode() is Mode.OVERRIDDEN
    status = drive.loop._assembler.status
    assert status is not None
    assert (status.mode, status.driver_brake) == (VehicleMode.MANUAL, True)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_of_which_nothing_new_is_known_is_stopped(name: str, tmp_path: Path) -> None:
    drive = drive_of(name, tmp_path).engage(1.0)
    for part in drive.vehicle.sample:
        drive.send_line(f"mute {part} on")
        drive.run_s(0.15)
        assert drive.loop.reason.name == "STATE_STALE"
        drive.send_line(f"mute {part} off")
        drive.run_s(0.15)
        if name == "odometry":
            break  # dead reckoning has lost its place
    speed_mps = drive.vehicle.state.speed_mps
    drive.send_line("mute STATE on")
    drive.run_s(0.2)
    assert drive.vehicle.state.speed_mps < speed_mps


def test_a_fault_that_is_only_a_code_stops_the_vehicle_and_latches(tmp_path: Path) -> None:
    drive = drive_of("fault_code", tmp_path).engage(1.0)
    drive.send_line("fault 7")
    drive.run_s(0.1)
    status = drive.loop._assembler.status
    assert status is not None
    assert (status.mode, status.fault_code) == (VehicleMode.FAULT, 7)
    assert drive.mode() is Mode.FAULT
    drive.send_line("reset")
    drive.send_line("ready")
    drive.run_s(1.0)
    assert drive.mode() is Mode.FAULT


def test_the_gear_gives_the_speed_its_sign(tmp_path: Path) -> None:
    back = FixedTrajectory(harness.straight(60.0, -3.0))
    drive = Drive(back, database=load_vehicle("gears", tmp_path))
    drive.run_until(lambda: drive.vehicle.state.speed_mps < -2.5, 10.0)
    assert drive.state.speed_mps == pytest.approx(drive.vehicle.state.speed_mps, abs=0.1)
    status = drive.loop._assembler.status
    assert status is not None
    assert status.gear is Gear.REVERSE


def test_flags_report_each_override_and_a_fault(tmp_path: Path) -> None:
    for line, mode in (("steer 5", Mode.OVERRIDDEN), ("fault 1", Mode.FAULT), ("emergency_stop", Mode.FAULT)):
        drive = drive_of("flags", tmp_path).engage(1.0)
        drive.send_line(line)
        drive.run_s(0.1)
        assert drive.mode() is mode


def test_a_fix_that_the_receiver_doubts_stops_the_vehicle(tmp_path: Path) -> None:
    drive = drive_of("wheels_and_fix", tmp_path).engage(1.0)
    drive.send_line("pose_valid 0")
    drive.run_s(0.1)
    assert drive.loop.reason.name == "STATE_INVALID"


def test_interrupted_odometry_stops_for_good_and_restarts_when_armed(tmp_path: Path) -> None:
    drive = drive_of("odometry", tmp_path).engage(2.0)
    part = drive.vehicle.sample[0]
    drive.send_line(f"mute {part} on")
    drive.run_s(0.15)
    drive.send_line(f"mute {part} off")
    drive.run_until(lambda: drive.mode() is Mode.HALTED, 5.0)
    assert drive.loop.reason.name == "STATE_INVALID"
    assert drive.state.x_m > 0.5
    drive.loop.arming.request()
    drive.run_s(0.05)
    assert drive.state.x_m == pytest.approx(0.0, abs=0.01)
    drive.run_until(lambda: drive.vehicle.state.speed_mps > 1.0, 5.0)
    assert (drive.mode(), drive.loop.reason.name) == (Mode.ENGAGED, "NOMINAL")


def test_each_message_comes_at_its_own_period(tmp_path: Path) -> None:
    vehicle = drive_of("own_counters", tmp_path).vehicle
    sent = [frame.can_id for tick in range(100) for frame in vehicle.advance(harness.START_NS + harness.ms(10 * tick))]
    assert {can_id: sent.count(can_id) for can_id in sent} == {272: 100, 273: 50, 256: 50}
    assert sent[:3] == [256, 273, 272]


def test_a_vehicle_with_slow_commands_waits_for_ten_of_them_before_it_misses_one(tmp_path: Path) -> None:
    toml, dbc = (
        (Path(__file__).with_name("sample_by_time").with_suffix(kind)).read_text(encoding="utf-8")
        for kind in (".toml", ".dbc")
    )
    database = load_text(f"{toml}\n[command.periods]\nCMD = 0.1\n", dbc, tmp_path)
    source = FixedTrajectory(harness.straight(frame_id=database.profile.state.frame_id))
    drive = Drive(source, database=database).engage(1.0)
    assert drive.vehicle.counters["commands_lost"] == 0
    drive.line.full = True
    drive.run_s(0.85)
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS
    drive.run_s(0.2)
    assert drive.vehicle.counters["commands_lost"] == 1


def test_the_summary_shows_the_age_of_each_part_and_how_far_odometry_went(tmp_path: Path) -> None:
    drive = drive_of("odometry", tmp_path).engage(2.0)
    way_m = drive.vehicle.state.x_m
    summary = drive.loop.summary()
    assert summary.odometry_m == pytest.approx(way_m, abs=0.1)
    assert "m driven; its error grows with the distance" in table(summary)
    by_time = drive_of("sample_by_time", tmp_path).engage(1.0)
    ages_s = by_time.loop.summary().part_ages_s
    assert ages_s is not UNSET
    assert set(ages_s) == set(by_time.vehicle.sample)
    assert 0.0 < max(ages_s.values()) < 0.1
    assert "oldest parts of a sample" in table(by_time.loop.summary())
