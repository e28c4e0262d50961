"""Every reason to stop that the controller knows, seen from the bus."""

from itertools import pairwise

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, MAP, MS, ODOM, S

from .conftest import ROOT, Programs
from .driving import driven, is_standing, line_file, own_faults, wait_until_driven
from .observer import Observer, decided
from .peer import Vehicle

POSTER = str(ROOT / "tests" / "vcan" / "poster.py")

SAFE_MPS2, JERK_MPS3, EASE_S = 3.0, 30.0, 0.2
"""Of the reference vehicle's profile."""
JITTER_NS = 20 * MS
"""Between the instant for which a command was computed and its stamp on the wire."""
SLACK_MPS2 = 0.3
"""A sample later the vehicle is slower, and this much was asked for less."""


def stops(bus: Observer, reason: str, since: int, *, hazard_lights: bool) -> int:
    """The vehicle is stopped for this reason, and held at standstill; the index at which it stands."""
    index, _ = bus.wait_for(f"a stop because of {reason}", "DRIVE_COMMAND", REASON=reason, since=since)
    standing, _ = bus.wait_until("the vehicle stands", is_standing, since=index)
    end = bus.wait_samples(30, since=standing)
    bus.wait_for("the hazard lights", "BODY_COMMAND", HAZARD_LIGHTS=hazard_lights, since=standing)
    record = bus.record(index, end)
    assert decided(record) == [reason]
    assert all(pair.is_enabled and pair.is_stop for pair in record.pairs)
    assert all(abs(sample.speed_mps) < 0.01 for sample in bus.record(standing, end).samples)
    assert not own_faults(bus.record(since))
    return end


def test_without_a_trajectory_the_vehicle_is_engaged_and_held(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    programs.run("--arm", "--trajectory-mailbox", str(programs.folder / "nothing-here"))
    index, _ = bus.wait_for("the vehicle engages", "VEHICLE_STATUS", MODE=AUTONOMOUS)
    stops(bus, "NO_TRAJECTORY", index, hazard_lights=True)
    assert vehicle.x_m == 0.0


@pytest.mark.usefixtures("vehicle")
def test_an_empty_trajectory_from_another_process_stops_the_vehicle(programs: Programs, bus: Observer) -> None:
    file = str(programs.folder / "posted")
    programs.start_python(POSTER, file, "line", "300", "100", name="poster")
    _, moving = driven(programs, bus, "--trajectory-mailbox", file)
    programs.start_python(POSTER, file, "empty", name="poster")
    stops(bus, "EMPTY_TRAJECTORY", moving, hazard_lights=True)


@pytest.mark.usefixtures("vehicle")
def test_past_the_spatial_end_the_vehicle_stops_without_an_alarm(programs: Programs, bus: Observer) -> None:
    file = str(programs.folder / "posted")
    programs.start_python(POSTER, file, "line", "6", "60", name="poster")
    _, moving = driven(programs, bus, "--trajectory-mailbox", file)
    end = stops(bus, "PAST_END_SPACE", moving, hazard_lights=False)
    assert bus.record(end - 40, end).samples[-1].x_m > 5.0


@pytest.mark.usefixtures("vehicle")
def test_past_the_temporal_end_the_vehicle_stops_without_an_alarm(programs: Programs, bus: Observer) -> None:
    _, moving = driven(programs, bus, "--trajectory", line_file(programs.folder, last_s=2.0))
    end = stops(bus, "PAST_END_TIME", moving, hazard_lights=False)
    assert bus.record(end - 40, end).samples[-1].x_m < 50.0


def test_a_state_in_another_frame_stops_the_vehicle_until_it_is_in_the_right_one(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    _, moving = driven(programs, bus)
    vehicle.pose_frame = ODOM
    end = stops(bus, "FRAME_MISMATCH", moving, hazard_lights=True)
    vehicle.pose_frame = MAP
    wait_until_driven(bus, since=end)


def test_an_invalid_pose_stops_the_vehicle_until_it_is_valid(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    _, moving = driven(programs, bus)
    vehicle.pose_valid = False
    end = stops(bus, "STATE_INVALID", moving, hazard_lights=True)
    vehicle.pose_valid = True
    wait_until_driven(bus, since=end)


@pytest.mark.usefixtures("vehicle")
def test_trajectories_from_another_process_at_10_hz_do_not_disturb_the_drive(programs: Programs, bus: Observer) -> None:
    file = str(programs.folder / "posted")
    poster = programs.start_python(POSTER, file, "line", "300", "100", "60", name="poster")
    loop, moving = driven(programs, bus, "--trajectory-mailbox", file)
    bus.wait_samples(150, since=moving)
    assert poster.is_running
    end = bus.now()
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert not record.faults()
    assert loop.is_running


def test_on_the_bus_the_brake_ramps_up_by_its_jerk_and_is_released_with_the_speed(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    _, moving = driven(programs, bus)
    bus.wait_until("it is fast", lambda decoded: decoded.name == "MOTION" and decoded["SPEED"] > 2.5, since=moving)
    vehicle.pose_valid = False
    end = stops(bus, "STATE_INVALID", moving, hazard_lights=True)
    record = bus.record(moving, end)
    first = next(k for k, pair in enumerate(record.pairs) if pair.is_stop)
    for before, after in pairwise(record.pairs[first - 1 :]):
        last_mps2 = min(before.drive["ACCEL_REQUEST"], 0.0)  # what drives is dropped at once
        granted_mps2 = JERK_MPS3 * (after.stamp_ns - before.stamp_ns + JITTER_NS) / S
        assert abs(after.drive["ACCEL_REQUEST"] - last_mps2) <= granted_mps2 + 1e-3
    accels = [pair.drive["ACCEL_REQUEST"] for pair in record.pairs[first:]]
    assert min(accels) == pytest.approx(-SAFE_MPS2)
    assert len({accel for accel in accels[: accels.index(min(accels))] if accel > -SAFE_MPS2}) >= 5
    speeds_mps = {sample.stamp_ns: sample.speed_mps for sample in record.samples}
    answers = [(speeds_mps[at_ns], pair) for at_ns, pair in record.answers if pair.is_stop]
    assert len(answers) > 50
    for speed_mps, pair in answers:
        assert abs(pair.drive["ACCEL_REQUEST"]) <= speed_mps / EASE_S + SLACK_MPS2
    assert accels[-1] == 0.0
