"""Loops in shadow beside an armed one, on the same bus with the simulated vehicle."""

import json
import os
import signal
from typing import Any

from msgspec import UNSET

from vehicle_iface.telemetry import TelemetryReader

from .conftest import Programs
from .driving import own_faults, summary, wait_until_driven
from .observer import Observer

SAMPLES = 300
ARMED = "figure8"


def shadowed(programs: Programs, bus: Observer, route: str) -> dict[str, Any]:
    """What a shadow that would drive a route finds about the armed loop."""
    address, path = f"shadow-{os.getpid()}", programs.folder / f"{route}.json"
    shadow = programs.start("run", "--shadow", "--route", route, "--telemetry", address, "--summary", str(path))
    shadow.wait_for_line("shadow: ")
    bus.wait_samples(SAMPLES)
    with TelemetryReader(address) as reader:
        reader.poll()
        details = reader.details()
        assert details is not None
        assert details.shadow is not UNSET
        assert details.shadow.compared > 0
    shadow.send_signal(signal.SIGTERM)
    assert shadow.wait_for_end() == 0
    assert "difference: accel" in shadow.text
    content = json.loads(path.read_text())
    assert content["counts"]["frames_sent"] == 0
    assert content["latched_fault"] is None
    found: dict[str, Any] = content["shadow"]
    assert found["compared"] > SAMPLES / 2
    assert found["takeovers"] == 1
    assert found["drops"] == {}
    return found


def test_a_shadow_agrees_with_the_armed_loop_on_the_same_route_and_not_on_another_one(
    programs: Programs, bus: Observer
) -> None:
    programs.start("sim", "--driver-socket", str(programs.folder / "pedals.sock"))
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    armed = programs.run("--arm", "--route", ARMED)
    moving = wait_until_driven(bus)
    same, other = (shadowed(programs, bus, route) for route in (ARMED, "circle"))
    assert own_faults(bus.record(moving, bus.now())) == []
    armed.send_signal(signal.SIGTERM)
    assert armed.wait_for_end() == 0
    assert summary(programs)["counts"]["foreign_commands"] == 0
    assert same["accel_mps2"]["p50"] < 0.02
    assert same["front_wheel_angle_rad"]["p95"] < 0.01
    assert same["mismatches"]["safe_stop"] < 0.02 * same["compared"]
    assert other["accel_mps2"]["p50"] > 0.5
    assert other["front_wheel_angle_rad"]["p50"] > 0.05
