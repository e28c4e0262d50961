"""A vehicle on two buses is driven as one: on an embedded bus, in simulated time."""

from pathlib import Path

import pytest

from tests import harness
from tests.buses.two_buses import load_vehicle
from tests.harness import Drive, Sent
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode

COMMAND = 128


@pytest.fixture
def drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drive:
    """Engaged, and at 1 m/s."""
    monkeypatch.setattr(harness, "decode_sent", lambda frame, at_ns, step: Sent(at_ns, step, "", 0, {}, frame))
    return Drive(database=load_vehicle(tmp_path)).engage(1.0)


def test_a_sample_of_parts_from_both_buses_is_answered_on_the_bus_of_the_command(drive: Drive) -> None:
    assert {(sent.frame.can_id, sent.frame.bus) for sent in drive.sent} == {(COMMAND, 0)}
    assert drive.loop.summary().part_ages_s == {"INS_POS": 0.0, "INS_ATT": 0.0, "WHEELS": 0.0}


@pytest.mark.parametrize("message", ["INS_POS", "INS_ATT", "ins:STATUS"])
def test_an_ins_that_falls_silent_stops_the_vehicle_by_the_age_of_its_parts(drive: Drive, message: str) -> None:
    drive.send_line(f"mute {message} on")
    drive.run_s(0.3)
    assert drive.loop.reason.name == "STATE_STALE"
    assert drive.loop.link.state.name == "UP"
    drive.run_until(lambda: abs(drive.vehicle.state.speed_mps) < 0.02, 5.0)


@pytest.mark.parametrize(("bus", "mode"), [(0, Mode.SILENT), (1, Mode.ENGAGED)])
def test_another_commander_is_one_on_the_bus_of_the_command(drive: Drive, bus: int, mode: Mode) -> None:
    drive.line.inject(CanFrame(COMMAND, bytes(8), bus=bus))
    drive.run_s(0.1)
    assert drive.mode() is mode
    assert drive.loop.details().loop["foreign_commands"] == (bus == 0)
