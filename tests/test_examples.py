"""Every example under docs/examples does what its first lines promise."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "docs" / "examples"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}


def run(*arguments: str, attempts: int = 1) -> str:
    """What a Python program that ends well prints, then what it logs.

    `attempts`: a drive in real time is repeated where the machine stood still for so long that its state was stale.
    """
    command = [sys.executable, "-P", *arguments]
    done = subprocess.run(command, env=ENVIRONMENT, cwd=ROOT, capture_output=True, text=True, timeout=60)
    output = done.stdout + done.stderr
    if attempts > 1 and "STATE_STALE" in output:
        return run(*arguments, attempts=attempts - 1)
    assert done.returncode == 0, output
    return output


@pytest.fixture
def drive(tmp_path: Path) -> "subprocess.Popen[str]":
    """A loop on the embedded bus that drives what is posted, and publishes telemetry; both in `tmp_path`."""
    places = ["--trajectory-mailbox", str(tmp_path / "plan"), "--telemetry", str(tmp_path / "telemetry")]
    arguments = ["run", "--interface", "embedded", "--arm", "--duration", "6", *places]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "vehicle_iface", *arguments],
        env=ENVIRONMENT,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_an_embedded_drive_ends_well_with_its_summary() -> None:
    output = run(str(EXAMPLES / "01_embedded_drive.py"), "2", attempts=3)
    assert "embedded bus" in output
    assert re.search(r"ended +STANDBY, SHUTDOWN", output)


def test_the_users_controller_drives() -> None:
    arguments = ["run", "--interface", "embedded", "--route", "circle", "--arm", "--duration", "2"]
    controller = f"{EXAMPLES / '02_own_controller.py'}:Stanley"
    options = ["--controller", controller, "--telemetry", f"examples-{os.getpid()}"]
    output = run("-m", "vehicle_iface", *arguments, *options, attempts=3)
    assert "controller errors" not in output
    assert "NO_TRAJECTORY" not in output
    assert "reason: NOMINAL" in output
    assert re.search(r"commands +[12]\d\d sent", output)


def test_a_posted_trajectory_is_driven_and_seen_in_the_telemetry(
    drive: "subprocess.Popen[str]", tmp_path: Path
) -> None:
    run(str(EXAMPLES / "03_post_trajectory.py"), str(tmp_path / "plan"))
    seen = run(str(EXAMPLES / "04_read_telemetry.py"), str(tmp_path / "telemetry"), "4")
    output, _ = drive.communicate(timeout=30)
    assert drive.returncode == 0, output
    assert "ENGAGED NOMINAL" in seen
    assert "ENGAGED (NOMINAL)" in output


def test_a_log_becomes_columns(tmp_path: Path) -> None:
    log = tmp_path / "drive.log"
    log.write_text("(1.000000) vcan0 110#0000000000000000\n(1.010000) vcan0 7FF#00\n")
    output = run(str(EXAMPLES / "05_decode_log.py"), str(log))
    assert output.startswith("1 of 2 lines decoded, 0 refused\n")
    assert "POSE.POS_X: 1 values from " in output


def test_a_small_vehicle_of_ones_own_is_checked_and_drives(tmp_path: Path) -> None:
    profile = str(EXAMPLES / "06_own_vehicle" / "rover.toml")
    assert run("-m", "vehicle_iface", "check-dbc", profile) == ""
    arguments = ["run", "--interface", "embedded", "--route", "circle", "--arm", "--duration", "2"]
    output = run("-m", "vehicle_iface", *arguments, "--profile", profile, "--telemetry", str(tmp_path / "telemetry"))
    assert "ENGAGED (NOMINAL)" in output
    assert re.search(r"ended +STANDBY, SHUTDOWN", output)


def test_every_example_is_in_the_list() -> None:
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert [path.name for path in sorted(EXAMPLES.glob("0*")) if f"]({path.name})" not in listed] == []
