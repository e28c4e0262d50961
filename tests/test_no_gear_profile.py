"""A vehicle whose bus knows no gears: nothing invents one, and it drives both ways all the same."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.harness import Drive, reference
from vehicle_iface import Reason, Trajectory
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime.reports import END_OF_TRAJECTORY
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.status import Gear
from vehicle_iface.telemetry import SessionInfo, TelemetryReader, TelemetryWriter
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.trajectories.source import FixedTrajectory

GEAR_SIGNALS = ("VEHICLE_STATUS.GEAR", "DRIVE_COMMAND.GEAR_REQUEST")


@pytest.fixture(scope="module")
def gearless(tmp_path_factory: pytest.TempPathFactory) -> VehicleDatabase:
    """The reference vehicle without its gear signals."""
    folder = tmp_path_factory.mktemp("gearless")
    toml = Path(reference().profile.file).read_text(encoding="utf-8").splitlines()
    dbc = Path(reference().profile.dbc).read_text(encoding="utf-8").splitlines()
    names = {"GEAR", "GEAR_REQUEST"}
    toml = [line for line in toml if not any(f'"{dotted}"' in line for dotted in GEAR_SIGNALS)]
    dbc = [line for line in dbc if not (names & set(line.split()[:4]) and line.split()[0] in ("SG_", "CM_", "VAL_"))]
    (folder / "reference.dbc").write_text("\n".join(dbc) + "\n", encoding="utf-8")
    (folder / "gearless.toml").write_text("\n".join(toml) + "\n", encoding="utf-8")
    return load_database(load_profile(folder / "gearless.toml"))


def line(direction: float) -> Trajectory:
    """The line route, or the same backwards: along -x with the nose towards +x."""
    forwards = make_route("line").to_trajectory()
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=forwards.time_from_start_ns,
        x_m=direction * forwards.x_m,
        y_m=forwards.y_m,
        heading_rad=forwards.heading_rad,
        speed_mps=direction * forwards.speed_mps,
        accel_mps2=direction * forwards.accel_mps2,
    )


def test_the_profile_binds_no_gear(gearless: VehicleDatabase) -> None:
    fields = {field for message in (*gearless.received, *gearless.sent) for field in message.fields}
    assert not fields & {"gear", "gear_request"}


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_without_gear_signals_the_line_is_driven_to_its_end(gearless: VehicleDatabase, direction: float) -> None:
    path = line(direction)
    drive = Drive(FixedTrajectory(path), database=gearless).engage()
    drive.run_until(lambda: drive.loop.reason in END_OF_TRAJECTORY, 60.0)
    drive.run_s(5.0)
    assert drive.mode() is Mode.ENGAGED
    state = drive.vehicle.state
    assert state.speed_mps == 0.0
    assert state.x_m == pytest.approx(path.x_m[-1], abs=2.0)
    assert abs(state.y_m) < 0.01
    assert drive.vehicle.gear is (Gear.DRIVE if direction > 0 else Gear.REVERSE)


def test_without_gear_signals_the_way_is_changed_at_each_standstill(gearless: VehicleDatabase) -> None:
    route = make_route("three_point_turn")
    x_m, y_m, heading_rad = route.start
    start = BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    source = RecedingRoute(route)
    drive = Drive(source, database=gearless, start=start).engage()
    gears, aside_m = [drive.vehicle.gear], 0.0
    while drive.now_s < 120.0 and not (source.finished and drive.vehicle.state.speed_mps == 0.0):
        drive.step()
        state = drive.vehicle.state
        if drive.vehicle.gear is not gears[-1]:
            gears.append(drive.vehicle.gear)
            assert abs(state.speed_mps) < 0.05
        aside_m = max(aside_m, float(np.min(np.hypot(route.x_m - state.x_m, route.y_m - state.y_m))))
    assert source.finished
    assert gears == [Gear.DRIVE, Gear.REVERSE, Gear.DRIVE]
    assert aside_m < 0.5


def test_a_stop_does_not_change_the_way(gearless: VehicleDatabase) -> None:
    drive = Drive(FixedTrajectory(line(1.0)), database=gearless).engage(3.0)
    drive.send_line("pose_valid 0")
    drive.run_s(5.0)
    assert drive.vehicle.state.speed_mps == 0.0
    assert drive.vehicle.gear is Gear.DRIVE


def test_an_unreported_gear_is_none_also_in_telemetry(gearless: VehicleDatabase, tmp_path: Path) -> None:
    address = str(tmp_path / "loop")
    with TelemetryWriter(address, SessionInfo(channel="-", bus="-")) as writer, TelemetryReader(address) as reader:
        drive = Drive(FixedTrajectory(line(1.0)), database=gearless, telemetry=writer).engage(1.0)
        status = drive.loop._assembler.status
        assert status is not None
        assert status.gear is None
        reader.poll()
        newest = reader.newest()
        assert newest is not None
        assert (newest.has_status, newest.gear) == (True, Gear.NO_REQUEST)


def test_before_the_first_status_even_a_shadow_would_stop() -> None:
    drive = Drive(armed=False, start=BicycleState(speed_mps=math.pi))
    drive.send_line("mute VEHICLE_STATUS on")
    drive.run_s(0.5)
    assert drive.loop.reason is Reason.STATE_STALE
    drive.send_line("mute VEHICLE_STATUS off")
    drive.run_s(0.3)
    assert drive.loop.reason is not Reason.STATE_STALE
