"""The other side of each form: a simulated vehicle that obeys it, a shadow that compares it, frames that are lost."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests import harness
from tests.harness import Drive, Sent, straight
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.command import SafeCommand
from vehicle_iface.command_forms import CommandReader, MeasuredMotion, build_former
from vehicle_iface.frame import CanFrame
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.command_forms import SPEED_BRAKE_MPS2, SPEED_DRIVE_MPS2, build_interpreter, track_speed_mps2
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.state import VehicleState
from vehicle_iface.state_assembler import Sample
from vehicle_iface.status import Gear
from vehicle_iface.trajectories.source import FixedTrajectory
from vehicle_iface.units import NS_PER_MS

from .vehicles import CURVATURE, PEDALS, ROVER, TWIST, load_vehicle

OURS = SafeCommand(
    stamp_ns=0,
    enable=True,
    safe_stop=False,
    accel_mps2=-1.0,
    front_wheel_angle_rad=0.2,
    rear_wheel_angle_rad=0.0,
    speed_mps=2.0,
    reason=Reason.NOMINAL,
    gear_request=Gear.NO_REQUEST,
)


@pytest.mark.parametrize(("speed_mps", "sign"), [(1.0, 1.0), (-1.0, -1.0)])
def test_a_simulated_rover_approaches_its_speed_within_its_accelerations(speed_mps: float, sign: float) -> None:
    assert track_speed_mps2(sign * 4.0, speed_mps) == sign * SPEED_DRIVE_MPS2
    assert track_speed_mps2(-sign * 4.0, speed_mps) == -sign * SPEED_BRAKE_MPS2
    assert track_speed_mps2(sign * 1.03, speed_mps) == pytest.approx(sign * 0.1)
    assert track_speed_mps2(0.0, sign * 0.001) == -sign * 0.3
    assert track_speed_mps2(0.0, 0.0) == 0.0


def test_a_simulated_vehicle_brakes_against_its_motion_and_drives_along_its_gear(tmp_path: Path) -> None:
    interpret = build_interpreter(load_vehicle(tmp_path, PEDALS))
    assert interpret is not None

    def accel_mps2(speed_mps: float, gear: Gear, **pedals: float) -> float:
        return interpret(pedals, BicycleState(speed_mps=speed_mps), gear)["accel_mps2"]

    assert accel_mps2(1.0, Gear.DRIVE, throttle=27.5, brake=0.0) == pytest.approx(1.5)
    assert accel_mps2(-1.0, Gear.REVERSE, throttle=27.5, brake=0.0) == pytest.approx(-1.5)
    assert accel_mps2(-1.0, Gear.REVERSE, throttle=0.0, brake=30.0) == pytest.approx(2.0)
    assert accel_mps2(-1.0, Gear.DRIVE, throttle=0.0, brake=30.0) == pytest.approx(2.0)
    assert accel_mps2(0.0, Gear.NEUTRAL, throttle=27.5, brake=0.0) == 0.0


def test_a_simulated_vehicle_at_standstill_keeps_its_wheels_whatever_the_yaw_rate(tmp_path: Path) -> None:
    interpret = build_interpreter(load_vehicle(tmp_path, TWIST))
    assert interpret is not None
    standing = BicycleState(front_wheel_angle_rad=0.3)
    fields = {"speed_mps": 0.0, "yaw_rate_radps": 0.0}
    assert interpret(fields, standing, Gear.DRIVE)["front_wheel_angle_rad"] == 0.3


def test_acceleration_and_wheel_angle_are_not_interpreted() -> None:
    assert build_interpreter(harness.reference()) is None


def shadow_of(database: VehicleDatabase, theirs: SafeCommand) -> Shadow:
    """A shadow that has compared one command of the other commander with `OURS`, at 2 m/s."""
    former = build_former(database.profile, database.command_ranges)
    assert former is not None
    shadow = Shadow(
        database.commands, CommandReader(database.profile), together_ns=5 * NS_PER_MS, longest_ns=50 * NS_PER_MS
    )
    encoder, now_ns = Encoder(database.sent), NS_PER_MS
    for _ in range(2):  # the first one takes the vehicle over
        now_ns += 20 * NS_PER_MS
        state = VehicleState(stamp_ns=now_ns, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=2.0)
        shadow.record(Sample(state, True, True, 0, now_ns, False), OURS, now_ns)
        for frame in encoder.encode_command(former.form(theirs, MeasuredMotion(2.0, 0.0, False), now_ns)):
            shadow.on_foreign_frame(frame._replace(stamp_ns=now_ns + NS_PER_MS))
        shadow.compare()
    assert shadow.compared == 1
    return shadow


@pytest.mark.parametrize("kind", [PEDALS, CURVATURE], ids=["pedals", "curvature"])
def test_a_shadow_compares_other_forms_in_acceleration_and_wheel_angle(tmp_path: Path, kind: tuple[str, str]) -> None:
    shadow = shadow_of(load_vehicle(tmp_path, kind), replace(OURS, accel_mps2=-1.5, front_wheel_angle_rad=0.15))
    assert shadow.summary().accel_mps2.mean == pytest.approx(0.5, abs=0.01)
    assert shadow.summary().front_wheel_angle_rad.mean == pytest.approx(0.05, abs=0.001)


def test_a_shadow_does_not_compare_the_acceleration_of_a_speed(tmp_path: Path) -> None:
    shadow = shadow_of(load_vehicle(tmp_path, ROVER), replace(OURS, front_wheel_angle_rad=0.15))
    assert shadow.accel_mps2.summary().max == 0.0
    assert shadow.summary().front_wheel_angle_rad.mean == pytest.approx(0.05, abs=0.001)


def test_a_vehicle_stops_and_drives_on_when_half_of_each_command_was_lost_for_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def keep(frame: CanFrame, at_ns: int = 0, step: int = 0) -> Sent:
        return Sent(at_ns, step, "", 0, {}, frame)

    monkeypatch.setattr(harness, "decode_sent", keep)
    drive = Drive(FixedTrajectory(straight(speed_mps=4.0)), database=load_vehicle(tmp_path, ROVER)).engage(2.0)
    drive.line.takes = 1
    drive.run_s(0.06)
    drive.line.takes = None
    drive.run_until(lambda: drive.loop.reason is Reason.LINK_DOWN, 0.1)
    drive.run_until(lambda: drive.loop.reason is Reason.NOMINAL, 3.0)
    drive.run_until(lambda: drive.vehicle.state.speed_mps > 3.8, 6.0)
    assert drive.mode() is Mode.ENGAGED
