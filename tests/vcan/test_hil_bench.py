"""The bench judges: a sound independent controller passes, and each of its defects fails the case for it.

A run tries the defects that need real time and processes; `--all-defects` tries all.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import defects
import msgspec
import pytest
from hil_bench import result
from hil_bench.bus import Bus
from hil_bench.judges.excuses import HOST_TOO_SLOW, LATE_ANSWERS
from hil_bench.result import Evidence, Run, Verdict
from vehicle_bus_contract.reference import Frame
from vehicle_bus_contract.socketcan import open_socket, receive_frames, send

from .observer import CHANNEL

ROOT = Path(__file__).resolve().parents[2]
MINIMAL = f"{sys.executable} {ROOT}/tests/hil_bench/minimal_controller.py --channel {{channel}} --route {{trajectory}}"
ARMED = f"{MINIMAL} --arm --show {{port}}"
RECORDING = f"{MINIMAL} --arm --record {{record}}"
VIEWER = f"{sys.executable} {ROOT}/tests/hil_bench/minimal_view.py {{port}}"
LONGEST_S = 480.0

DEFECTS = {
    "timeout_removed": ("state-lost", "a stop with STATE_STALE"),
    "crc_unchecked": ("crc-always-wrong", "a stop with STATE_STALE"),
    "steer_sign_swapped": ("drive-from-the-side", "reaches the end"),
    "nan_path": ("drive-from-the-side", "reaches the end"),
    "limit_off_by_10_percent": ("drive-from-the-side", "every value is within the limits"),
    "jerk_unlimited": ("end-of-space", "steering, lateral acceleration, braking and jerk"),
    "stop_swerves": ("pose-invalid-in-a-bend", "steering, lateral acceleration, braking and jerk"),
    "counter_repeated_with_fresh_crc": ("end-of-space", "its counters advance by one"),
    "stop_without_brake": ("crc-always-wrong", "a stop brakes"),
    "stop_without_reason": ("state-lost", "a stop with STATE_STALE"),
    "late_by_30_ms": ("latency-at-0-percent-load", "a dropped sample"),
    "commands_after_override": ("driver-brakes", "ENABLE = 0 with DRIVER_OVERRIDE"),
    "recorder_blocks": ("recorder-stopped", "drives on: no stop"),
    "recorder_required": ("recorder-disk-full", "drives on: no stop"),
    "view_blocks": ("viewer-stopped", "drives on: no stop"),
    "view_required": ("viewer-killed", "drives on: no stop"),
    "frame_ignored": ("other-frame-of-reference", "a stop with FRAME_MISMATCH"),
}
"""Defect → the case that is there for it, and what of it fails."""

IN_EVERY_RUN = ("late_by_30_ms", "view_blocks")
"""What takes real time and processes. Virtual time has one defect for each other judge: test_virtual_devices.py."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """`defect` is each of the run's, `tried` all of them."""
    tried = tuple(DEFECTS) if metafunc.config.getoption("--all-defects", default=False) else IN_EVERY_RUN
    if "defect" in metafunc.fixturenames:
        metafunc.parametrize("defect", tried)
    if "tried" in metafunc.fixturenames:
        metafunc.parametrize("tried", [tried], ids=["these"])


def bench(
    tmp_path: Path,
    cases: Sequence[str],
    *,
    device: str = "",
    recording: str = "",
    viewer: str = "",
    profile: str = "reference",
) -> tuple[int, Run, str]:
    command = [sys.executable, "tools/hil_bench.py", "--channel", CHANNEL, "--out", str(tmp_path / "report")]
    command += ["--profile", profile]
    command += [word for case in cases for word in ("--case", case)]
    command += ["--device", device] if device else []
    command += ["--recording-device", recording] if recording else []
    command += ["--viewer", viewer] if viewer else []
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False, cwd=ROOT)
    report = tmp_path / "report" / "results.json"
    assert report.exists(), done.stdout + done.stderr
    return done.returncode, result.read(report), done.stdout + done.stderr


def test_every_defect_has_a_case() -> None:
    assert DEFECTS.keys() == defects.DEFECTS.keys()


ATTEMPTS = 3


def late_cases(run: Run, output: str) -> list[str]:
    """The cases that failed as a slow host makes a sound device fail; there must be no other failure."""
    failed = [case for case in run.cases if case.verdict is not Verdict.PASS]
    assert all(case.why.startswith((*LATE_ANSWERS, HOST_TOO_SLOW)) for case in failed), output
    return [case.name for case in failed]


@pytest.mark.timeout(LONGEST_S)
def test_an_independent_sound_controller_passes_every_case_that_detects_a_defect(
    tmp_path: Path,
    tried: tuple[str, ...],
) -> None:
    cases = list(dict.fromkeys(DEFECTS[defect][0] for defect in tried))
    status, run, output = bench(tmp_path, cases, device=ARMED, recording=RECORDING, viewer=VIEWER)
    assert run.evidence is Evidence.VIRTUAL_BUS
    left = late_cases(run, output)
    for attempt in range(1, ATTEMPTS):
        if left:
            folder = tmp_path / str(attempt)
            folder.mkdir()
            status, run, output = bench(folder, left, device=ARMED, recording=RECORDING, viewer=VIEWER)
            left = late_cases(run, output)
    assert (left, status) == ([], 0), output


@pytest.mark.timeout(LONGEST_S)
def test_each_defect_fails_its_case(tmp_path: Path, defect: str) -> None:
    case, must = DEFECTS[defect]
    broken = f" --defect {defect}"
    status, run, output = bench(tmp_path, [case], device=ARMED + broken, recording=RECORDING + broken, viewer=VIEWER)
    failed = [check.text for check in run.cases[0].checks if check.verdict is Verdict.FAIL]
    assert run.cases[0].verdict is Verdict.FAIL, output
    assert any(text.startswith(must) for text in failed), failed
    assert status == 1


