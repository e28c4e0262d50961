"""The program and the bench's vehicle of each profile understand one another; what is wrong on the wire is found."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hil_bench import routes
from hil_bench.judges import dynamics
from hil_bench.peer.wire import PeerWire
from vehicle_bus_contract.judge import lateral_errors_m
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MANUAL, READY, Frame
from virtual_drive import Change, VirtualDrive

ROVER = str(Path(__file__).resolve().parents[2] / "docs" / "examples" / "06_own_vehicle" / "rover.toml")
ALL = (
    "agilex_hunter",
    "agilex_hunter_ins",
    "fs_ai_ads_dv",
    "j1939_truck",
    "mqb_by_wire",
    "new_eagle_raptor",
    "pacmod3",
    "vbox_kart",
    ROVER,
)
"""Every shipped vehicle of another maker that can be driven, and the example's."""
PEERS = ("agilex_hunter", "fs_ai_ads_dv", ROVER)
"""Commanded by a speed, by pedals, and by an acceleration with a signal that says stop."""


def bend() -> routes.Route:
    """Straight on, then a quarter of a circle."""
    return routes.route("bend", [(5.0, 0.0), (math.pi * 3.5, 1.0 / 7.0)], 3.0)


def cruising(profile: str, folder: Path, change: Change = lambda frame: [frame]) -> VirtualDrive:
    """Driven straight on, fast enough for every fault."""
    drive = VirtualDrive(profile, routes.straight(60.0), folder, change)
    drive.run_until(lambda: drive.vehicle.plant.speed_mps > 0.5, 12.0)
    return drive


@pytest.mark.parametrize("profile", ["reference", *ALL])
def test_the_program_drives_the_benchs_vehicle_without_findings(profile: str, tmp_path: Path) -> None:
    drive = VirtualDrive(profile, bend(), tmp_path)
    drive.run_until(lambda: drive.vehicle.has_arrived, 60.0)
    record, moving = drive.record(), [i for i in drive.vehicle.history if i.mode == AUTONOMOUS]
    assert len(record.pairs) > 200
    assert not record.faults()
    assert not list(dynamics.find_faults(drive.wire, record))
    route = bend()
    share = drive.wire.length_share
    x_m, y_m = [x * share for x in route.x_m], [y * share for y in route.y_m]
    assert max(lateral_errors_m(moving, x_m, y_m)) < 0.6 * max(0.5, share)  # type: ignore[arg-type]


@pytest.mark.parametrize("profile", PEERS)
def test_silence_trips_the_watchdog_and_a_release_ends_the_drive(profile: str, tmp_path: Path) -> None:
    drive = cruising(profile, tmp_path)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 12.0)
    assert drive.vehicle.mode == READY
    assert drive.vehicle.is_standing
    vehicle = cruising(profile, tmp_path).vehicle
    now_ns = vehicle.history[-1].at_ns
    for _ in range(round(vehicle.wire.watchdog_s * 1e9 / vehicle.period_ns) + 2):
        now_ns += vehicle.period_ns
        vehicle.move(vehicle.period_ns / 1e9, now_ns)
    assert vehicle.mode == FAULT


def test_a_vehicle_that_lacks_a_message_beside_the_commands_does_not_engage(tmp_path: Path) -> None:
    drive = VirtualDrive("agilex_hunter", routes.straight(60.0), tmp_path, lambda f: [f] * (f.can_id != 0x421))
    drive.run_s(5.0)
    assert drive.vehicle.mode == READY


def test_the_driver_takes_over_the_vehicle(tmp_path: Path) -> None:
    drive = cruising("pacmod3", tmp_path)
    drive.vehicle.driver_brake = True
    drive.run_s(0.3)
    assert drive.vehicle.mode == MANUAL
    assert not drive.record().pairs[-1].is_enabled


@pytest.mark.parametrize("profile", PEERS)
def test_a_stop_is_inferred_only_where_no_signal_reports_it(profile: str, tmp_path: Path) -> None:
    drive = VirtualDrive(profile, routes.straight(120.0), tmp_path)
    drive.run_until(lambda: drive.vehicle.plant.speed_mps > 0.6 * 5.0 * drive.wire.speed_share, 15.0)
    begin_ns = drive.bus.now_ns
    drive.vehicle.next_frames = list  # type: ignore[method-assign]  # nothing is sent
    drive.run_s(0.6)
    pairs = drive.record().pairs
    limit_ns = begin_ns + round((drive.wire.profile["timing"]["state_stale_s"] + 0.25) * 1e9)
    driving = [pair for pair in pairs if begin_ns - 1e9 < pair.stamp_ns < begin_ns]
    assert driving
    assert not any(pair.is_stop for pair in driving)
    assert all(pair.is_stop for pair in pairs if pair.stamp_ns > limit_ns)
    assert pairs[-1].stamp_ns > limit_ns


