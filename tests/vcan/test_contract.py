"""The judge is judged: a faultless record is found faultless, and each fault put into it is found."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from vehicle_bus_contract.candump import candump_line, read_candump
from vehicle_bus_contract.judge import examine, lateral_errors_m
from vehicle_bus_contract.reference import COUNTERS, DRIVE, MS, SAMPLE, Frame, S, pack
from vehicle_bus_contract.socketcan import open_socket, receive_frames, send

from tests.tools.running import run_module

from .conftest import mtu, set_mtu
from .observer import CHANNEL, Observer
from .verdict import breaches

BEGIN_NS = 1_700_000_000 * S
Frames = list[Frame]


def steady(samples: int = 300) -> Frames:
    """A vehicle that drives straight ahead at 2 m/s and is answered 1 ms after each sample."""
    frames: Frames = []
    for i in range(samples):
        at_ns, counter = BEGIN_NS + i * 10 * MS, i % COUNTERS
        frames += [
            _frame(at_ns, "POSE", counter, POSE_FRAME=1, POSE_VALID=1, POS_X=0.02 * i),
            _frame(at_ns + 1000, "MOTION", counter, SPEED=2.0),
            _frame(at_ns + 2000, "CHASSIS", counter),
            _frame(at_ns + MS, "DRIVE_COMMAND", counter, ENABLE=1, SPEED_REQUEST=2.0, GEAR_REQUEST=7),
            _frame(at_ns + MS + 1000, "STEER_COMMAND", counter, ENABLE=1),
        ]
        if i % 2 == 0:
            frames.append(_frame(at_ns - 1000, "VEHICLE_STATUS", i // 2 % COUNTERS, MODE=2, GEAR=DRIVE))
        if i % 10 == 9:
            frames.append(_frame(at_ns + 2 * MS, "BODY_COMMAND", i // 10 % COUNTERS))
            frames.append(_frame(at_ns + 2 * MS, "CONTROLLER_STATUS", i // 10 % COUNTERS, STATE=3))
    return sorted(frames, key=lambda frame: frame.stamp_ns)


def _frame(stamp_ns: int, name: str, counter: int, **signals: float) -> Frame:
    return Frame(stamp_ns, *pack(name, counter, **signals))


def index(frames: Frames, name: str, number: int = 150) -> int:
    """Where the frame of that number of a message is."""
    can_id = pack(name, 0)[0]
    return [i for i, frame in enumerate(frames) if frame.can_id == can_id][number]


def rewrite(frames: Frames, name: str, number: int, signals: Mapping[str, float]) -> None:
    """Another content for one frame, under its counter."""
    i = index(frames, name, number)
    frames[i] = _frame(frames[i].stamp_ns, name, frames[i].data[1] & 15, **signals)


def lose_half_an_answer(frames: Frames) -> None:
    """A pair without its DRIVE_COMMAND."""
    del frames[index(frames, "DRIVE_COMMAND")]


def lose_answers(frames: Frames) -> None:
    """One sample is not answered, and no counter shows it."""
    i = index(frames, "DRIVE_COMMAND")
    del frames[i : i + 2]
    for name in ("DRIVE_COMMAND", "STEER_COMMAND"):
        recount(frames, name)


def recount(frames: Frames, name: str) -> None:
    """Counters of one message from 0 on, each one more than the last."""
    can_id = pack(name, 0)[0]
    for step, i in enumerate(i for i, frame in enumerate(frames) if frame.can_id == can_id):
        frames[i] = _frame(frames[i].stamp_ns, name, step % COUNTERS, **CONTENT[name])


CONTENT: dict[str, dict[str, float]] = {
    "DRIVE_COMMAND": {"ENABLE": 1, "SPEED_REQUEST": 2.0, "GEAR_REQUEST": 7},
    "STEER_COMMAND": {"ENABLE": 1},
}


def double_an_answer(frames: Frames) -> None:
    """One sample is answered twice, with fresh counters."""
    i = index(frames, "DRIVE_COMMAND")
    for offset, name in enumerate(CONTENT):
        old = frames[i + offset]
        frames.insert(i + 2 + offset, Frame(old.stamp_ns + 10_000, old.can_id, old.data))
        recount(frames, name)


def corrupt(frames: Frames) -> None:
    """One bit turned over."""
    i = index(frames, "MOTION")
    data = frames[i].data
    frames[i] = Frame(frames[i].stamp_ns, frames[i].can_id, data[:5] + bytes((data[5] ^ 4,)) + data[6:])


def shorten(frames: Frames) -> None:
    """One byte too few."""
    i = index(frames, "POSE")
    frames[i] = Frame(frames[i].stamp_ns, frames[i].can_id, frames[i].data[:7])


def lose_a_frame(frames: Frames) -> None:
    """One status is missing."""
    del frames[index(frames, "VEHICLE_STATUS", 60)]


def fall_silent(frames: Frames) -> None:
    """No command for half a second."""
    commands = {pack(name, 0)[0] for name in CONTENT}
    begin, end = index(frames, "POSE", 150), index(frames, "POSE", 200)
    frames[begin:end] = [frame for frame in frames[begin:end] if frame.can_id not in commands]
    for name in CONTENT:
        recount(frames, name)


def steer(**signals: float) -> Callable[[Frames], None]:
    """One STEER_COMMAND has other values."""
    return lambda frames: rewrite(frames, "STEER_COMMAND", 150, {"ENABLE": 1} | signals)


def drive(**signals: float) -> Callable[[Frames], None]:
    """One DRIVE_COMMAND has other values."""
    return lambda frames: rewrite(frames, "DRIVE_COMMAND", 150, CONTENT["DRIVE_COMMAND"] | signals)


FAULTS: dict[str, tuple[Callable[[Frames], None], str]] = {
    "one bit": (corrupt, "CRC: MOTION at 1.50"),
    "one byte": (shorten, "malformed: POSE at 1.50"),
    "a lost frame": (lose_a_frame, "counter: VEHICLE_STATUS"),
    "a lost answer": (lose_answers, "unanswered: sample at 1.50"),
    "a doubled answer": (double_an_answer, "doubled: pair at 1.50"),
    "half an answer": (lose_half_an_answer, "unanswered: sample at 1.50"),
    "silence": (fall_silent, "silence: 1.49"),
    "wheels too far": (steer(FRONT_WHEEL_ANGLE_REQUEST=0.61), "FRONT_WHEEL_ANGLE_REQUEST 0.6100"),
    "wheels too fast": (steer(FRONT_WHEEL_ANGLE_REQUEST=0.03), "wheels faster than 0.8 rad/s"),
    "too much brake": (drive(ACCEL_REQUEST=-6.1), "ACCEL_REQUEST -6.100"),
    "too much throttle": (drive(ACCEL_REQUEST=3.1), "ACCEL_REQUEST 3.100"),
    "half enabled": (drive(ENABLE=0, REASON=17), "ENABLE 0 and 1 in one pair"),
    "a stop without a reason": (drive(SAFE_STOP=1), "SAFE_STOP 1 with NOMINAL"),
    "a reason without a stop": (drive(REASON=6), "SAFE_STOP 0 with STATE_STALE"),
    "an unknown reason": (drive(SAFE_STOP=1, REASON=99), "REASON 99 is none"),
    "a shift at speed": (drive(GEAR_REQUEST=DRIVE), "GEAR_REQUEST 3 at 2.00 m/s"),
    "lights without a stop": (
        lambda frames: rewrite(frames, "BODY_COMMAND", 15, {"HAZARD_LIGHTS": 1}),
        "BODY_COMMAND HAZARD_LIGHTS 1",
    ),
    "a report of a stop without one": (
        lambda frames: rewrite(frames, "CONTROLLER_STATUS", 15, {"STATE": 4}),
        "CONTROLLER_STATUS STATE 4",
    ),
}


def test_the_worked_example_of_the_contract_is_met() -> None:
    assert pack("VEHICLE_STATUS", 1)[1][:2].hex(" ") == "02 01"
    assert pack("VEHICLE_STATUS", 2)[1][:2].hex(" ") == "e5 02"


def test_a_correct_record_has_no_findings() -> None:
    record = examine(steady())
    assert record.faults() == []
    assert len(record.samples) == len(record.pairs) == 300
    assert record.frames["BODY_COMMAND"] == 30


@pytest.mark.parametrize(("fault", "finding"), FAULTS.values(), ids=FAULTS)
def test_each_fault_is_found(fault: Callable[[Frames], None], finding: str) -> None:
    frames = steady()
    fault(frames)
    assert any(finding in text for text in examine(frames).faults()), examine(frames).faults()


def silence_the_vehicle(frames: Frames) -> None:
    """No sample from 1.5 s on, and the commands go on."""
    state = {pack(name, 0)[0] for name in SAMPLE}
    begin = index(frames, "POSE")
    frames[begin:] = [frame for frame in frames[begin:] if frame.can_id not in state]


def stop_in_vain(frames: Frames) -> None:
    """The same, and the commands are stops."""
    silence_the_vehicle(frames)
    for i, frame in enumerate(frames):
        if frame.can_id == 0x080 and frame.stamp_ns - BEGIN_NS > 1.55 * S:
            signals = {"ENABLE": 1, "SAFE_STOP": 1, "REASON": 6, "GEAR_REQUEST": 7}
            frames[i] = _frame(frame.stamp_ns, "DRIVE_COMMAND", frame.data[1] & 15, **signals)


def damage_a_command(frames: Frames) -> None:
    """One bit of one command turned over."""
    i = index(frames, "STEER_COMMAND")
    frames[i] = Frame(frames[i].stamp_ns, frames[i].can_id, frames[i].data[:7] + b"\1")


def shorten_a_command(frames: Frames) -> None:
    """One command without its last byte."""
    i = index(frames, "STEER_COMMAND")
    frames[i] = Frame(frames[i].stamp_ns, frames[i].can_id, frames[i].data[:7])


def lose_the_other_half(frames: Frames) -> None:
    """A pair without its STEER_COMMAND."""
    del frames[index(frames, "STEER_COMMAND")]


def lose_a_pair(frames: Frames) -> None:
    """One pair less, and the counters show it."""
    i = index(frames, "DRIVE_COMMAND")
    del frames[i : i + 2]


BREACHES: dict[str, tuple[Callable[[Frames], None], str]] = {
    "driven without state": (silence_the_vehicle, "old state: NOMINAL at 1.74"),
    "stopped without end": (stop_in_vain, "old state: STATE_STALE at 2.0"),
    "a damaged command": (damage_a_command, "damaged: STEER_COMMAND at 1.50"),
    "a short command": (shorten_a_command, "malformed: STEER_COMMAND at 1.50"),
    "a lost pair": (lose_a_pair, "counter: DRIVE_COMMAND at 1.51"),
    "half a pair": (lose_the_other_half, "alone: DRIVE_COMMAND alone at 1.501"),
    "a stop without a reason": (drive(SAFE_STOP=1), "command: 1.501 s: SAFE_STOP 1 with NOMINAL"),
    "lights without a stop": FAULTS["lights without a stop"],
}


@pytest.mark.parametrize(("breach", "finding"), BREACHES.values(), ids=BREACHES)
def test_each_violation_by_the_controller_is_found(breach: Callable[[Frames], None], finding: str) -> None:
    frames = steady()
    breach(frames)
    found = breaches(frames)
    assert any(finding in text for text in found), found


def test_clock_steps_are_not_violations_and_hide_none() -> None:
    hours_ago = [Frame(frame.stamp_ns - 3600 * S, frame.can_id, frame.data) for frame in steady()]
    assert breaches([*steady(), *hours_ago, *steady()]) == []
    lose_a_pair(hours_ago)
    assert len(breaches([*steady(), *hours_ago, *steady()])) == 2


def test_the_vehicles_faults_are_not_violations_by_the_controller() -> None:
    frames = steady()
    for fault in (corrupt, shorten, lose_a_frame, lose_answers):
        fault(frames)
    assert breaches(frames) == []


def test_late_commands_are_neither_missing_nor_duplicated() -> None:
    commands = {pack(name, 0)[0] for name in CONTENT}
    late = [
        Frame(frame.stamp_ns + 35 * MS, frame.can_id, frame.data)
        if frame.can_id in commands and 1 * S < frame.stamp_ns - BEGIN_NS < 1.5 * S
        else frame
        for frame in steady()
    ]
    found = [text for text in examine(late).faults() if not text.startswith("counter")]
    assert found == []


def test_parts_of_different_samples_are_never_combined() -> None:
    frames = [
        _frame(BEGIN_NS + i * MS, name, i % COUNTERS)
        for i in range(60)
        for name in SAMPLE
        if i % 3 != SAMPLE.index(name)
    ]
    assert examine(frames).samples == []


def test_the_distance_from_a_path_follows_the_branch_that_is_driven_on() -> None:
    samples = examine(steady(100)).samples
    x_m, y_m = [-5.0, 10.0, 10.0, 1.0, 1.0], [0.5, 0.5, 8.0, 8.0, -8.0]
    errors_m = lateral_errors_m(samples, x_m, y_m)
    assert max(errors_m) == pytest.approx(0.5, abs=1e-6)


def test_check_drive_reports_what_is_wrong_in_a_log(tmp_path: Path) -> None:
    good, bad = steady(), steady()
    corrupt(bad)
    statuses, worst = [], []
    for frames in (good, bad):
        log = tmp_path / "log.candump"
        log.write_text("".join(f"{candump_line(frame, CHANNEL)}\n" for frame in frames))
        options = ["--route", "line", "--lateral-limit", "41", "--json"]
        done = run_module("drive_checks.check_drive", str(log), *options)
        statuses.append(done.returncode)
        worst.append(json.loads(done.stdout))
    assert statuses == [0, 1]
    assert worst[0]["samples"] == worst[0]["pairs"] == 300
    assert worst[1]["wrong"][0].startswith("CRC: MOTION at 1.50")


def test_check_drive_rejects_a_file_that_is_not_a_log_and_names_the_line(tmp_path: Path) -> None:
    (tmp_path / "no.log").write_text("(1700000000.000001) vcan0 080#0011223344556677\nhello\n")
    done = run_module("drive_checks.check_drive", str(tmp_path / "no.log"))
    assert done.returncode == 2
    assert "line 2" in done.stderr


def test_a_written_log_has_the_format_of_candump(bus: Observer, tmp_path: Path) -> None:
    bus.is_foreign = lambda _: True  # nobody drives here
    candump, before, log = shutil.which("candump"), mtu(), tmp_path / "log.candump"
    assert candump is not None
    set_mtu(72)
    try:
        with (
            open_socket(CHANNEL) as raw,
            log.open("wb") as out,
            subprocess.Popen([candump, "-L", CHANNEL], stdout=out) as process,
        ):
            while not log.stat().st_size:  # until candump receives
                assert send(raw, Frame(0, 0x001, b""))
                assert process.poll() is None
            with open_socket(CHANNEL) as ear:
                for frame in (
                    Frame(0, 0x080, bytes(range(8))),
                    Frame(0, 0x111, b""),
                    Frame(0, 0x1ABCDEF0, b"\xff", is_extended=True),
                    Frame(0, 0x110, bytes(range(32)), is_fd=True),
                    Frame(0, 0x112, b"", is_remote=True),
                    Frame(0, 0x7FF, b""),
                ):
                    assert send(raw, frame)
                while b"7FF#\n" not in log.read_bytes():
                    assert process.poll() is None
                process.terminate()
                lines = [candump_line(frame, CHANNEL) for frame in receive_frames(ear)]
        assert len(lines) == 6
        written = re.sub("##[0-9A-F]", "##1", log.read_text()).splitlines()  # a frame keeps no flags of CAN FD
        assert [line for line in written if " 001#" not in line] == lines
        assert [candump_line(frame, CHANNEL) for frame in read_candump(log)][-6:] == lines
    finally:
        set_mtu(before)