@pytest.mark.timeout(LONGEST_S)
def test_the_program_passes_and_the_report_has_its_frames(tmp_path: Path) -> None:
    cases = ["state-lost", "link-blip", "recorder-disk-full", "viewer-stopped", "not-armed", "trajectory-with-nan"]
    _, run, output = bench(tmp_path, cases)
    left = late_cases(run, output)
    for attempt in range(1, ATTEMPTS):
        if left:
            again = tmp_path / str(attempt)
            again.mkdir()
            _, repeated, output = bench(again, left)
            left = late_cases(repeated, output)
    assert left == [], output
    folder = tmp_path / "report"
    assert "<title>" in (folder / "index.html").read_text()
    assert (folder / "junit.xml").read_text().count("<testcase") == len(cases)
    frames = (folder / next(case for case in run.cases if case.name == "state-lost").candump).read_text()
    assert f"{CHANNEL} 080#" in frames
    assert f"{CHANNEL} 110#" in frames


@pytest.mark.timeout(LONGEST_S)
def test_the_program_passes_with_another_vendors_vehicle_and_inapplicable_cases_are_listed(tmp_path: Path) -> None:
    cases, left, output = ["state-lost", "gear-contradicts"], ["state-lost"], ""
    for attempt in range(ATTEMPTS):
        if left:
            folder = tmp_path / str(attempt)
            folder.mkdir()
            _, run, output = bench(folder, cases, profile="agilex_hunter")
            driven, absent = run.cases
            assert (absent.verdict, "gear" in absent.why) == (Verdict.NOT_APPLICABLE, True)
            left = late_cases(msgspec.structs.replace(run, cases=[driven]), output)
    assert left == [], output


@pytest.mark.timeout(LONGEST_S)
def test_sigterm_in_a_case_ends_the_device_restores_the_link_and_writes_the_report(
    tmp_path: Path,
) -> None:
    command = [sys.executable, "tools/hil_bench.py", "--channel", CHANNEL, "--out", str(tmp_path / "report")]
    command += ["--case", "link-down", "--repeat", "2", "--device", f"{MINIMAL} --arm"]
    bench = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        while _is_up():
            assert bench.poll() is None
            time.sleep(0.02)
        os.killpg(bench.pid, signal.SIGTERM)
        os.killpg(bench.pid, signal.SIGINT)
        _, output = bench.communicate(timeout=60)
        is_up = _is_up()
    finally:
        bench.kill()
        subprocess.run(["ip", "link", "set", CHANNEL, "up"], check=True)
    run = result.read(tmp_path / "report" / "results.json")
    assert "interrupted in case 1 of 2; links, clock, cables and disks are restored" in output
    assert (run.verdict, [case.verdict for case in run.cases]) == (Verdict.NOT_EXECUTED, 2 * [Verdict.NOT_EXECUTED])
    assert "interrupted in case 1 of 2" in (tmp_path / "report" / "index.html").read_text()
    assert bench.returncode == 130
    assert is_up
    left = subprocess.run(["pgrep", "-f", "minimal_controller"], capture_output=True, text=True, check=False)
    assert not left.stdout


def _is_up() -> bool:
    return bool(int(Path(f"/sys/class/net/{CHANNEL}/flags").read_text(), 16) & 1)


def test_on_a_bus_with_traffic_the_bench_only_listens(tmp_path: Path) -> None:
    sim = subprocess.Popen([sys.executable, "-m", "vehicle_iface", "sim", "--channel", CHANNEL], cwd=ROOT)
    try:
        command = [sys.executable, "tools/hil_bench.py", "--channel", CHANNEL, "--out", str(tmp_path / "report")]
        command += ["--case", "state-lost", "--duration", "2", "--despite-traffic", "--type-profile", "another"]
        while not _is_speaking():
            assert sim.poll() is None
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=ROOT)
        still_alone = sim.poll() is None
    finally:
        sim.terminate()
        sim.wait(timeout=10)
    report = tmp_path / "report" / "results.json"
    assert report.exists(), done.stdout + done.stderr
    run = result.read(report)
    assert still_alone
    assert [case.name for case in run.cases] == ["listen-only"]
    assert run.verdict is Verdict.NOT_EXECUTED
    assert "only listens" in done.stderr
    assert done.returncode == 3


def test_with_a_real_vehicle_the_bench_only_listens(vcan0: None, tmp_path: Path) -> None:  # noqa: ARG001
    command = [sys.executable, "tools/hil_bench.py", "--channel", CHANNEL, "--out", str(tmp_path / "report")]
    with open_socket(CHANNEL) as ear:
        done = subprocess.run(
            [*command, "--real-vehicle", "--duration", "1"], capture_output=True, timeout=60, check=False, cwd=ROOT
        )
        received = receive_frames(ear)
    run = result.read(tmp_path / "report" / "results.json")
    assert [case.name for case in run.cases] == ["listen-only"]
    assert (done.returncode, run.verdict, received) == (3, Verdict.NOT_EXECUTED, [])


def test_own_frames_in_flight_during_a_reopen_are_still_own(vcan0: None) -> None:  # noqa: ARG001
    frame = Frame(0, 0x110, bytes(range(8)))
    own = Bus(CHANNEL, None)
    try:
        assert own.send(frame)
        own.reopen()
        with open_socket(CHANNEL) as other:
            assert send(other, frame)
            assert send(other, frame)
        received = list(own.drain())
    finally:
        own.close()
    assert [one.is_ours for one in received] == [True, False]


def _is_speaking() -> bool:
    received = subprocess.run(["candump", "-n", "1", "-T", "500", CHANNEL], capture_output=True, check=False)
    return bool(received.stdout)