def changed(profile: str, message: str, **by: Callable[[float], float]) -> Change:
    """Another value in each frame of a message of the device, with a good checksum."""
    wire = PeerWire(profile)

    def change(frame: Frame) -> list[Frame]:
        decoded = wire.intact(frame)
        if decoded is None or decoded.name != message:
            return [frame]
        values = {name: value for name, value in decoded.signals.items() if name != "COUNTER"}
        values |= {f"{message}.{name}": to(values[f"{message}.{name}"]) for name, to in by.items()}
        return [wire.pack(message, decoded.counter if "COUNTER" in decoded.signals else 0, **values)]

    return change


def without_each_third(profile: str, message: str) -> Change:
    """Each third frame of a message is lost."""
    wire, count = PeerWire(profile), 0

    def change(frame: Frame) -> list[Frame]:
        nonlocal count
        count += wire.name_of(frame) == message
        return [] if wire.name_of(frame) == message and count % 3 == 0 else [frame]

    return change


def sometimes(value: float, every: int = 50) -> Callable[[float], float]:
    count = 0

    def to(before: float) -> float:
        nonlocal count
        count += 1
        return value if count % every == 0 else before

    return to


HUNTER, ADS_DV, PACMOD, RAPTOR = "agilex_hunter", "fs_ai_ads_dv", "pacmod3", "new_eagle_raptor"
DEFECTS: dict[str, tuple[str, str, str, Callable[[float], float], str]] = {
    "a speed above the limit": (HUNTER, "MOTION_COMMAND", "LINEAR_VELOCITY", sometimes(2.0), "m/s asked for"),
    "wheels beyond their limit": (HUNTER, "MOTION_COMMAND", "STEERING_ANGLE", sometimes(0.6), "front wheels to 0.6"),
    "wheels that jump": (PACMOD, "STEERING_CMD", "POSITION", sometimes(0.1), "wheels faster than 0.4"),
    "both pedals": (PACMOD, "BRAKE_CMD", "BRAKE_CMD", lambda _: 0.2, "throttle and brake at once"),
    "too much throttle": (PACMOD, "ACCEL_CMD", "ACCEL_CMD", lambda value: 2.5 * value, "m/s²"),
    "one of four not enabled": (PACMOD, "SHIFT_CMD", "ENABLE", lambda _: 0.0, "contradict each other"),
    "a count that stands": (PACMOD, "GLOBAL_CMD", "COUNTER", lambda _: 3.0, "counter: GLOBAL_CMD"),
    "a wrong complement": (PACMOD, "GLOBAL_CMD", "COMPLEMENT", lambda _: 3.0, "GLOBAL_CMD.COMPLEMENT"),
    "a wrong constant": (ADS_DV, "AI2VCU_Drive_F", "FRONT_MOTOR_SPEED_MAX", lambda _: 751.0, "SPEED_MAX is 751"),
    "another branch": (RAPTOR, "AKit_SteeringRequest", "AKit_SteeringReqType", lambda _: 2.0, "ReqType is 2"),
    "no echo": (ADS_DV, "AI2VCU_Status", "HANDSHAKE", lambda _: 0.0, "HANDSHAKE is 0"),
}
"""Profile, message, signal, its other value, and what is found."""


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_wrong_value_of_the_device_is_found(defect: str, tmp_path: Path) -> None:
    profile, message, signal, to, must = DEFECTS[defect]
    found = find_faults(profile, tmp_path, changed(profile, message, **{signal: to}))
    assert any(must in text for text in found), found[:5]


@pytest.mark.parametrize(
    ("profile", "message", "must"),
    [
        (ADS_DV, "AI2VCU_Steer", "alone"),
        (HUNTER, "MOTION_COMMAND", "unanswered"),
        (ROVER, "DRIVE", "counter: DRIVE"),
        (RAPTOR, "AKit_BrakeRequest", "counter: AKit_BrakeRequest"),
    ],
)
def test_a_lost_command_is_found(profile: str, message: str, must: str, tmp_path: Path) -> None:
    found = find_faults(profile, tmp_path, without_each_third(profile, message))
    assert any(must in text for text in found), found[:5]


def test_a_damaged_command_is_found_and_not_obeyed(tmp_path: Path) -> None:
    drive = VirtualDrive(ROVER, routes.straight(60.0), tmp_path, lambda f: [replace(f, data=b"\0" + f.data[1:])])
    drive.run_s(3.0)
    assert any("CRC: DRIVE" in text for text in drive.record().faults())
    assert drive.vehicle.mode == READY


def find_faults(profile: str, folder: Path, change: Change) -> list[str]:
    """Of five seconds of driving."""
    drive = VirtualDrive(profile, routes.straight(120.0), folder, change)
    drive.run_s(5.0)
    record = drive.record()
    return [*record.faults(), *dynamics.find_faults(drive.wire, record)]
