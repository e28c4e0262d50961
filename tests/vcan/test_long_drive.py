"""tools/long_drive on a real vcan0: short drives of both kinds, and that its verdict can be another one."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from drive_checks.check_drive import PROFILES, judge
from vehicle_bus_contract.candump import read_candump
from vehicle_bus_contract.reference import Contract, Frame

from .conftest import ROOT, Program, Programs, mtu, set_mtu
from .driving import wait_until_driven
from .observer import Observer

TOOLS = ROOT / "tools"
LONG_DRIVE = ("-P", "-m", "drive_checks.long_drive")
DRIVE_S = 10
PLACE = -400
"""A command well before the stop at the end: of the stalls of a slow machine few come after it."""
Frames = list[Frame]


@dataclass(frozen=True)
class Drive:
    """What a drive left behind."""

    contract: Contract
    folder: Path
    status: int
    text: str

    @property
    def verdict(self) -> dict[str, Any]:
        content: dict[str, Any] = json.loads((self.folder / "verdict.json").read_text())
        return content

    @property
    def frames(self) -> Frames:
        return list(read_candump(self.folder / "log.candump"))

    def judged(self, frames: Frames) -> list[str]:
        wrong: list[str] = judge(frames, self.contract, "none", 0.3)["wrong"]
        return wrong


@pytest.fixture(scope="module", params=PROFILES)
def drive(request: pytest.FixtureRequest, vcan0: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drive]:  # noqa: ARG001
    """A short one along the figure of eight."""
    folder, before = tmp_path_factory.mktemp("drive") / "results", mtu()
    options = ["--profile", request.param, "--duration", str(DRIVE_S), "--out", str(folder)]
    done = subprocess.run(
        [sys.executable, *LONG_DRIVE, *options],
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{TOOLS}"},
    )
    yield Drive(PROFILES[request.param], folder, done.returncode, done.stdout)
    set_mtu(before)


@pytest.mark.timeout(180)
def test_a_drive_is_recorded_and_has_no_findings(drive: Drive) -> None:
    assert drive.status == 0, drive.text
    assert {path.name for path in drive.folder.iterdir()} >= {"log.candump", "summary.json", "verdict.json", "loop.txt"}
    verdict = drive.verdict
    assert verdict["wrong"] == []
    assert set(verdict["frames"]) == set(drive.contract.messages)
    assert min(verdict["frames"].values()) > 0.9 * 10 * DRIVE_S
    assert 0.0 < verdict["worst_lateral_error_m"] < 0.3
    assert verdict["run_commands"] == verdict["pairs"]
    assert "nothing is wrong" in drive.text


def rewritten(drive: Drive, frame: Frame, *, behind: int = 0, **signals: float) -> Frame:
    """An intact frame with another counter or content."""
    decoded = drive.contract.intact(frame)
    assert decoded is not None
    counter = (decoded.counter - behind) % drive.contract.counters
    content = {name: value for name, value in decoded.signals.items() if name != "COUNTER"} | signals
    _, data = drive.contract.pack(decoded.name, counter, **content)
    return Frame(frame.stamp_ns, frame.can_id, data, is_fd=frame.is_fd)


def repeat_a_counter(drive: Drive, frames: Frames, i: int) -> None:
    frames[i] = rewritten(drive, frames[i], behind=1)


def spoil_a_checksum(_: Drive, frames: Frames, i: int) -> None:
    old = frames[i]
    frames[i] = Frame(old.stamp_ns, old.can_id, bytes((old.data[0] ^ 1,)) + old.data[1:], is_fd=old.is_fd)


def lose_an_answer(drive: Drive, frames: Frames, i: int) -> None:
    for name in drive.contract.command:
        can_id = drive.contract.messages[name][0]
        del frames[next(k for k in range(i, len(frames)) if frames[k].can_id == can_id)]


def accelerate_too_much(drive: Drive, frames: Frames, i: int) -> None:
    frames[i] = rewritten(drive, frames[i], ACCEL_REQUEST=3.001)


@pytest.mark.parametrize(
    ("plant", "finding"),
    [
        (repeat_a_counter, "counter: {command}"),
        (spoil_a_checksum, "CRC: {command}"),
        (lose_an_answer, "unanswered: "),
        (accelerate_too_much, "ACCEL_REQUEST 3.001"),
    ],
)
def test_a_fault_planted_into_the_record_is_found(
    drive: Drive, plant: Callable[[Drive, Frames, int], None], finding: str
) -> None:
    frames, command = drive.frames, drive.contract.command[0]
    assert drive.judged(frames) == []
    can_id = drive.contract.messages[command][0]
    plant(drive, frames, [i for i, frame in enumerate(frames) if frame.can_id == can_id][PLACE])
    assert any(finding.format(command=command) in text for text in drive.judged(frames))


def begun(programs: Programs, bus: Observer) -> tuple[Program, Path]:
    """A drive that is to last, under way, and where it will leave its results."""
    folder = programs.folder / "results"
    program = programs.start_python(*LONG_DRIVE, "--duration", "600", "--out", str(folder), name="long_drive")
    wait_until_driven(bus)
    return program, folder


@pytest.mark.timeout(180)
def test_ctrl_c_stops_the_vehicle_first_and_the_drive_is_not_counted(programs: Programs, bus: Observer) -> None:
    program, folder = begun(programs, bus)
    program.send_signal(signal.SIGINT)
    assert program.wait_for_end(60.0) == 130
    record = bus.record()
    assert not record.pairs[-1].is_enabled
    assert abs(record.samples[-1].speed_mps) < 0.06
    wrong = json.loads((folder / "verdict.json").read_text())["wrong"]
    assert any(text.startswith("driven for ") for text in wrong)


@pytest.mark.timeout(180)
def test_a_viewer_that_exits_ends_the_drive_in_order_and_is_named_in_the_verdict(
    programs: Programs, bus: Observer
) -> None:
    program, folder = begun(programs, bus)
    os.kill(child(program, "vehicle_iface_viewer"), signal.SIGKILL)
    assert program.wait_for_end(60.0) == 1
    record = bus.record()
    assert not record.pairs[-1].is_enabled
    wrong = json.loads((folder / "verdict.json").read_text())["wrong"]
    assert wrong[0].startswith("viewer exited unexpectedly with status -9")


def child(program: Program, module: str) -> int:
    """The process of a drive that runs a module."""
    pid = program._process.pid
    for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        if module.encode() in Path(f"/proc/{each}/cmdline").read_bytes().split(b"\0"):
            return int(each)
    raise AssertionError(f"{program.name} has no child that runs {module}")
