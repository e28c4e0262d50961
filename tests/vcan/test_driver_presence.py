"""Driver override, and a second commander on the bus."""

import json
import signal
from collections.abc import Callable

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MANUAL, MS, READY, Frame, pack
from vehicle_bus_contract.socketcan import open_socket, send

from .conftest import Programs
from .driving import driven, is_moving, line_file, own_faults, summary, wait_until_driven
from .observer import CHANNEL, Observer, decided, reasons
from .peer import Vehicle

NOTICED_WITHIN_NS = 200 * MS
SLACK_NS = 60 * MS
LATCHED_FAULT = 4
DRIVERS: dict[str, Callable[[Vehicle], None]] = {
    "brakes": lambda vehicle: setattr(vehicle, "driver_brake", True),
    "accelerates": lambda vehicle: setattr(vehicle, "driver_throttle", True),
    "steers": lambda vehicle: setattr(vehicle, "driver_torque_nm", -3.0),
}


@pytest.mark.parametrize("mode", [[], ["--shadow"]], ids=["by default", "--shadow"])
def test_without_arm_no_frame_is_sent(programs: Programs, bus: Observer, vehicle: Vehicle, mode: list[str]) -> None:
    loop = programs.run("--route", "figure8", *mode)
    loop.wait_for_line("shadow")
    bus.wait_samples(150)
    loop.send_signal(signal.SIGUSR1)
    bus.wait_samples(100)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(programs)
    assert found["samples"] >= 200
    assert found["counts"]["frames_sent"] == 0
    assert bus.sent_by_controller() == []
    assert vehicle.mode == READY


