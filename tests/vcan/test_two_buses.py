"""A rover on vcan0 and its INS on vcan1: vehicle and loop as processes of their own, and what is left when the INS' bus
goes down."""

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from vehicle_iface.sim.driver_socket import send_line

from .conftest import Programs
from .observer import PATIENCE_S
from .test_shipped_vehicles import LATCHED_FAULT, Watched

CHANNELS = ("--channel", "vehicle=vcan0", "--channel", "ins=vcan1")
PROFILE = ("--profile", "agilex_hunter_ins")
COMMANDED, MEASURED = "MOTION_COMMAND.LINEAR_VELOCITY", "MOTION_STATE.LINEAR_VELOCITY"
ROVER, INS = {"111", "421", "211", "221"}, {"601", "606", "607", "609"}
"""Identifiers, as candump writes them."""


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", "link", *arguments], check=True, capture_output=True)


@pytest.fixture
def vcan1(vcan0: None) -> Iterator[None]:  # noqa: ARG001
    """A second interface, up, and gone after the test."""
    _ip("add", "dev", "vcan1", "type", "vcan")
    _ip("set", "vcan1", "up")
    yield
    _ip("del", "vcan1")


@pytest.mark.usefixtures("vcan1")
def test_the_loss_of_one_of_two_buses_silences_the_loop_names_the_bus_and_stops_the_vehicle(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    watched, programs = Watched("agilex_hunter"), Programs(tmp_path)
    request.addfinalizer(watched.close)
    request.addfinalizer(programs.kill_all)
    request.addfinalizer(lambda: print(programs.text))
    socket, summary, recording = str(tmp_path / "driver.sock"), tmp_path / "summary.json", tmp_path / "recording"
    programs.start("sim", *PROFILE, *CHANNELS, "--driver-socket", socket)
    watched.wait_for("the vehicle's first sample", MEASURED, lambda _: True, 0)
    files = ("--telemetry", programs.telemetry, "--summary", str(summary), "--record", str(recording))
    loop = programs.start("run", *PROFILE, *CHANNELS, *files, "--arm", "--route", "line")
    watched.wait_for("the vehicle drives", MEASURED, lambda speed_mps: speed_mps > 0.5, 0)

    _ip("set", "vcan1", "down")
    loop.wait_for_line(r"link DOWN: bus ins: vcan1: ")
    loop.wait_for_line(r"reason: LINK_DOWN")
    silent = len(watched.frames)
    deadline_s = time.monotonic() + PATIENCE_S
    while abs(speed_mps := json.loads(send_line(socket, "status", timeout_s=PATIENCE_S))["speed_mps"]) >= 0.02:
        assert time.monotonic() < deadline_s, speed_mps
        time.sleep(0.05)
    assert list(watched.values(COMMANDED, silent)) == []

    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == LATCHED_FAULT
    found = json.loads(summary.read_text())
    assert found["bus"] == "SocketCAN vehicle=vcan0, ins=vcan1"
    assert found["link"]["transitions"][0]["why"].startswith("bus ins: vcan1: ")
    assert "link lost" in loop.text
    lines = [line.split() for line in (recording / "frames.log").read_text().splitlines()]
    seen = {(channel, frame.partition("#")[0]) for _, channel, frame in lines if len(frame.partition("#")[0]) == 3}
    assert seen == {("vcan0", can_id) for can_id in ROVER} | {("vcan1", can_id) for can_id in INS}
