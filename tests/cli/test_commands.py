"""The commands as their users meet them: what they refuse, and with which status they end."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest

from vehicle_iface import cli
from vehicle_iface.telemetry import TelemetryReader, telemetry_path

ROOT = Path(__file__).resolve().parents[2]
EMBEDDED = ("run", "--interface", "embedded", "--channel", "embedded", "--telemetry", "test-cli")


def command(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        [sys.executable, "-P", "-m", "vehicle_iface", *arguments],
        **{"env": environment, "text": True, "capture_output": True, "timeout": 60} | options,
    )


def run(tmp_path: Path, *arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return command("run", "--interface", "embedded", "--telemetry", str(tmp_path / "telemetry"), *arguments, **options)


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What the command, called in this process, prints when it refuses its options: status 2, and only an error."""
    try:
        status: object = cli.main(arguments)
    except SystemExit as ended:
        status = ended.code
    shown = capsys.readouterr()
    assert (status, shown.out) == (2, ""), shown.err
    return shown.err


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
def test_interrupted_before_the_loop_exists_it_ends_without_arming(tmp_path: Path, wait: list[str]) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "import os, signal\n"
        "from vehicle_iface import PurePursuit\n"
        "os.kill(os.getpid(), signal.SIGUSR1)\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
    )
    done = run(tmp_path, "--route", "line", "--arm", "--duration", "1", "--controller", f"{file}:PurePursuit", *wait)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (0, "", 1), done.stderr
    assert "interrupted before the loop started" in done.stderr


def test_interrupted_while_its_recorder_starts_it_ends_without_arming(tmp_path: Path) -> None:
    telemetry, folder = tmp_path / "telemetry", tmp_path / "drive"
    options = ("--telemetry", str(telemetry), "--record", str(folder), "--route", "line", "--duration", "2")
    program = subprocess.Popen(
        [sys.executable, "-P", "-m", "vehicle_iface", "run", "--interface", "embedded", "--arm", "--wait", *options],
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
    assert "interrupted before the loop started" in said
    assert "STANDBY" not in said


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("import math\n\ndef broken(:", r"SyntaxError: .*/mine\.py:3\)"),
        ("import math\nimport not_a_module", r"'not_a_module' \(.*/mine\.py:2\)"),
        ("class Mine: pass", "takes no arguments"),
        ("class Mine:\n    def __init__(self, behavior):\n        1 / 0", r"ZeroDivisionError: .*/mine\.py:3\)"),
        ("from vehicle_iface import ControllerBase\nclass Mine(ControllerBase): pass", "compute_command_impl"),
        ("Mine = 3", "no class Mine"),
        ("import sys\nsys.exit(0)", r"SystemExit: 0 \(.*/mine\.py:2\)"),
    ],
)
def test_a_controller_that_cannot_be_made_is_refused_by_file_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str, complaint: str
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(source)
    drive = ("run", "--interface", "embedded", "--telemetry", str(tmp_path / "telemetry"), "--route", "line")
    error = refusal(capsys, *drive, "--controller", f"{file}:Mine", "--duration", "1")
    assert re.search(complaint, error), error
    assert "Traceback" not in error


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
                ("commission", "step-timeout", "seconds"),
            )
            for value in ("", "a", "0", "-1", "nan", "inf", "1e300")
        ),
        *(
            (["run", f"--cpu={value}"], f"--cpu: '{value}': not a CPU for this process: must be one of ")
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
                "run": "channel profile trajectory trajectory-mailbox controller telemetry record summary frame",
                "sim": "channel profile start frame driver-socket",
                "demo": "profile summary record",
                "doctor": "channel profile",
                "commission": "channel profile record out json",
                "decode": "profile dbc out message channel",
            }.items()
            for option in options.split()
        ),
        (["check-dbc", ""], "FILE: '': must not be empty"),
        (["run", "--record=\udcff"], r"--record: '\udcff': must be UTF-8"),
        (["run", "--route=a"], "--route: 'a': must be one of "),
        (["demo", "--route=nan"], "--route: 'nan': must be one of "),
    ],
)
def test_an_impossible_value_is_refused_with_option_value_and_what_is_allowed(
    capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    assert f"argument {complaint}" in capsys.readouterr().err


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
        ("run --trajectory-mailbox .", "--trajectory-mailbox .: is a folder, must be a file in one"),
        ("demo --profile toyota_rav4 --route line", "--profile toyota_rav4: has no [command], so nothing can drive it"),
        ("demo --profile toyota", "profile 'toyota': must be a path ending in .toml or one of: agilex_hunter, "),
        ("run --route line --summary .", "--summary .: cannot be written: Is a directory"),
    ],
)
def test_a_value_that_does_not_fit_the_vehicle_or_the_disk_is_refused(
    capsys: pytest.CaptureFixture[str], arguments: str, complaint: str
) -> None:
    error = refusal(capsys, *arguments.split())
    assert error.startswith(f"vehicle-iface: {complaint}")
    assert error.count("\n") == 1


