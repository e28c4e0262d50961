"""The profiles of other makers' vehicles in `dbc/`: driven on an embedded bus, and stopped as FAILURES.md says."""

import itertools
import math
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from vehicle_bus_contract.judge import Sample, lateral_errors_m

from tests import harness
from tests.harness import Drive, Sent
from vehicle_iface import compose
from vehicle_iface.codec.database import load_database
from vehicle_iface.codec.user_checksum import load_function
from vehicle_iface.drivable import build_route
from vehicle_iface.frame import CanFrame
from vehicle_iface.motion_sources import cap_unconfirmed_speed
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.modes import Mode
from vehicle_iface.trajectories.receding import RecedingRoute

VEHICLES = {
    "agilex_hunter": 0.15,
    "agilex_hunter_ins": 0.15,
    "fs_ai_ads_dv": 0.7,  # whole rpm: at a steady 3 m/s odometry reads 0.4 % too much
    "j1939_truck": 0.2,
    "mqb_by_wire": 0.15,
    "new_eagle_raptor": 0.2,
    "pacmod3": 0.2,
    "vbox_kart": 0.15,
}
"""How far each may be from a route, in m."""
MOTION_COMMAND, CONTROL_MODE_SETTING = 0x111, 0x421
AI2VCU_STATUS, AI2VCU_DRIVE_F, AI2VCU_STEER, AI2VCU_BRAKE = 0x510, 0x511, 0x513, 0x514
GLOBAL_CMD, BRAKE_CMD, STEERING_CMD = 0x80, 0x104, 0x12C
TSC1, XBR, GUIDANCE_COMMAND = 0x0C000027, 0x04040B27, 0x0CAD1327
AKIT_REQUESTS = range(0x2F01, 0x2F07)
AKIT_ACCEL, AKIT_STEERING = 0x2F02, 0x2F03


@pytest.fixture(autouse=True)
def _keep_frames_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness takes the reference vehicle's commands apart, and these are none."""
    monkeypatch.setattr(harness, "decode_sent", _keep)


def _keep(frame: CanFrame, at_ns: int, step: int) -> Sent:
    return Sent(at_ns, step, "", 0, {}, frame)


def drive_of(name: str, route: str) -> tuple[Drive, RecedingRoute]:
    """Along a route of the program, in the vehicle's own frame of reference, as fast as `run` would drive."""
    database = load_database(cap_unconfirmed_speed(load_profile(name)))
    source = RecedingRoute(build_route(route, database.profile), frame_id=database.profile.state.frame_id)
    controller = compose.build_controller("pure_pursuit", database.profile)
    return Drive(source, database=database, controller=controller), source


def frames_of(drive: Drive, can_id: int) -> Iterator[bytes]:
    """The payloads that left with an identifier."""
    return (sent.frame.data for sent in drive.sent if sent.frame.can_id == can_id)


@pytest.mark.parametrize(
    ("name", "route"),
    [
        *((name, "u_turn") for name in VEHICLES),
        *((name, "stop_and_go") for name in ("fs_ai_ads_dv", "j1939_truck", "new_eagle_raptor")),
        *((name, "figure8") for name in ("agilex_hunter", "j1939_truck", "pacmod3")),
    ],
)
def test_a_shipped_vehicle_drives_a_route(name: str, route: str) -> None:
    drive, source = drive_of(name, route)
    drive.engage()
    path, seen = source.route, list[Sample]()
    while source.progress_m < path.length_m - 2.0:
        drive.run_s(0.2)
        state = drive.vehicle.state
        seen.append(Sample(drive.clock.t_ns, state.x_m, state.y_m, state.heading_rad, state.speed_mps))
        assert drive.mode() is Mode.ENGAGED, drive.loop.reason
        assert drive.now_s < 120.0
    assert max(lateral_errors_m(seen, path.x_m.tolist(), path.y_m.tolist())) < VEHICLES[name]
    measured, true = drive.state, drive.vehicle.state
    assert math.hypot(measured.x_m - true.x_m, measured.y_m - true.y_m) < max(0.3, VEHICLES[name])


@pytest.mark.parametrize("name", VEHICLES)
def test_a_shipped_vehicle_without_samples_is_stopped(name: str) -> None:
    drive, _ = drive_of(name, "line")
    drive.engage(1.0)
    drive.send_line(f"mute {drive.vehicle.sample[0]} on")
    drive.run_s(0.2)
    assert drive.loop.reason.name == "STATE_STALE"
    drive.run_until(lambda: abs(drive.vehicle.state.speed_mps) < 0.02, 3.0)


@pytest.mark.parametrize(
    ("order", "mode"), [("brake 1", Mode.OVERRIDDEN), ("fault 1", Mode.FAULT), ("emergency_stop", Mode.FAULT)]
)
@pytest.mark.parametrize("name", VEHICLES)
def test_a_shipped_vehicle_is_released_when_a_person_takes_over_or_it_reports_a_fault(
    name: str, order: str, mode: Mode
) -> None:
    drive, _ = drive_of(name, "line")
    drive.engage(1.0)
    drive.send_line(order)
    drive.run_s(0.3)
    assert drive.mode() is mode


