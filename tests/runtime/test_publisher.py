"""Every field of a published snapshot shows the value that its name promises, on its way to the page and to a file."""

import csv
import io

import numpy as np
import pytest

from vehicle_iface import Command, ControllerBase, Reason, Trajectory, VehicleState
from vehicle_iface.command import SafeCommand
from vehicle_iface.recorder.files import format_snapshot, parse_snapshot
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import Decision
from vehicle_iface.runtime.publisher import TelemetryPublisher
from vehicle_iface.status import ControllerState, Gear, VehicleMode, VehicleStatus
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryReader, TelemetryWriter
from vehicle_iface.units import wrapped_rad

STATE = VehicleState(
    stamp_ns=900,
    frame_id="odom",
    x_m=10.25,
    y_m=0.5,
    heading_rad=0.125,
    speed_mps=4.5,
    accel_mps2=0.625,
    yaw_rate_radps=0.0625,
    lateral_speed_mps=0.03125,
    front_wheel_angle_rad=0.2,
    rear_wheel_angle_rad=-0.1,
)
STATUS = VehicleStatus(stamp_ns=901, mode=VehicleMode.AUTONOMOUS, gear=Gear.DRIVE)
DECISION = Decision(
    requested=Command(
        stamp_ns=900, accel_mps2=1.5, front_wheel_angle_rad=0.3, rear_wheel_angle_rad=0.05, speed_mps=5.0
    ),
    permitted=SafeCommand(
        stamp_ns=900,
        enable=True,
        safe_stop=False,
        accel_mps2=1.25,
        front_wheel_angle_rad=0.25,
        rear_wheel_angle_rad=0.04,
        speed_mps=4.75,
        reason=Reason.NOMINAL,
        gear_request=Gear.NO_REQUEST,
    ),
)
PATH = Trajectory(
    stamp_ns=0,
    frame_id="odom",
    time_from_start_ns=np.array([0, 200, 1_400, 10_000]),
    x_m=np.array([0.0, 5.0, 10.0, 15.0]),
    y_m=np.array([0.0, 0.375, 0.75, 1.0]),
    heading_rad=np.array([0.0, 0.0, 0.015625, 0.0]),
    speed_mps=np.array([1.0, 2.0, 3.0, 4.0]),
)


class Looking(ControllerBase):
    """Looks ahead to a point."""

    lookahead_point = (17.5, -3.5)

    def compute_command_impl(self, state: VehicleState) -> Command:
        return Command(stamp_ns=state.stamp_ns, accel_mps2=0.0, front_wheel_angle_rad=0.0)


@pytest.fixture
def published(tmp_path: object) -> Snapshot:
    """A snapshot of a loop in which no two numbers are alike, as a reader in another process receives it."""
    controller, counts = Looking(), Counters()
    counts.samples, counts.commands, counts.commands_late, counts.samples_expired = 31, 32, 30, 3
    controller.set_trajectory(PATH)
    controller.compute_command(STATE)
    address = f"{tmp_path}/telemetry"
    with TelemetryWriter(address, SessionInfo(channel="c", bus="b")) as writer, TelemetryReader(address) as reader:
        publisher = TelemetryPublisher(writer, controller, counts)
        publisher.publish_trajectory()
        publisher.publish_snapshot(
            1000,
            controller_state=ControllerState.STOPPING,
            reason=Reason.DEVIATION,
            state=STATE,
            status=STATUS,
            decision=DECISION,
            sent=True,
            latency_ns=41,
            drops=42,
            handover_pending=True,
            handover_in_ns=43,
        )
        reader.poll()
        snapshot = reader.newest()
    assert snapshot is not None
    return snapshot


EXPECTED = Snapshot(
    published_ns=1000,
    controller_state=ControllerState.STOPPING,
    reason=Reason.DEVIATION,
    has_state=True,
    stamp_ns=900,
    x_m=10.25,
    y_m=0.5,
    heading_rad=0.125,
    speed_mps=4.5,
    accel_mps2=0.625,
    yaw_rate_radps=0.0625,
    lateral_speed_mps=0.03125,
    front_wheel_angle_rad=0.2,
    rear_wheel_angle_rad=-0.1,
    has_status=True,
    vehicle_mode=VehicleMode.AUTONOMOUS,
    gear=Gear.DRIVE,
    trajectory_version=1,
    has_reference=True,
    spatial_index=2,
    temporal_index=1,
    spatial_reference_x_m=10.0,
    spatial_reference_y_m=0.75,
    temporal_reference_x_m=5.0,
    temporal_reference_y_m=0.375,
    reference_speed_mps=3.0,
    lateral_error_m=-0.25 * np.cos(0.015625) - 0.25 * np.sin(0.015625),
    heading_error_rad=wrapped_rad(0.125 - 0.015625),
    has_lookahead=True,
    lookahead_x_m=17.5,
    lookahead_y_m=-3.5,
    has_requested=True,
    requested_accel_mps2=1.5,
    requested_front_wheel_angle_rad=0.3,
    sent=True,
    sent_accel_mps2=1.25,
    sent_front_wheel_angle_rad=0.25,
    latency_ns=41,
    samples=31,
    commands=32,
    drops=42,
    deadline_misses=33,
    handover_pending=True,
    handover_in_ns=43,
    frame_id="odom",
    sequence=1,
)


def test_every_field_of_a_snapshot_shows_the_value_that_it_names(published: Snapshot) -> None:
    assert published._asdict() == pytest.approx(EXPECTED._asdict())


def test_no_two_numbers_of_the_expected_snapshot_are_alike() -> None:
    """Otherwise two fields could be exchanged without a difference. Flags and codes share few values."""
    few = {"controller_state", "reason", "vehicle_mode", "gear", "trajectory_version", "sequence"}
    few |= {"spatial_index", "temporal_index"}
    numbers = [value for name, value in EXPECTED._asdict().items() if name not in few and type(value) in (int, float)]
    assert len(set(numbers)) == len(numbers) > 25


@pytest.mark.parametrize("flag", [name for name, value in EXPECTED._asdict().items() if value is True])
def test_each_flag_of_a_snapshot_is_its_own(flag: str) -> None:
    controller = Looking()
    if flag == "has_reference":
        controller.set_trajectory(PATH)
    snapshots: list[Snapshot] = []

    class Page:
        def publish(self, snapshot: Snapshot) -> None:
            snapshots.append(snapshot)

    publisher = TelemetryPublisher(Page(), controller, Counters())  # type: ignore[arg-type]
    publisher.publish_snapshot(
        1000,
        controller_state=ControllerState.STANDBY,
        reason=Reason.NOMINAL,
        state=STATE if flag in ("has_state", "has_reference") else None,
        status=STATUS if flag == "has_status" else None,
        decision=DECISION if flag == "has_requested" else None,
        sent=flag == "sent",
        handover_pending=flag == "handover_pending",
    )
    (snapshot,) = snapshots
    raised = {name for name, value in snapshot._asdict().items() if value is True}
    with_it = {"has_reference": {"has_state", "has_lookahead"}}
    assert raised == ({flag} | with_it.get(flag, set()) if flag != "has_lookahead" else set())


def test_every_field_of_a_snapshot_comes_back_from_a_recording(published: Snapshot) -> None:
    line = format_snapshot(published).decode()
    assert parse_snapshot(Snapshot._fields, line) == published
    (row,) = csv.DictReader(io.StringIO(",".join(Snapshot._fields) + "\n" + line))
    assert (row["yaw_rate_radps"], row["accel_mps2"], row["frame_id"]) == ("0.0625", "0.625", "odom")
