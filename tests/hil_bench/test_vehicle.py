"""The bench's simulated vehicle."""

import re
from pathlib import Path

import pytest
from hil_bench.plant import Plant
from hil_bench.vehicle import Vehicle
from hil_bench.wire import Wire
from scenes import WIRE, CommandedVehicle
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MANUAL, READY, DecodedFrame, S


def test_vehicle_engages_with_the_third_intact_pair_and_disengages_with_enable_0() -> None:
    commanded = CommandedVehicle()
    for _ in range(2):
        commanded.pair()
    assert commanded.vehicle.mode == READY
    commanded.pair()
    assert commanded.vehicle.mode == AUTONOMOUS
    commanded.pair(enable=0)
    assert commanded.vehicle.mode == READY


def test_vehicle_executes_commands_and_its_watchdog_stops_it_after_100_ms_of_silence() -> None:
    commanded = CommandedVehicle()
    commanded.tick(200, accel=2.0)
    assert commanded.vehicle.plant.speed_mps == pytest.approx(3.8, abs=0.2)
    commanded.tick(10)
    assert commanded.vehicle.mode == AUTONOMOUS
    commanded.tick(2)
    assert commanded.vehicle.mode == FAULT
    commanded.tick(200)
    assert commanded.vehicle.plant.speed_mps == 0.0


def test_repeated_counters_do_not_feed_the_watchdog() -> None:
    commanded = CommandedVehicle()
    commanded.tick(50, accel=2.0)
    for _ in range(15):
        commanded.send(WIRE.pack("DRIVE_COMMAND", commanded.counter, ENABLE=1))
        commanded.send(WIRE.pack("STEER_COMMAND", commanded.counter, ENABLE=1))
        commanded.tick()
    assert commanded.vehicle.mode == FAULT


@pytest.mark.parametrize(
    ("attribute", "value"), [("driver_brake", True), ("driver_throttle", True), ("driver_torque_nm", -3.0)]
)
def test_driver_override_acts_at_once(attribute: str, value: object) -> None:
    commanded = CommandedVehicle()
    commanded.tick(20, accel=1.0)
    setattr(commanded.vehicle, attribute, value)
    commanded.tick(1, accel=1.0)
    assert commanded.vehicle.mode == MANUAL
    commanded.tick(10, accel=1.0)
    assert commanded.vehicle.mode == MANUAL


def test_a_stop_never_moves_the_vehicle_backwards_and_gears_change_only_at_rest() -> None:
    commanded = CommandedVehicle()
    commanded.tick(150, accel=2.0)
    commanded.tick(20, accel=-3.0, gear=1)
    assert commanded.vehicle.gear == 3
    commanded.tick(300, accel=-3.0, stop=1, gear=7)
    assert commanded.vehicle.plant.speed_mps == 0.0
    assert min(instant.speed_mps for instant in commanded.vehicle.history) >= 0.0
    commanded.tick(100, accel=-1.0, gear=1)
    assert commanded.vehicle.gear == 1
    assert commanded.vehicle.plant.speed_mps < -0.5


def test_a_vehicle_without_lights_and_report_can_be_tested(tmp_path: Path) -> None:
    (tmp_path / "reference.dbc").write_text(WIRE.dbc.read_text())
    (tmp_path / "plain.toml").write_text(WIRE.path.read_text().partition("[body.signals]")[0])
    wire = Wire(str(tmp_path / "plain.toml"))
    assert set(wire.ids) == set(WIRE.ids) - {"BODY_COMMAND", "CONTROLLER_STATUS"}


def test_a_vehicle_without_gears_and_with_other_mode_numbers_can_be_tested(tmp_path: Path) -> None:
    gears = ('"VEHICLE_STATUS.GEAR"', '"DRIVE_COMMAND.GEAR_REQUEST"')
    toml = [line for line in WIRE.path.read_text().splitlines() if not any(gear in line for gear in gears)]
    toml[toml.index(next(line for line in toml if "[status.modes]" in line))] = '[status.modes]\nAUTO = "AUTONOMOUS"'
    dbc = [line for line in WIRE.dbc.read_text().splitlines() if not {"GEAR", "GEAR_REQUEST"} & set(line.split()[:4])]
    modes = 'MODE 4 "MANUAL" 3 "READY" 0 "AUTO" 2 "FAULT" 1 "EMERGENCY_STOP" ;'
    (tmp_path / "reference.dbc").write_text(re.sub(r'MODE 0 "MANUAL".*', modes, "\n".join(dbc) + "\n"))
    (tmp_path / "other.toml").write_text("\n".join(toml) + "\n")
    wire = Wire(str(tmp_path / "other.toml"))
    vehicle = Vehicle(wire, Plant(wheelbase_m=2.7))
    for accel, way in ((1.0, 1.0), (-1.0, -1.0)):
        vehicle.mode = AUTONOMOUS
        vehicle.commands = {
            "DRIVE_COMMAND": DecodedFrame(0, "DRIVE_COMMAND", {"ACCEL_REQUEST": accel, "SAFE_STOP": 0.0})
        }
        vehicle._seen_ns = dict.fromkeys(wire.command, 10 * S)
        vehicle.plant.speed_mps = 0.0
        for _ in range(50):
            vehicle.move(0.01, 10 * S)
        assert vehicle.plant.speed_mps * way > 0.2
    status = wire.intact(vehicle.next_frames()[0])
    assert status is not None
    assert status["MODE"] == 0