@pytest.mark.parametrize("name", ["vbox_kart"])
def test_a_fix_that_its_receiver_doubts_stops_a_shipped_vehicle(name: str) -> None:
    drive, _ = drive_of(name, "line")
    drive.engage(1.0)
    drive.send_line("pose_valid 0")
    drive.run_s(0.1)
    assert drive.loop.reason.name == "STATE_INVALID"
    drive.run_until(lambda: abs(drive.vehicle.state.speed_mps) < 0.02, 3.0)


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


def test_the_ads_dv_is_asked_for_nothing_until_a_person_lets_it_go() -> None:
    drive, _ = drive_of("fs_ai_ads_dv", "figure8")
    shake = drive.vehicle._wire.demands.handshakes["VCU2AI_Status.HANDSHAKE"]
    shake.patience_ns = 0  # as while nobody presses "Go"
    drive.run_until(lambda: drive.mode() is Mode.ENGAGING, 2.0)
    begin = len(drive.sent)
    drive.run_s(1.0)
    assert drive.mode() is Mode.ENGAGING
    waiting = {sent.frame.can_id: sent.frame.data for sent in drive.sent[begin + 5 :]}
    assert waiting[AI2VCU_STATUS][1] >> 6 == 0  # NEUTRAL
    assert {waiting[can_id][:2] for can_id in (AI2VCU_DRIVE_F, AI2VCU_STEER, AI2VCU_BRAKE)} == {b"\0\0"}
    shake.patience_ns = 10**8
    drive.engage(1.0)
    status = list(frames_of(drive, AI2VCU_STATUS))[-1]
    assert (status[1] >> 6, status[1] >> 4 & 3) == (1, 2)  # FORWARD, RUNNING


def test_the_ads_dv_is_never_driven_and_braked_at_once() -> None:
    drive, _ = drive_of("fs_ai_ads_dv", "stop_and_go")
    drive.engage(1.0)
    drive.run_s(15.0)
    torque = [data[:2] != b"\0\0" for data in frames_of(drive, AI2VCU_DRIVE_F)]
    brake = [data != b"\0\0" for data in frames_of(drive, AI2VCU_BRAKE)]
    assert any(torque)
    assert any(brake)
    assert not any(both for both in zip(torque, brake, strict=True) if all(both))