@pytest.mark.parametrize("act", DRIVERS.values(), ids=DRIVERS)
def test_a_driver_override_acts_with_the_next_sample_and_is_latched(
    programs: Programs, bus: Observer, vehicle: Vehicle, act: Callable[[Vehicle], None]
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    act(vehicle)
    taken, status = bus.wait_for("the driver", "VEHICLE_STATUS", MODE=MANUAL, since=moving)
    vehicle.make_ready()
    end = bus.wait_samples(80, since=taken)
    record = bus.record(moving, end)
    before = [pair for stamp_ns, pair in record.answers if stamp_ns <= status.stamp_ns]
    after = [pair for stamp_ns, pair in record.answers if stamp_ns > status.stamp_ns]
    assert reasons(before) == ["NOMINAL"]
    assert reasons(after) == ["DRIVER_OVERRIDE"]
    assert not any(pair.is_enabled for pair in after)
    assert not record.faults()
    loop.send_signal(signal.SIGUSR1)
    wait_until_driven(bus, since=end)


def test_a_vehicle_fault_releases_the_vehicle_and_exits_with_status_4(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.fault_code = 7
    index, status = bus.wait_for("the vehicle's fault", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    vehicle.make_ready()
    end = bus.wait_samples(80, since=index)
    after = [pair for stamp_ns, pair in bus.record(moving, end).answers if stamp_ns > status.stamp_ns]
    assert reasons(after) == ["VEHICLE_FAULT"]
    assert not any(pair.is_enabled for pair in after)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4


def test_a_second_commander_silences_the_controller_until_it_is_armed_again(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    strange = Frame(0, *pack("STEER_COMMAND", 3, ENABLE=1, FRONT_WHEEL_ANGLE_REQUEST=0.1234))  # as ours never is here
    bus.is_foreign = lambda frame: (frame.can_id, frame.data) == (strange.can_id, strange.data)
    with open_socket(CHANNEL) as raw:
        assert send(raw, strange)
        intruder = bus.now()
        fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    ours = [frame for frame in bus.sent_by_controller(intruder, fault) if frame.can_id in (0x080, 0x081)]
    assert len(ours) <= 4
    bus.wait_samples(30)
    vehicle.make_ready()
    quiet = bus.wait_samples(80, since=fault)
    assert bus.sent_by_controller(fault, quiet) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=quiet)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()


@pytest.mark.usefixtures("vehicle")
def test_of_two_armed_loops_the_second_never_sends_and_the_first_drives_on(programs: Programs, bus: Observer) -> None:
    _, moving = driven(programs, bus)
    telemetry = str(programs.folder / "second")
    summary_file = programs.folder / "second.json"
    outputs = ("--telemetry", telemetry, "--summary", str(summary_file))
    second = programs.start("run", "--arm", "--trajectory", line_file(programs.folder), *outputs)
    second.wait_for_line("SILENT .DUPLICATE_COMMANDER")
    second.send_signal(signal.SIGUSR1)  # in vain: it is still driven
    second.wait_for_line("OBSERVING")
    bus.wait_samples(50)
    assert sum("SILENT (DUPLICATE_COMMANDER)" in line for line in second.lines) == 2
    second.send_signal(signal.SIGTERM)
    assert second.wait_for_end() == 4
    assert json.loads(summary_file.read_text())["counts"]["frames_sent"] == 0
    record = bus.record(moving, bus.now())
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)  # two would show in the counters


def test_the_simulated_vehicles_driver_brakes_makes_it_ready_and_is_driven_again(
    programs: Programs, bus: Observer
) -> None:
    pedals = str(programs.folder / "pedals.sock")
    programs.start("sim", "--driver-socket", pedals)
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    loop, moving = driven(programs, bus)
    assert programs.start("driver", pedals, "brake", "1").wait_for_end() == 0
    taken, _ = bus.wait_for("the driver", "VEHICLE_STATUS", MODE=MANUAL, since=moving)
    bus.wait_for("letting go", "DRIVE_COMMAND", ENABLE=0, REASON="DRIVER_OVERRIDE", since=taken)
    assert programs.start("driver", pedals, "brake", "0").wait_for_end() == 0
    assert programs.start("driver", pedals, "ready").wait_for_end() == 0
    ready, _ = bus.wait_for("the driver hands back", "VEHICLE_STATUS", MODE=READY, since=taken)
    latched = bus.wait_samples(60, since=ready)
    assert decided(bus.record(ready, latched)) == ["DRIVER_OVERRIDE"]
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=latched)
    assert not own_faults(bus.record(moving, bus.wait_samples(30, since=driving)))


def test_a_vehicle_in_another_frame_is_driven_in_that_frame_and_stopped_outside_it(
    programs: Programs, bus: Observer
) -> None:
    pedals = str(programs.folder / "pedals.sock")
    programs.start("sim", "--driver-socket", pedals, "--frame", "odom")
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    _, moving = driven(programs, bus, "--route", "line", "--frame", "odom")
    assert programs.start("driver", pedals, "frame", "MAP").wait_for_end() == 0
    bus.wait_for("the other frame", "POSE", POSE_FRAME=1, since=moving)
    stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", ENABLE=1, SAFE_STOP=1, REASON="FRAME_MISMATCH", since=moving)
    assert programs.start("driver", pedals, "frame", "ODOM").wait_for_end() == 0
    index, _ = bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", since=stop)
    index, _ = bus.wait_until("the vehicle moves", is_moving, since=index)
    assert bus.record(moving, index).of("VEHICLE_STATUS")[-1]["MODE"] == AUTONOMOUS


def test_a_vehicle_that_disengages_is_released_within_200_ms_and_stays_released(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.engages = False
    vehicle.mode = READY
    index, left = bus.wait_for("the vehicle drops out", "VEHICLE_STATUS", MODE=READY, since=moving)
    vehicle.engages = True
    end = bus.wait_samples(80, since=index)
    answers = bus.record(moving, end).answers
    after = [pair for stamp_ns, pair in answers if stamp_ns > left.stamp_ns]
    assert reasons(after) == ["VEHICLE_NOT_AUTONOMOUS"]
    assert not any(pair.is_enabled for pair in after)
    assert after[0].stamp_ns - left.stamp_ns <= NOTICED_WITHIN_NS + SLACK_NS
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == LATCHED_FAULT
