"""The profiles of other makers' vehicles in `dbc/`: driven on an embedded bus, and stopped as FAILURES.md says."""

from collections.abc import Iterator

import numpy as np
import pytest

from tests import harness
from tests.harness import Drive, Sent
from vehicle_iface import compose
from vehicle_iface.codec.database import load_database
from vehicle_iface.drivable import build_route
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.engagement import Mode
from vehicle_iface.trajectories.receding import RecedingRoute

VEHICLES = ("agilex_hunter",)
MOTION_COMMAND, CONTROL_MODE_SETTING = 0x111, 0x421


@pytest.fixture(autouse=True)
def _keep_frames_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness takes the reference vehicle's commands apart, and these are none."""
    monkeypatch.setattr(harness, "taken_apart", _keep)


def _keep(frame: CanFrame, at_ns: int, step: int) -> Sent:
    return Sent(at_ns, step, "", 0, {}, frame)


def drive_of(name: str, route: str) -> tuple[Drive, RecedingRoute]:
    """Along a route of the program, in the vehicle's own frame of reference."""
    database = load_database(load_profile(name))
    source = RecedingRoute(build_route(route, database.profile), frame_id=database.profile.state.frame_id)
    controller = compose.build_controller("pure_pursuit", database.profile)
    return Drive(source, database=database, controller=controller), source


def frames_of(drive: Drive, can_id: int) -> Iterator[bytes]:
    """The payloads that left with an identifier."""
    return (sent.frame.data for sent in drive.sent if sent.frame.can_id == can_id)


@pytest.mark.parametrize("route", ["figure8", "u_turn", "stop_and_go"])
@pytest.mark.parametrize("name", VEHICLES)
def test_a_shipped_vehicle_drives_a_route_within_15_cm(name: str, route: str) -> None:
    drive, source = drive_of(name, route)
    drive.engage()
    path, aside_m = source.route, 0.0
    while source.progress_m < path.length_m - 2.0:
        drive.run_s(0.5)
        state = drive.vehicle.state
        aside_m = max(aside_m, float(np.min(np.hypot(path.x_m - state.x_m, path.y_m - state.y_m))))
        assert drive.mode() is Mode.ENGAGED
        assert drive.now_s < 120.0
    assert aside_m < 0.15


@pytest.mark.parametrize("name", VEHICLES)
def test_a_shipped_vehicle_without_samples_is_stopped(name: str) -> None:
    drive, _ = drive_of(name, "line")
    drive.engage(1.0)
    drive.say(f"mute {drive.vehicle.sample[0]} on")
    drive.run_s(0.2)
    assert drive.loop.reason.name == "STATE_STALE"
    drive.run_until(lambda: abs(drive.vehicle.state.speed_mps) < 0.02, 3.0)


@pytest.mark.parametrize(("order", "mode"), [("brake 1", Mode.OVERRIDDEN), ("fault 1", Mode.FAULT)])
def test_the_hunter_is_let_go_when_its_remote_control_takes_over_or_it_reports_a_fault(order: str, mode: Mode) -> None:
    drive, _ = drive_of("agilex_hunter", "line")
    drive.engage(1.0)
    drive.say(order)
    drive.run_s(0.3)
    assert drive.mode() is mode


def test_the_hunter_is_in_can_control_only_while_commands_are_enabled() -> None:
    drive, _ = drive_of("agilex_hunter", "line")
    drive.run_until(lambda: drive.mode() is Mode.STANDBY, 2.0)
    assert set(frames_of(drive, CONTROL_MODE_SETTING)) <= {b"\x00"}
    drive.engage(0.5)
    assert list(frames_of(drive, CONTROL_MODE_SETTING))[-1] == b"\x01"
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 10.0)
    assert list(frames_of(drive, MOTION_COMMAND))[-1][:2] == b"\x00\x00"
    assert list(frames_of(drive, CONTROL_MODE_SETTING))[-1] == b"\x00"
