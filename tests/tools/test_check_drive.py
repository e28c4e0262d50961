"""tools/check_drive on CAN FD: a faultless recording is found faultless, and each fault put into it is found."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from drive_checks.check_drive import judge
from vehicle_bus_contract.candump import candump_line
from vehicle_bus_contract.reference import AUTONOMOUS, DRIVE, ENGAGED, MS, NO_REQUEST, Frame, S
from vehicle_bus_contract.reference_fd import COUNTERS, REFERENCE_FD, pack

from .running import run_module

BEGIN_NS = 1_700_000_000 * S
SAMPLES = 600
"""More than two rounds of the counter."""
COMMAND: dict[str, float] = {"ENABLE": 1, "SPEED_REQUEST": 2.0, "GEAR_REQUEST": NO_REQUEST}
Frames = list[Frame]


def steady() -> Frames:
    """A vehicle that drives straight ahead at 2 m/s and is answered 1 ms after each sample."""
    frames: Frames = []
    for i in range(SAMPLES):
        at_ns = BEGIN_NS + i * 10 * MS
        frames.append(frame(at_ns, "STATE", i, POSE_FRAME=1, POSE_VALID=1, POS_X=0.02 * i, SPEED=2.0))
        frames.append(frame(at_ns + MS, "COMMAND", i, **COMMAND))
        if i % 2 == 0:
            frames.append(frame(at_ns + 2 * MS, "VEHICLE_STATUS", i // 2, MODE=AUTONOMOUS, GEAR=DRIVE))
        if i % 10 == 0:
            frames.append(frame(at_ns + 3 * MS, "BODY_COMMAND", i // 10))
            frames.append(frame(at_ns + 3 * MS, "CONTROLLER_STATUS", i // 10, STATE=ENGAGED))
    return frames


def frame(stamp_ns: int, name: str, counter: int, **signals: float) -> Frame:
    return Frame(stamp_ns, *pack(name, counter % COUNTERS, **signals), is_fd=True)


def index(frames: Frames, name: str, number: int = 300) -> int:
    """Where the frame of that number of a message is."""
    return [i for i, each in enumerate(frames) if REFERENCE_FD.names[each.can_id] == name][number]


def judged(frames: Frames) -> dict[str, Any]:
    return judge(frames, REFERENCE_FD, "line", 1000.0)


def replaced(name: str, change: Callable[[Frame], Frame], number: int = 300) -> Callable[[Frames], None]:
    """One frame of a message is another one."""

    def apply(frames: Frames) -> None:
        i = index(frames, name, number)
        frames[i] = change(frames[i])

    return apply


def with_signals(name: str, number: int = 300, /, **signals: float) -> Callable[[Frames], None]:
    """One frame of a message has another content, under its counter."""
    return replaced(name, lambda old: frame(old.stamp_ns, name, old.data[2], **signals), number)


def with_data(old: Frame, data: bytes, *, is_fd: bool = True) -> Frame:
    return Frame(old.stamp_ns, old.can_id, data, is_fd=is_fd)


def one_bit_turned_over(old: Frame) -> Frame:
    return with_data(old, old.data[:6] + bytes((old.data[6] ^ 4,)) + old.data[7:])


def answer_twice(frames: Frames) -> None:
    """Two commands for one sample, with fresh counters."""
    i = index(frames, "COMMAND")
    frames.insert(i, frames[i])
    recount(frames)


def answer_not_at_all(frames: Frames) -> None:
    """No command for one sample, and no counter shows it."""
    del frames[index(frames, "COMMAND")]
    recount(frames)


def recount(frames: Frames) -> None:
    """The commands' counters from 0 on, each one more than the last."""
    places = [i for i, each in enumerate(frames) if REFERENCE_FD.names[each.can_id] == "COMMAND"]
    for step, i in enumerate(places):
        frames[i] = frame(frames[i].stamp_ns, "COMMAND", step, **COMMAND)


def fall_silent(frames: Frames) -> None:
    """No command for half a second."""
    for _ in range(50):
        del frames[index(frames, "COMMAND")]
    recount(frames)


def lose_a_status(frames: Frames) -> None:
    del frames[index(frames, "VEHICLE_STATUS", 60)]