def test_the_ads_dv_stops_itself_when_its_handshake_is_not_echoed(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, _ = drive_of("fs_ai_ads_dv", "line")
    drive.engage(1.0)
    stuck = list(frames_of(drive, AI2VCU_STATUS))[-1]
    receive = drive.vehicle.receive

    def receive_stuck(frame: CanFrame, now_ns: int) -> None:
        data = bytes([stuck[0], *frame.data[1:]]) if frame.can_id == AI2VCU_STATUS else frame.data
        receive(frame._replace(data=data), now_ns)

    monkeypatch.setattr(drive.vehicle, "receive", receive_stuck)
    drive.run_s(0.3)
    assert (drive.vehicle.mode.name, drive.vehicle.counters["commands_lost"]) == ("FAULT", 1)
    assert drive.mode() is Mode.FAULT


def test_pacmod_is_sent_a_count_and_its_complement_and_the_angle_of_the_steering_wheel() -> None:
    drive, _ = drive_of("pacmod3", "figure8")
    drive.engage(1.0)
    drive.run_s(1.0)
    counts = [data[1] for data in frames_of(drive, GLOBAL_CMD)]
    assert counts == [number % 16 | (15 - number % 16) << 4 for number in range(len(counts))]
    assert len(counts) > 50
    data = list(frames_of(drive, STEERING_CMD))[-1]
    assert data[0] == 1  # ENABLE alone
    angle_rad, rate_radps = struct.unpack(">hH", data[1:])
    assert angle_rad / 1000 / 15 == pytest.approx(drive.vehicle.state.front_wheel_angle_rad, abs=0.05)
    assert rate_radps == 6000


def test_an_override_of_pacmod_is_cleared_only_after_it_was_released() -> None:
    drive, _ = drive_of("pacmod3", "line")
    drive.engage(1.0)
    assert {data[0] for data in frames_of(drive, BRAKE_CMD)} == {0, 1}
    begin = len(drive.sent)
    drive.send_line("steer 5")
    drive.run_s(0.3)
    assert drive.mode() is Mode.OVERRIDDEN
    flags = [sent.frame.data[0] for sent in drive.sent[begin:] if sent.frame.can_id == BRAKE_CMD]
    assert set(flags) <= {1, 4}  # never with ENABLE
    assert flags[-1] == 4


def crc_j1850(data: bytes) -> int:
    """SAE J1850, bit by bit."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def test_each_request_to_the_raptor_has_29_bits_a_rolling_counter_and_its_checksum() -> None:
    assert crc_j1850(b"123456789") == 0x4B
    drive, _ = drive_of("new_eagle_raptor", "line")
    drive.engage(1.0)
    for can_id in AKIT_REQUESTS:
        frames = list(frames_of(drive, can_id))
        assert len(frames) > 50
        assert [data[6] & 0xF for data in frames] == [number % 16 for number in range(len(frames))]
        assert all(data[7] == crc_j1850(data[:7]) for data in frames)
    assert all(sent.frame.is_extended for sent in drive.sent)


def test_the_raptor_is_asked_for_pedals_and_an_angle_by_the_multiplexer() -> None:
    drive, _ = drive_of("new_eagle_raptor", "figure8")
    drive.engage(3.0)
    accel, steering = (list(frames_of(drive, can_id))[-1] for can_id in (AKIT_ACCEL, AKIT_STEERING))
    form = [(data[5] & 1) << 2 | data[6] >> 6 for data in (accel, steering)]
    assert form == [0, 1]  # the pedal's position, the angle of the steering wheel
    angle_rad = (int.from_bytes(steering[:2], "little") & 0x3FFF ^ 0x2000) - 0x2000
    assert math.radians(angle_rad / 10) / 16 == pytest.approx(drive.vehicle.state.front_wheel_angle_rad, abs=0.05)


@pytest.mark.parametrize("damage", ["checksum", "counter"])
def test_the_raptor_loses_requests_that_are_damaged_and_faults(monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    drive, _ = drive_of("new_eagle_raptor", "line")
    drive.engage(1.0)
    receive, first = drive.vehicle.receive, list(frames_of(drive, AKIT_STEERING))[-1]

    def receive_damaged(frame: CanFrame, now_ns: int) -> None:
        if frame.can_id == AKIT_STEERING:
            data = first if damage == "counter" else frame.data[:7] + bytes([frame.data[7] ^ 1])
            frame = frame._replace(data=data)
        receive(frame, now_ns)

    monkeypatch.setattr(drive.vehicle, "receive", receive_damaged)
    drive.run_s(0.3)
    assert drive.vehicle.counters["commands_dropped"] >= 10
    assert drive.vehicle.counters["commands_lost"] == 1
    assert drive.mode() is Mode.FAULT


def test_a_report_of_the_raptor_that_is_out_of_sequence_is_dropped() -> None:
    drive, _ = drive_of("new_eagle_raptor", "line")
    drive.engage(1.0)
    drive.send_line("skip_counter DBW_SteeringReport 8")
    drive.run_s(0.2)
    assert {name for _, name in drive.loop._decoder.drops} == {"DBW_SteeringReport"}


@pytest.mark.parametrize(
    ("name", "can_id", "data", "checksum"),
    [
        ("tsc1", 0x0C000011, "0000000000000005", 6),  # 34: 0 + 4 + 34
        ("tsc1", 0x0C000027, "f2ffff7dffffff00", 2),  # 1693: 2 + 211 + 1693
        ("xbr", 0x04040B27, "7f7dcfffffffff09", 10),  # 1546: 96 + 1546
        ("xbr", 0x04040B27, "0000000000000000", 13),  # 58: 3 + 58
    ],
)
def test_the_checksums_of_the_truck_fold_the_sum_of_payload_and_identifier(
    name: str, can_id: int, data: str, checksum: int
) -> None:
    function = load_function(f"j1939_checksums.py:{name}", Path(__file__).parents[2] / "dbc")
    assert function(can_id, bytes.fromhex(data)) == checksum


def test_the_truck_is_asked_by_its_standard_groups_and_their_checksums() -> None:
    drive, _ = drive_of("j1939_truck", "figure8")
    drive.run_until(lambda: drive.mode() is Mode.STANDBY, 2.0)
    assert {data[0] & 0b11 for data in frames_of(drive, TSC1)} == {0}  # the override is disabled, the torque is 0 %
    assert {data[3] for data in frames_of(drive, TSC1)} == {125}
    assert {data[2] >> 4 & 0b11 for data in frames_of(drive, XBR)} == {0}
    begin = len(drive.sent)
    drive.engage(1.0)
    del drive.sent[: begin + 20]
    drive.send_line("mute VDC2 on")
    drive.run_s(0.3)
    assert {data[0] & 0b11 for data in frames_of(drive, TSC1)} == {2}  # torque control
    assert list(frames_of(drive, TSC1))[-1][3] == 125
    demands = [int.from_bytes(data[:2], "little") / 2048 - 15.687 for data in frames_of(drive, XBR)]
    assert -2.01 < demands[-1] < -0.2
    assert max(demands) < 0.001
    assert {data[2] & 0b11 for data in frames_of(drive, GUIDANCE_COMMAND)} == {1}
    for can_id in (TSC1, XBR):
        for data in frames_of(drive, can_id):
            total = sum(data[:7]) + (data[7] & 15) + sum(can_id.to_bytes(4, "big"))
            folded = {TSC1: (total >> 6 & 3) + (total >> 3) + total & 7, XBR: (total >> 4) + total & 15}
            assert data[7] >> 4 == folded[can_id]
    counters = [data[7] & 15 for data in frames_of(drive, TSC1)]
    assert all((after - before) % 8 == 1 for before, after in itertools.pairwise(counters))
