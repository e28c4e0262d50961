"""The shipped profile of a production car: only watched, and its checksums verified."""

from pathlib import Path

import pytest

from tests.harness import START_NS, Drive, ms
from vehicle_iface.cli import main
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.codec.decoder import DropCause
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.status import Gear, VehicleMode

DBC = Path(__file__).parents[2] / "dbc"
CHECKED = (180, 466, 608, 610)
SPEED = 180


@pytest.fixture(scope="module")
def database() -> VehicleDatabase:
    return load_database(load_profile("toyota_rav4"))


def test_a_watched_car_is_shown_as_it_moves_and_nothing_is_sent(database: VehicleDatabase) -> None:
    drive = Drive(database=database, armed=False)
    drive.send_line("throttle 1")
    drive.send_line("steer 2")
    drive.run_s(5.0)
    true = drive.vehicle.state
    assert true.speed_mps > 3.0
    assert drive.state.speed_mps == pytest.approx(true.speed_mps, abs=0.1)
    assert drive.state.front_wheel_angle_rad == pytest.approx(true.front_wheel_angle_rad, abs=0.001)
    assert drive.state.yaw_rate_radps == pytest.approx(true.yaw_rate_radps, abs=0.02)
    assert drive.state.x_m == pytest.approx(true.x_m, abs=0.3)
    assert drive.sent == []
    assert drive.mode() is Mode.SHADOW
    status = drive.loop._assembler.status
    assert status is not None
    assert (status.mode, status.gear, status.driver_throttle) == (VehicleMode.MANUAL, Gear.DRIVE, True)


def test_the_gear_gives_a_watched_speed_its_sign(database: VehicleDatabase) -> None:
    drive = Drive(database=database, armed=False, gear=Gear.REVERSE)
    drive.send_line("throttle 1")
    drive.run_s(3.0)
    assert drive.vehicle.state.speed_mps < -2.0
    assert drive.state.speed_mps == pytest.approx(drive.vehicle.state.speed_mps, abs=0.1)


def test_the_checksum_is_the_sum_over_identifier_length_and_bytes(database: VehicleDatabase) -> None:
    vehicle = simulated_vehicle(database, start_ns=START_NS)
    vehicle.set_driver(vehicle.driver)
    frames = [frame for tick in range(50) for frame in vehicle.advance(START_NS + ms(12 * tick))]
    checked = [frame for frame in frames if frame.can_id in CHECKED]
    assert {frame.can_id for frame in checked} == set(CHECKED)
    for frame in checked:
        assert frame.data[7] == (frame.can_id % 256 + frame.can_id // 256 + 8 + sum(frame.data[:7])) % 256


def test_a_wrong_checksum_is_dropped_and_counted_and_completes_no_sample(database: VehicleDatabase) -> None:
    drive = Drive(database=database, armed=False)
    drive.send_line("throttle 1")
    drive.run_s(2.0)
    drops, stamp_ns = drive.loop._decoder.drops, drive.state.stamp_ns
    assert drops == {}
    drive.send_line("corrupt SPEED 5")
    drive.run_s(0.15)
    assert drops == {(DropCause.BAD_CRC, "SPEED"): 5}
    drive.send_line("corrupt SPEED 100")
    drive.run_s(0.3)
    assert drive.state.stamp_ns < drive.clock.t_ns - ms(250)
    assert drive.state.stamp_ns > stamp_ns


def test_a_watched_car_cannot_be_armed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--interface", "embedded", "--route", "line", "--profile", "toyota_rav4", "--arm"]) == 2
    assert "profile toyota_rav4 has no [command], so it can only be watched" in capsys.readouterr().err