def test_modules_in_the_current_folder_are_not_imported(tmp_path: Path) -> None:
    (tmp_path / "queue.py").write_text("raise SystemExit('hijacked')")
    (tmp_path / "vehicle_iface_viewer").mkdir()
    (tmp_path / "vehicle_iface_viewer" / "__init__.py").write_text("raise SystemExit('hijacked')")
    done = command("view", "--help", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "hijacked" not in done.stderr


def test_a_missing_interface_is_refused_with_the_command_that_makes_it() -> None:
    done = command("run", "--channel", "vcan7", "--route", "line")
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert "`" in done.stderr


def interrupted_demo(summary: Path, *, after_s: float, times: int) -> tuple[int, str]:
    """Status and output of a demo that is interrupted some time after it has engaged, once or several times."""
    arguments = ["demo", "--no-viewer", "--port", "8907", "--summary", str(summary)]
    demo = subprocess.Popen(
        [sys.executable, "-P", "-m", "vehicle_iface", *arguments],
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
    time.sleep(after_s)
    for _ in range(times):
        demo.send_signal(signal.SIGINT)
        time.sleep(0.2)
    rest, _ = demo.communicate(timeout=30)
    return demo.returncode, "".join(lines) + rest


def test_a_demo_that_is_interrupted_stops_the_vehicle_and_ends_everything(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    status, output = interrupted_demo(summary, after_s=0.0, times=1)
    assert status == 0, output
    words = ["STANDBY", "ENGAGING", "ENGAGED", "ENDING", "HANDOVER", "RELEASED"]
    places = [output.index(f" {word}") for word in words]
    assert places == sorted(places), output  # each is logged when it happens
    assert re.search(r"process \d+; the page: vehicle-iface view --connect demo-8907\n", output)
    assert json.loads(summary.read_text())["controller_state"] == "STANDBY"
    assert not telemetry_path("demo-8907").exists()


def test_a_demo_that_is_interrupted_twice_releases_the_vehicle_while_it_still_moves(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    status, output = interrupted_demo(summary, after_s=4.0, times=2)
    assert status == 0, output
    ended = {change["mode"]: change["at_s"] for change in json.loads(summary.read_text())["transitions"]}
    assert ended["RELEASED"] - ended["ENDING"] < 0.8  # a stop at 3 m/s^2 would take longer than that


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["rnu"], "vehicle-iface: argument COMMAND: 'rnu': must be one of demo, run, "),
        (["run", "--chanel=a", "--route=line"], "vehicle-iface run: unknown argument '--chanel=a'; did you mean '--ch"),
        (["demo", "--rout", "8"], "vehicle-iface demo: argument --route: '8': must be one of "),
        (["demo", "--route=circel"], "; did you mean 'circle'? (vehicle-iface demo --help)"),
    ],
)
def test_a_mistyped_word_is_reported_in_one_line_with_the_nearest_one(
    capsys: pytest.CaptureFixture[str], arguments: list[str], line: str
) -> None:
    error = refusal(capsys, *arguments)
    assert line in error
    assert error.count("\n") == 1


def test_a_mistyped_word_is_reported_by_the_viewers_process_too() -> None:
    done = command("view", "--prt=1")
    assert done.returncode == 2
    assert "vehicle-iface view: unknown argument '--prt=1'; did you mean '--port'? (vehicle-iface v" in done.stderr
    assert done.stderr.count("\n") == 1


def test_help_imports_nothing_that_only_one_command_needs() -> None:
    program = (
        "import contextlib, sys\nfrom vehicle_iface.cli import main\n"
        "with contextlib.suppress(SystemExit):\n    main(['run', '--help'])\n"
        "print(sorted({'can', 'cantools', 'importlib.metadata', 'subprocess'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_version_is_that_of_the_package() -> None:
    assert command("--version").stdout == f"vehicle-iface {version('vehicle-iface')}\n"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_that_is_not_utf8_gets_replacements_and_the_right_status(tmp_path: Path, encoding: str) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": encoding}
    file = tmp_path / "degrees.dbc"
    text = (ROOT / "dbc" / "reference.dbc").read_text(encoding="utf-8")
    file.write_text(text.replace('"rad"', '"°λ"').replace("CM_ ", 'CM_ "°λ";\nCM_ ', 1), encoding="utf-8")
    drive = run(tmp_path, "--route", "line", "--arm", "--duration", "0.5", env=environment)
    assert (drive.returncode, "Traceback" in drive.stderr) == (0, False)
    assert "latency state?command" in drive.stdout
    lint = command("check-dbc", str(file), env=environment, encoding=encoding)
    assert (lint.returncode, lint.stderr) == (0, "")
    assert "unit '°?' is not known" in lint.stdout.replace("??", "°?")


def test_a_demo_drives_the_vehicle_of_a_profile_on_all_of_its_buses(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    arguments = ["--profile", "agilex_hunter_ins", "--route", "line", "--duration", "3", "--summary", str(summary)]
    done = command("demo", "--no-viewer", "--port", "8911", *arguments)
    assert done.returncode == 0, done.stderr
    drive = json.loads(summary.read_text())
    assert "ENGAGED" in [change["mode"] for change in drive["transitions"]]
    assert "LatitudeLongitude" in done.stdout  # comes from the second bus


def test_a_demo_names_the_faults_of_a_profile_once_and_starts_nothing(tmp_path: Path) -> None:
    text = (ROOT / "dbc" / "reference.toml").read_text(encoding="utf-8")
    (tmp_path / "reference.dbc").write_bytes((ROOT / "dbc" / "reference.dbc").read_bytes())
    file = tmp_path / "own.toml"
    file.write_text(text.replace('"MOTION.SPEED"', '"MOTION.SPED"'), encoding="utf-8")
    done = command("demo", "--no-viewer", "--profile", str(file))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("'SPED'") == 1, done.stderr


def test_a_run_publishes_the_names_of_messages_without_protection(tmp_path: Path) -> None:
    done = run(tmp_path, "--profile", "agilex_hunter", "--route", "line", "--duration", "0.5")
    assert done.returncode == 0, done.stderr
    with TelemetryReader(str(tmp_path / "telemetry")) as reader:
        reader.poll()
        assert reader.info is not None
        assert reader.info.unprotected == ("MOTION_STATE", "SYSTEM_STATE", "MOTION_COMMAND")


def test_a_demo_whose_port_is_taken_ends_before_it_starts_anything() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        done = command("demo", "--port", str(port), "--duration", "1")
    assert done.returncode == 2
    assert done.stderr.startswith(f"vehicle-iface: --port {port}: Address already in use. ")
    assert done.stdout == ""