FAULTS: list[tuple[Callable[[Frames], None], str]] = [
    (replaced("STATE", one_bit_turned_over), "CRC: STATE at 3.000 s"),
    (replaced("COMMAND", one_bit_turned_over), "CRC: COMMAND at 3.001 s"),
    (replaced("STATE", lambda old: with_data(old, old.data[:24])), "malformed: STATE at 3.000 s"),
    (replaced("BODY_COMMAND", lambda old: with_data(old, old.data, is_fd=False), 30), "malformed: BODY_COMMAND"),
    (replaced("COMMAND", lambda old: frame(old.stamp_ns, "COMMAND", 299, **COMMAND)), "counter: COMMAND at 3.001 s"),
    (replaced("STATE", lambda old: frame(old.stamp_ns, "STATE", 302)), "counter: STATE at 3.000 s: 43 to 46"),
    (lose_a_status, "counter: VEHICLE_STATUS"),
    (answer_not_at_all, "unanswered: sample at 3.000 s"),
    (answer_twice, "doubled: pair at 3.001 s"),
    (fall_silent, "silence: 2.991 s to 3.501 s"),
    (with_signals("COMMAND", **COMMAND | {"ACCEL_REQUEST": 3.001}), "command: 3.001 s: ACCEL_REQUEST 3.001 m/s²"),
    (with_signals("COMMAND", **COMMAND | {"ACCEL_REQUEST": -6.001}), "command: 3.001 s: ACCEL_REQUEST -6.001 m/s²"),
    (
        with_signals("COMMAND", 0, **COMMAND | {"FRONT_WHEEL_ANGLE_REQUEST": 0.6001}),
        "0.001 s: FRONT_WHEEL_ANGLE_REQUEST",
    ),
    (
        with_signals("COMMAND", **COMMAND | {"FRONT_WHEEL_ANGLE_REQUEST": 0.03}),
        "wheels faster than 0.8 rad/s, to 0.0300 rad",
    ),
    (with_signals("COMMAND", **COMMAND | {"REASON": 18}), "REASON 18 is none"),
    (with_signals("COMMAND", **COMMAND | {"REASON": 9}), "SAFE_STOP 0 with DEVIATION"),
    (with_signals("COMMAND", **COMMAND | {"GEAR_REQUEST": DRIVE}), "GEAR_REQUEST 3 at 2.00 m/s"),
    (with_signals("BODY_COMMAND", 30, HAZARD_LIGHTS=1), "BODY_COMMAND HAZARD_LIGHTS 1"),
    (with_signals("CONTROLLER_STATUS", 30, STATE=4), "CONTROLLER_STATUS STATE 4"),
]


def test_a_steady_drive_is_found_faultless() -> None:
    found = judged(steady())
    assert found["wrong"] == []
    assert found["samples"] == found["pairs"] == SAMPLES
    assert found["driven_s"] == pytest.approx(SAMPLES / 100, abs=0.02)
    assert found["frames"] == {
        "COMMAND": 600, "BODY_COMMAND": 60, "VEHICLE_STATUS": 300, "STATE": 600, "CONTROLLER_STATUS": 60
    }  # fmt: skip


@pytest.mark.parametrize(("spoil", "finding"), FAULTS, ids=[finding for _, finding in FAULTS])
def test_a_fault_is_found_by_name_and_time(spoil: Callable[[Frames], None], finding: str) -> None:
    frames = steady()
    spoil(frames)
    wrong = judged(frames)["wrong"]
    assert any(finding in text for text in wrong), wrong


def test_a_vehicle_beside_its_route_is_found() -> None:
    beside = [
        frame(each.stamp_ns, "STATE", each.data[2], POS_Y=0.31, SPEED=2.0) if each.can_id == 0x110 else each
        for each in steady()
    ]
    assert any("lateral error 0.310 m" in text for text in judge(beside, REFERENCE_FD, "line", 0.3)["wrong"])


def test_a_log_of_fd_frames_is_read_and_judged_by_the_profile_that_is_named(tmp_path: Path) -> None:
    log = tmp_path / "log.candump"
    log.write_text("".join(candump_line(each, "vcan0") + "\n" for each in steady()))
    results = []
    for profile in ("reference_fd", "reference"):
        options = ["--profile", profile, "--json", "--route", "line", "--lateral-limit", "41"]
        done = run_module("drive_checks.check_drive", str(log), *options)
        results.append((done.returncode, json.loads(done.stdout)))
    assert [status for status, _ in results] == [0, 1]
    assert results[0][1]["samples"] == SAMPLES
    assert results[1][1]["malformed_frames"] > 0
