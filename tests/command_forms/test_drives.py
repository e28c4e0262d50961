"""Vehicles with other forms of commands are driven and stopped, in closed loop with a simulated vehicle of each."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from tests import harness
from tests.harness import Drive, Sent, straight
from vehicle_iface.cli import main
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.drivable import build_route
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.command_forms import Fields, Interpret
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.status import Gear
from vehicle_iface.trajectories import RecedingRoute
from vehicle_iface.trajectories.source import FixedTrajectory

from .vehicles import CURVATURE, DRIVE_AND_BRAKE, PEDALS, ROVER, TWIST, load_vehicle, write_vehicle

FEEDBACK = ("[4.0, 60.0]]", "[4.0, 60.0]]\nfeedback = { kp = 0.1, ki = 0.5 }")
ACCEL_SENT = (
    (' SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC', ' SG_ V : 48|8@1- (0.1,0) [-9|9] "m/s" PC\n'
     ' SG_ A : 56|8@1- (0.1,0) [-9|9] "m/s^2" PC'),
)  # fmt: skip
KINDS = {
    "speed": ROVER,
    "pedals": PEDALS,
    "drive_and_brake": DRIVE_AND_BRAKE,
    "curvature": CURVATURE,
    "yaw_rate": TWIST,
}


class Commands:
    """What a vehicle was sent, by field, one entry for each frame."""

    def __init__(self, database: VehicleDatabase, monkeypatch: pytest.MonkeyPatch) -> None:
        self.all: list[dict[str, float]] = []
        self._decoder = Decoder(database.commands)
        self._fields = {message.name: message.fields for message in database.commands}
        monkeypatch.setattr(harness, "decode_sent", self._take)

    def _take(self, frame: CanFrame, at_ns: int = 0, step: int = 0) -> Sent:
        received = self._decoder.decode(frame)
        assert received is not None
        fields = zip(self._fields[received.name], received.values, strict=True)
        values = {field: float(value) for field, value in fields if value is not None}
        self.all.append(values)
        return Sent(at_ns, step, received.name, 0, values, frame)

    def of(self, field: str) -> list[float]:
        return [values[field] for values in self.all if field in values]


@pytest.fixture(params=KINDS)
def database(request: pytest.FixtureRequest, tmp_path: Path) -> VehicleDatabase:
    return load_vehicle(tmp_path, KINDS[request.param])


@pytest.mark.parametrize("kind", KINDS)
def test_check_dbc_passes(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-dbc", str(write_vehicle(tmp_path, KINDS[kind]))]) == 0, capsys.readouterr().err


def test_a_figure_of_eight_is_driven_within_the_limits(
    database: VehicleDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits, commands = database.profile.limits, Commands(database, monkeypatch)
    route = build_route("figure8", database.profile)
    x_m, y_m, heading_rad = route.start
    start = BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    drive = Drive(RecedingRoute(route), database=database, start=start).engage()
    states = []
    while drive.now_s < 32.0:
        drive.step()
        states.append(drive.vehicle.state)
    assert drive.mode() is Mode.ENGAGED
    assert max(_distance_m(route.x_m, route.y_m, state) for state in states[::20]) < 0.4
    angles_rad = [state.front_wheel_angle_rad for state in states]
    assert min(angles_rad) < -0.2
    assert max(angles_rad) > 0.2
    assert max(state.speed_mps for state in states) <= limits.speed_max_mps
    assert all(limits.accel_min_mps2 <= state.accel_mps2 <= limits.accel_max_mps2 + 0.01 for state in states)
    assert max(commands.of("speed_mps"), default=0.0) <= limits.speed_max_mps


@pytest.mark.parametrize(("order", "reason"), [("mute POSE on", "STATE_STALE"), ("pose_jump", "STATE_INVALID")])
def test_a_stop_ends_at_standstill_with_the_stop_commanded(
    database: VehicleDatabase, monkeypatch: pytest.MonkeyPatch, order: str, reason: str
) -> None:
    commands = Commands(database, monkeypatch)
    drive = Drive(FixedTrajectory(straight(speed_mps=4.0)), database=database).engage(3.0)
    before = len(commands.all)
    if order == "pose_jump":
        drive.vehicle.jump(0.0, 40.0)
    else:
        drive.send_line(order)
    drive.run_s(0.3)
    assert drive.loop.reason.name == reason
    drive.run_until(lambda: drive.vehicle.state.speed_mps == 0.0, 2.6)
    drive.run_s(0.1)
    assert drive.mode() is Mode.ENGAGED
    stop = commands.all[before + 20 :]
    assert not any(values.get("drive_mps2", 0.0) or values.get("throttle", 0.0) for values in stop)
    speeds_mps = [values["speed_mps"] for values in stop if "speed_mps" in values]
    assert speeds_mps == sorted(speeds_mps, reverse=True)
    last = {key: value for values in stop[-4:] for key, value in values.items()}
    assert last["enable"] == 1.0
    assert last.get("speed_mps", 0.0) == 0.0
    assert last.get("brake_mps2", 1.0) > 0.0
    assert last.get("brake", 1.0) > 0.0


@pytest.mark.parametrize("kind", ["curvature", "yaw_rate"])
def test_a_three_point_turn_is_driven_both_ways(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    database = load_vehicle(tmp_path, KINDS[kind])
    commands = Commands(database, monkeypatch)
    route = build_route("three_point_turn", database.profile)
    x_m, y_m, heading_rad = route.start
    source = RecedingRoute(route)
    drive = Drive(source, database=database, start=BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)).engage()
    gears, aside_m = [drive.vehicle.gear], 0.0
    while drive.now_s < 90.0 and not (source.finished and drive.vehicle.state.speed_mps == 0.0):
        drive.step()
        if drive.vehicle.gear is not gears[-1]:
            gears.append(drive.vehicle.gear)
            assert abs(drive.vehicle.state.speed_mps) < 0.05
        aside_m = max(aside_m, _distance_m(route.x_m, route.y_m, drive.vehicle.state))
    assert source.finished
    assert gears[-3:] == [Gear.DRIVE, Gear.REVERSE, Gear.DRIVE]
    assert aside_m < 0.5
    speeds_mps = commands.of("speed_mps")
    assert all(after * before >= 0.0 for before, after in itertools.pairwise(speeds_mps))


@pytest.mark.parametrize("kind", ["pedals", "drive_and_brake"])
def test_a_vehicle_without_gears_on_its_bus_is_never_driven_backwards(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = load_vehicle(tmp_path, KINDS[kind])
    commands = Commands(database, monkeypatch)
    drive = Drive(FixedTrajectory(straight(speed_mps=-2.0)), database=database).engage()
    drive.run_s(3.0)
    assert drive.vehicle.state.speed_mps == 0.0
    assert not any(commands.of("throttle") + commands.of("drive_mps2"))
    assert any(commands.of("brake") + commands.of("brake_mps2"))


def test_a_speed_without_sign_goes_backwards_by_the_gear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    toml = (
        ('enable = "CMD.EN"', 'enable = "CMD.EN"\ngear_request = "CMD.GEAR"'),
        ("[command]", 'gear = "STATUS.GEAR"\n[command]'),
    )
    signed, unsigned = " SG_ V : 8|16@1- (0.001,0) [-5|5]", " SG_ V : 8|16@1+ (0.001,0) [0|5]"
    dbc = ((signed, f' SG_ GEAR : 1|3@1+ (1,0) [0|7] "" CAR\n{unsigned}'),)
    database = load_vehicle(tmp_path, TWIST, toml, dbc)
    Commands(database, monkeypatch)
    drive = Drive(FixedTrajectory(straight(speed_mps=-2.0)), database=database).engage()
    drive.run_until(lambda: drive.vehicle.state.speed_mps < -1.8, 6.0)
    assert drive.vehicle.gear is Gear.REVERSE


@pytest.mark.parametrize(("has_feedback", "expected"), [(False, 0.75), (True, 1.0)])
def test_feedback_corrects_pedals_that_do_less_than_their_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_feedback: bool, expected: float
) -> None:
    toml = (
        ('speed_mps = "POSE.V"', 'speed_mps = "POSE.V"\naccel_mps2 = "POSE.A"'),
        ("by_speed = [[0.0, 3.0], [10.0, 3.0], [20.0, 1.5]]", "by_speed = [[0.0, 1.0]]"),
    )
    database = load_vehicle(tmp_path, PEDALS, (*toml, FEEDBACK) if has_feedback else toml, ACCEL_SENT)
    Commands(database, monkeypatch)
    drive = Drive(FixedTrajectory(straight(speed_mps=4.5)), database=database)
    drive.vehicle._interpret = _weaken(drive.vehicle._interpret)
    drive.engage(1.0)
    drive.run_until(lambda: drive.vehicle.state.speed_mps > 3.0, 8.0)
    command = drive.last_command()
    assert command is not None
    assert drive.vehicle.state.accel_mps2 / command.accel_mps2 == pytest.approx(expected, abs=0.1)


def _weaken(interpret: Interpret | None) -> Interpret:
    """A vehicle whose pedals do three quarters of what their table says."""

    def interpret_weakly(fields: Fields, state: BicycleState, gear: Gear) -> Fields:
        assert interpret is not None
        meant = interpret(fields, state, gear)
        return {**meant, "accel_mps2": 0.75 * meant["accel_mps2"]}

    return interpret_weakly


def _distance_m(x_m: np.ndarray, y_m: np.ndarray, state: BicycleState) -> float:
    return math.sqrt(float(np.min((x_m - state.x_m) ** 2 + (y_m - state.y_m) ** 2)))
