"""A walk listens on a real bus: kernel stamps, filters and log are right, and not one frame is added."""

import json
import signal

from .conftest import Programs
from .observer import Observer

VEHICLE_IDS = {0x100, 0x110, 0x111, 0x112}


def test_commissioning_reads_the_vehicle_and_sends_nothing(programs: Programs, bus: Observer) -> None:
    programs.start("sim", "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    report, record = programs.folder / "report.json", programs.folder / "walk.log"
    walk = programs.start("commission", "--json", str(report), "--record", str(record), "--step-timeout", "30")
    walk.wait_for_line("seen: VEHICLE_STATUS.DRIVER_BRAKE is clear while nobody touches it")
    walk.wait_for_line("Turn the wheel left")
    walk.send_signal(signal.SIGINT)
    assert walk.wait_for_end() == 5
    found = json.loads(report.read_text())
    assert [step["verdict"] for step in found["steps"]][:2] == ["seen", "not seen"]
    frames = {one["name"]: one["count"] for one in found["review"]["messages"]}
    assert min(frames[name] for name in ("POSE", "MOTION", "CHASSIS")) > 40
    assert found["review"]["contradictions"] == 0
    assert record.stat().st_size > 0
    assert {frame.can_id for frame in bus.frames} == VEHICLE_IDS
