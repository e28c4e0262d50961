"""The commands as their users meet them: what they refuse, and with which status they end."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from vehicle_iface import cli

ROOT = Path(__file__).resolve().parents[1]
EMBEDDED = ("run", "--interface", "embedded", "--channel", "embedded", "--telemetry", "test-cli")


def command(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        [sys.executable, "-P", "-m", "vehicle_iface", *arguments],
        **{"env": environment, "text": True, "capture_output": True, "timeout": 60} | options,
    )


def run(tmp_path: Path, *arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return command("run", "--interface", "embedded", "--telemetry", str(tmp_path / "telemetry"), *arguments, **options)


def test_a_drive_on_the_embedded_bus_ends_well_and_leaves_its_summary(tmp_path: Path) -> None:
    file = tmp_path / "summary.json"
    done = run(tmp_path, "--route", "line", "--arm", "--duration", "2", "--summary", str(file))
    assert done.returncode == 0, done.stderr
    summary = json.loads(file.read_text())
    assert summary["commands"] == summary["samples"] > 150
    modes = ["STARTING", "STANDBY", "ENGAGING", "ENGAGED", "ENDING", "RELEASED"]
    assert [step["mode"] for step in summary["transitions"]] == modes
    assert "latency state→command" in done.stdout


def test_a_terminal_that_takes_nothing_costs_neither_summary_nor_status(tmp_path: Path) -> None:
    file = tmp_path / "summary.json"
    with open("/dev/full", "w") as full:
        done = run(
            tmp_path,
            *("--route", "line", "--duration", "1", "--summary", str(file)),
            capture_output=False,
            stdout=full,
            stderr=subprocess.PIPE,
        )
    assert done.returncode == 0, done.stderr
    assert json.loads(file.read_text())["samples"] > 50


@pytest.mark.parametrize("place", ["", "no/s.json"])
def test_a_summary_that_cannot_be_written_is_refused_before_anything_drives(tmp_path: Path, place: str) -> None:
    done = run(tmp_path, "--route", "line", "--arm", "--duration", "1", "--summary", str(tmp_path / place))
    assert done.returncode == 2
    assert "armed" not in done.stderr
    assert f"--summary {tmp_path / place}: cannot be written" in done.stderr


def test_a_summary_that_cannot_be_written_at_the_end_costs_the_status_and_not_the_table(tmp_path: Path) -> None:
    done = run(tmp_path, "--route", "line", "--duration", "1", "--summary", "/dev/full")
    assert done.returncode == 2
    assert "--summary /dev/full: cannot be written: No space left on device" in done.stderr
    assert "samples" in done.stdout


@pytest.mark.parametrize("wait", [[], ["--wait"]])
def test_told_to_end_before_there_is_a_loop_it_ends_without_arming(tmp_path: Path, wait: list[str]) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "import os, signal\n"
        "from vehicle_iface import PurePursuit\n"
        "os.kill(os.getpid(), signal.SIGUSR1)\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
    )
    done = run(tmp_path, "--route", "line", "--arm", "--duration", "1", "--controller", f"{file}:PurePursuit", *wait)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (0, "", 1), done.stderr
    assert "told to end before the loop had begun" in done.stderr


def test_told_to_end_while_its_recorder_begins_it_ends_without_arming(tmp_path: Path) -> None:
    telemetry, folder = tmp_path / "telemetry", tmp_path / "drive"
    told = ("--telemetry", str(telemetry), "--record", str(folder), "--route", "line", "--duration", "2")
    program = subprocess.Popen(
        [sys.executable, "-P", "-m", "vehicle_iface", "run", "--interface", "embedded", "--arm", "--wait", *told],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    )
    while not telemetry.exists():  # the bus is there by now, and the recorder takes a while to begin
        assert program.poll() is None
        time.sleep(0.001)
    program.send_signal(signal.SIGTERM)
    _, said = program.communicate(timeout=30)
    assert program.returncode == 0, said
    assert "told to end before the loop had begun" in said
    assert "STANDBY" not in said


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("def broken(:", "SyntaxError"),
        ("import not_a_module", "not_a_module"),
        ("class Mine: pass", "takes no arguments"),
        ("from vehicle_iface import ControllerBase\nclass Mine(ControllerBase): pass", "compute_command_impl"),
        ("Mine = 3", "no class Mine"),
        ("import sys\nsys.exit(0)", "SystemExit"),
    ],
)
def test_a_controller_that_cannot_be_made_is_refused_by_file_and_line(
    tmp_path: Path, source: str, complaint: str
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(source)
    done = run(tmp_path, "--route", "line", "--controller", f"{file}:Mine", "--duration", "1")
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        *(
            (
                [command, f"--{option}={value}"],
                f"--{option}: '{value}': must be a number of {unit} above 0, at most 1e+09",
            )
            for command, option, unit in (
                ("run", "speed-cap", "m/s"),
                ("run", "duration", "seconds"),
                ("run", "wait", "seconds"),
                ("sim", "duration", "seconds"),
                ("demo", "duration", "seconds"),
            )
            for value in ("", "a", "0", "-1", "nan", "inf", "1e300")
        ),
        *(
            (["run", f"--cpu={value}"], f"--cpu: '{value}': must be one of this program's: ")
            for value in ("", "a", "-1", "nan", "inf", "1.0", "4096")
        ),
        *(
            (["demo", f"--port={value}"], f"--port: '{value}': must be within 0 … 65535")
            for value in ("", "a", "-1", "nan", "inf", "65536", "²")
        ),
        *(
            ([command, f"--interface={value}"], f"--interface: '{value}': must be socketcan, embedded or one of")
            for command in ("run", "sim")
            for value in ("", "a", "-1", "nan", "inf", "0")
        ),
        *(
            ([command, f"--{option}="], f"--{option}: '': must not be empty")
            for command, options in {
                "run": "channel profile trajectory trajectory-post controller telemetry record summary frame",
                "sim": "channel profile start frame pedals",
                "demo": "summary record",
                "doctor": "channel profile",
                "decode": "profile dbc out message",
            }.items()
            for option in options.split()
        ),
        (["check-dbc", ""], "FILE: '': must not be empty"),
        (["run", "--record=\udcff"], r"--record: '\udcff': must be UTF-8"),
        (["run", "--route=a"], "--route: invalid choice: 'a' (choose from"),
        (["demo", "--route=nan"], "--route: invalid choice: 'nan' (choose from"),
    ],
)
def test_an_impossible_value_is_refused_with_option_value_and_what_is_allowed(
    capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    assert f"error: argument {complaint}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("run --route line --frame a", "--frame a: must be one of: odom, map"),
        ("sim --frame a", "--frame a: must be one of: odom, map"),
        ("sim --interface embedded", "--interface embedded: that bus has its vehicle in `run`"),
        ("sim --start a", "--start 'a': must be X,Y,HEADING in metres and radians"),
        ("sim --start 0,0", "--start '0,0': must be X,Y,HEADING in metres and radians"),
        ("sim --start 0,0,nan", "--start 0,0,nan: heading_rad = nan: must be a finite number"),
        ("sim --start inf,0,0", "--start inf,0,0: x_m = inf: must be a finite number"),
        ("run --trajectory-post .", "--trajectory-post .: is a folder, must be a file in one"),
        ("run --route line --summary .", "--summary .: cannot be written: Is a directory"),
    ],
)
def test_a_value_that_does_not_fit_the_vehicle_or_the_disk_is_refused(arguments: str, complaint: str) -> None:
    done = command(*arguments.split())
    assert done.returncode == 2
    assert done.stderr.startswith(f"vehicle-iface: {complaint}")
    assert done.stderr.count("\n") == 1


def test_what_lies_in_the_current_folder_is_not_imported(tmp_path: Path) -> None:
    (tmp_path / "queue.py").write_text("raise SystemExit('hijacked')")
    (tmp_path / "viewer").mkdir()
    (tmp_path / "viewer" / "__init__.py").write_text("raise SystemExit('hijacked')")
    done = command("view", "--help", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "hijacked" not in done.stderr


def test_a_missing_interface_is_refused_with_the_command_that_makes_it() -> None:
    done = command("run", "--channel", "vcan7", "--route", "line")
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert "`" in done.stderr


def test_a_demo_that_is_interrupted_stops_the_vehicle_and_ends_everything(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    demo = subprocess.Popen(
        [
            sys.executable,
            "-P",
            "-m",
            "vehicle_iface",
            "demo",
            "--no-viewer",
            "--port",
            "8907",
            "--summary",
            str(summary),
        ],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert demo.stdout is not None
    lines = []
    for line in demo.stdout:
        lines.append(line)
        if "ENGAGED (NOMINAL)" in line:
            break
    demo.send_signal(signal.SIGINT)
    rest, _ = demo.communicate(timeout=30)
    assert demo.returncode == 0, "".join(lines) + rest
    assert "RELEASED" in rest
    assert json.loads(summary.read_text())["controller_state"] == "STANDBY"
