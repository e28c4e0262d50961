"""The minimal controller, the one that shares no code with the program, drives the program's own simulated vehicle."""

import math
import signal
from pathlib import Path

import pytest
from defects import DEFECTS
from vehicle_bus_contract.judge import lateral_errors_m
from vehicle_bus_contract.reference import AUTONOMOUS, MANUAL

from .conftest import ROOT, Program, Programs
from .driving import line_file, own_faults, wait_until_driven
from .observer import Observer, decided, reasons
from .peer import Vehicle

CONTROLLER = str(ROOT / "tests" / "hil_bench" / "minimal_controller.py")
STEP_M = 0.25
LEFT_PER_M, RIGHT_PER_M = 0.08, -0.08
LATERAL_LIMIT_M = 1.0


def minimal(programs: Programs, *arguments: str) -> Program:
    """The minimal controller, armed."""
    return programs.start_python(CONTROLLER, "--channel", programs.channel, "--arm", *arguments, name="minimal")


def way() -> list[tuple[float, float, float, float, float]]:
    """Ahead at 3 m/s: straight on, to the left, to the right; then the last of it back at 1.5 m/s. Rows of a route."""
    bends = [0.0] * 8 + [LEFT_PER_M] * 28 + [RIGHT_PER_M] * 20
    x_m = y_m = heading_rad = 0.0
    places = [(x_m, y_m, heading_rad)]
    for bend in bends:
        x_m += STEP_M * math.cos(heading_rad + bend * STEP_M / 2.0)
        y_m += STEP_M * math.sin(heading_rad + bend * STEP_M / 2.0)
        heading_rad += bend * STEP_M
        places.append((x_m, y_m, heading_rad))
    ahead = [(*place, 3.0) for place in places]
    back = [(*place, -1.5) for place in reversed(places[-21:])]
    return [(0.3 * i, *row) for i, row in enumerate([*ahead, *back])]


def way_file(folder: Path) -> str:
    """`way` as CSV."""
    path = folder / "way.csv"
    rows = (",".join(f"{number:.6f}" for number in row) for row in way())
    path.write_text("# frame_id: map\ntime_s,x_m,y_m,heading_rad,speed_mps\n" + "\n".join(rows) + "\n")
    return str(path)


def test_it_drives_the_simulated_vehicle_forwards_and_backwards_without_findings(
    programs: Programs, bus: Observer
) -> None:
    programs.start("sim")
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    controller = minimal(programs, "--route", way_file(programs.folder))
    begin = wait_until_driven(bus)
    back, _ = bus.wait_until(
        "reversing", lambda decoded: decoded.name == "MOTION" and decoded["SPEED"] <= -1.0, since=begin
    )
    over, _ = bus.wait_for("the end of the route", "DRIVE_COMMAND", REASON="PAST_END_SPACE", since=back)
    end = bus.wait_samples(150, since=over)
    controller.send_signal(signal.SIGTERM)
    assert controller.wait_for_end() == 0
    driven, record = bus.record(begin, over), bus.record()
    assert record.faults() == []
    assert decided(bus.record(begin)) == ["NOMINAL", "PAST_END_SPACE", "SHUTDOWN"]
    assert not record.pairs[-1].is_enabled
    assert abs(bus.record(over, end).samples[-1].speed_mps) < 0.01
    x_m, y_m = zip(*(row[1:3] for row in way()), strict=True)
    assert max(lateral_errors_m(driven.samples, x_m, y_m)) < LATERAL_LIMIT_M
    assert bus.record(over, end).of("BODY_COMMAND")[-1]["HAZARD_LIGHTS"] == 0


def test_after_a_driver_override_only_the_operator_arms_again(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    controller = minimal(programs, "--route", line_file(programs.folder))
    moving = wait_until_driven(bus)
    vehicle.driver_brake = True
    taken, status = bus.wait_for("the driver", "VEHICLE_STATUS", MODE=MANUAL, since=moving)
    vehicle.make_ready()
    end = bus.wait_samples(80, since=taken)
    record = bus.record(moving, end)
    after = [pair for stamp_ns, pair in record.answers if stamp_ns > status.stamp_ns]
    assert reasons(after) == ["DRIVER_OVERRIDE"]
    assert not any(pair.is_enabled for pair in after)
    assert not own_faults(record)
    controller.send_signal(signal.SIGUSR1)
    bus.wait_for("the vehicle engages", "VEHICLE_STATUS", MODE=AUTONOMOUS, since=end)


@pytest.mark.usefixtures("vehicle")
def test_every_defect_can_be_selected_by_name(programs: Programs, bus: Observer) -> None:
    route = line_file(programs.folder)
    started = [
        programs.start_python(CONTROLLER, "--channel", programs.channel, "--route", route, "--defect", name, name=name)
        for name in DEFECTS
    ]
    for program in started:
        program.wait_for_line(f"minimal controller on {programs.channel} {program.name}")
        program.send_signal(signal.SIGTERM)
    assert [program.wait_for_end() for program in started] == [0] * len(DEFECTS)
    assert bus.sent_by_controller() == []
