"""A profile without commands: the vehicle is watched, and cannot be armed."""

from pathlib import Path

import pytest

from tests.harness import Drive
from vehicle_iface.cli import main
from vehicle_iface.safety.modes import Mode

from .profiles import load_vehicle, write_vehicle

COMMAND = """[command.signals]
enable = "CMD.EN"
accel_mps2 = "CMD.ACC"
front_wheel_angle_rad = "CMD.STEER"
speed_mps = "CMD.SPD"
"""


def test_a_vehicle_without_commands_is_watched_and_nothing_is_sent(tmp_path: Path) -> None:
    drive = Drive(database=load_vehicle(tmp_path, toml=((COMMAND, ""),)), armed=False)
    drive.run_s(2.0)
    assert drive.mode() is Mode.SHADOW
    assert drive.loop.details().loop["samples"] >= 95
    assert drive.sent == []


def test_it_cannot_be_armed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = write_vehicle(tmp_path, toml=((COMMAND, ""),))
    assert main(["run", "--interface", "embedded", "--route", "line", "--profile", str(profile), "--arm"]) == 2
    assert "has no [command], so it can only be watched; leave out --arm" in capsys.readouterr().err
