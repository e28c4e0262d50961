"""The child process of the recorder, started by the loop: what it writes, and what is left when either is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from vehicle_iface.rerun.drive import rerun
from vehicle_iface_viewer.playback import Playback

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 30.0

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "drive"


@pytest.fixture
def start(tmp_path: Path, folder: Path) -> Iterator[Start]:
    """Starts a recorded drive on the embedded bus."""
    started: list[subprocess.Popen[str]] = []

    def drive(*arguments: str) -> subprocess.Popen[str]:
        started.append(
            subprocess.Popen(
                [
                    *(sys.executable, "-P", "-m", "vehicle_iface", "run", "--interface", "embedded", "--arm"),
                    *("--route", "figure8", "--telemetry", str(tmp_path / "loop"), "--record", str(folder), *arguments),
                ],
                env=os.environ | {"PYTHONPATH": str(ROOT)},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        return started[-1]

    yield drive
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for(what: str, is_so: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline_s, f"{what}: not in {PATIENCE_S:.0f} s"
        time.sleep(0.02)


def report(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "recorder.json").read_text())
    return content


def has_driven(folder: Path) -> bool:
    file = folder / "snapshots.csv"
    return file.exists() and file.read_bytes().count(b"\n") > 150


def recorder_of(loop: "subprocess.Popen[str]") -> int:
    (pid,) = Path(f"/proc/{loop.pid}/task/{loop.pid}/children").read_text().split()
    return int(pid)


def is_gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_a_recorded_drive_is_complete_and_reports_it(start: Start, folder: Path) -> None:
    loop = start("--duration", "2")
    said, _ = loop.communicate(timeout=PATIENCE_S)
    assert loop.returncode == 0, said
    summary = json.loads((folder / "summary.json").read_text())
    found = report(folder)
    assert found["is_over"]
    before = summary["counts"]["samples_before_engagement"]  # received until the vehicle has reported who drives it
    assert found["written"]["snapshots"] == summary["samples"] + before > 150
    assert not any(found["lost"].values()), found["lost"]
    assert summary["recorder"]["written"] == found["written"]
    assert f"{folder}: " in said
    assert "written, nothing lost" in said
    assert Playback(str(folder)).length_s > 1.5


def test_a_recorded_drive_is_run_again_without_a_difference(start: Start, folder: Path) -> None:
    loop = start()
    wait_for("a drive", lambda: has_driven(folder))
    os.kill(loop.pid, signal.SIGUSR1)
    time.sleep(0.2)
    os.kill(loop.pid, signal.SIGINT)
    time.sleep(0.2)
    os.kill(loop.pid, signal.SIGINT)
    said, _ = loop.communicate(timeout=PATIENCE_S)
    assert loop.returncode == 0, said
    found = rerun(folder)
    assert (found.count, found.gap) == (0, ""), found.text
    assert found.frames == json.loads((folder / "summary.json").read_text())["counts"]["frames_sent"] > 150
    assert report(folder)["lost"]["inputs"] == 0


def test_a_killed_loop_leaves_a_black_box_beside_its_recording(start: Start, folder: Path) -> None:
    loop = start()
    wait_for("a drive", lambda: has_driven(folder))
    recorder = recorder_of(loop)
    loop.kill()
    wait_for("the recorder's end", lambda: is_gone(recorder))
    (box,) = (folder / "events").iterdir()
    assert box.name.endswith("-LOOP-KILLED")
    assert Playback(str(box)).length_s > 1.0


def test_without_a_recording_only_the_black_box_is_written(tmp_path: Path, folder: Path) -> None:
    loop = subprocess.Popen(
        [
            *(
                sys.executable,
                "-P",
                "-m",
                "vehicle_iface",
                "run",
                "--interface",
                "embedded",
                "--arm",
                "--route",
                "figure8",
            ),
            *("--telemetry", str(tmp_path / "loop"), "--black-box", str(folder)),
        ],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert loop.stdout is not None
    for line in loop.stdout:
        if "ENGAGED" in line:
            break
    recorder = recorder_of(loop)
    loop.kill()
    loop.communicate()
    wait_for("the recorder's end", lambda: is_gone(recorder))
    (box,) = folder.iterdir()
    assert box.name.endswith("-LOOP-KILLED")
    assert sorted(path.name for path in box.iterdir()) == [
        "counters.jsonl",
        "events.jsonl",
        "meta.json",
        "profile",
        "snapshots.csv",
        "trajectories.jsonl",
    ]


def test_a_folder_that_is_not_empty_is_refused_before_anything_drives(start: Start, folder: Path) -> None:
    folder.mkdir()
    (folder / "notes").write_text("mine")
    loop = start("--duration", "2")
    said, _ = loop.communicate(timeout=PATIENCE_S)
    assert loop.returncode == 2
    assert said == (
        f"vehicle-iface: --record {folder}: is not an empty folder; nothing is overwritten: choose another name\n"
    )


def test_a_recorder_that_is_killed_leaves_what_it_has_written_and_the_drive_goes_on(start: Start, folder: Path) -> None:
    loop = start()
    wait_for("a drive", lambda: has_driven(folder))
    os.kill(recorder_of(loop), signal.SIGKILL)
    before = (folder / "snapshots.csv").stat().st_size
    assert loop.stdout is not None
    for line in loop.stdout:
        if "the recorder exited (status -9)" in line:
            break
    time.sleep(0.5)
    loop.terminate()
    said, _ = loop.communicate(timeout=PATIENCE_S)
    assert loop.returncode == 0, said
    assert "exited early with status -9; later data is LOST" in said
    assert (folder / "snapshots.csv").stat().st_size == before
    assert json.loads((folder / "summary.json").read_text())["commands"] > 150
    assert Playback(str(folder)).newest() is not None


def test_a_recorder_that_hangs_does_not_hold_up_the_end(start: Start, folder: Path) -> None:
    loop = start()
    wait_for("a drive", lambda: has_driven(folder))
    pid = recorder_of(loop)
    os.kill(pid, signal.SIGSTOP)
    told_s = time.monotonic()
    loop.send_signal(signal.SIGINT)
    loop.send_signal(signal.SIGINT)
    said, _ = loop.communicate(timeout=PATIENCE_S)
    assert 5.0 <= time.monotonic() - told_s < 15.0
    assert loop.returncode == 0, said
    assert "did not end in time and was killed; unwritten data is LOST" in said
    wait_for("the recorder's end", lambda: is_gone(pid))
    assert Playback(str(folder)).newest() is not None


def test_after_a_loop_that_is_killed_the_recorder_goes_on_for_a_while_and_ends_in_order(
    start: Start, folder: Path
) -> None:
    loop = start()
    wait_for("a drive", lambda: has_driven(folder))
    pid = recorder_of(loop)
    os.kill(pid, signal.SIGTERM)  # the end of the program is the loop's to order
    os.kill(pid, signal.SIGINT)
    loop.kill()
    killed_ns = time.monotonic_ns()
    loop.wait()
    wait_for("the recorder's end", lambda: is_gone(pid))
    found = report(folder)
    assert found["is_over"]
    assert found["at_ns"] - killed_ns > 4e9
    recording = Playback(str(folder))
    assert recording.length_s > 1.0
    assert found["written"]["snapshots"] > 100
