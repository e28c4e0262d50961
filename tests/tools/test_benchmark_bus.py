"""The benchmarks of bus and loop: their comparison is fair, and their judges see what is wrong."""

import contextlib
import json
import socket
from pathlib import Path
from typing import Any

import pytest
from benchmarks import pacing, reaction
from benchmarks.parts import process, rate_sender, reaction_pass, reaction_vcan, report
from benchmarks.parts.reaction_vehicle import RailVehicle, can_frame, figure_of_eight
from vehicle_bus_contract.reference import Frame, intact, pack
from vehicle_bus_contract.socketcan import decode

from vehicle_iface.runtime import realtime

from .running import run_module


def part(module: str, *arguments: str) -> Any:
    """What a part of a benchmark has found, in a process of its own."""
    done = run_module(f"benchmarks.parts.{module}", *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def passes() -> Any:
    return part("reaction_pass", "8", "8")


def command_pair(stamp_ns: int, counter: int, reason: int = 0) -> list[Frame]:
    drive = Frame(stamp_ns, *pack("DRIVE_COMMAND", counter, ENABLE=1, REASON=reason))
    return [drive, Frame(stamp_ns + 10, *pack("STEER_COMMAND", counter, ENABLE=1))]


def last_of_sample(stamp_ns: int, counter: int) -> Frame:
    return Frame(stamp_ns, *pack("CHASSIS", counter))


def test_every_contestant_answers_nearly_every_pass(passes: Any) -> None:
    for name, found in passes.items():
        assert len(found["passes_us"][reaction_pass.HOT]) + found["unanswered"] >= 36, name
        assert found["unanswered"] <= 4, name


def test_an_echo_is_faster_than_a_computing_loop(passes: Any) -> None:
    best = {name: min(found["passes_us"][reaction_pass.HOT]) for name, found in passes.items()}
    assert min(best, key=lambda name: best[name]) == reaction.ECHO


def test_a_contestant_that_hardly_answers_is_not_compared(passes: Any) -> None:
    mute = {"passes_us": {reaction_pass.HOT: [1.0] * 33}, "unanswered": 366}
    with pytest.raises(report.BenchmarkError, match="mute has not answered 366"):
        reaction._require_answers(passes | {"mute": mute})


def test_the_pass_becomes_a_table_with_its_targets(passes: Any) -> None:
    table = reaction._pass_table(passes)
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert len(table.rows) == 2 * len(passes)
    assert len(reaction._pass_targets(passes)) == 4


def test_a_command_is_timed_from_its_samples_last_frame() -> None:
    found = reaction_vcan.Found()
    frames = [last_of_sample(1_000, 1), *command_pair(4_000, 1), last_of_sample(11_000, 2), *command_pair(13_000, 2)]
    reaction_vcan.judge(frames, found, is_echo=False)
    assert found.first_s == pytest.approx([3e-6, 2e-6])
    assert found.second_s == pytest.approx([3.01e-6, 2.01e-6])


def test_a_sample_without_a_whole_pair_is_unanswered_and_a_stop_is_no_answer() -> None:
    found = reaction_vcan.Found()
    frames = [
        last_of_sample(1_000, 1),
        command_pair(4_000, 1)[0],
        last_of_sample(11_000, 2),
        *command_pair(13_000, 2, reason=6),
    ]
    reaction_vcan.judge(frames, found, is_echo=False)
    assert (found.unanswered, found.stops, found.first_s) == (1, 1, [])


def test_calls_are_counted_once_and_within_their_time(tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    trace.write_text(
        "7 9.5 recvmmsg(3, ) = 1\n"
        "7 10.0 recvmmsg(3, <unfinished ...>\n"
        "8 10.1 futex(0x1) = 0\n"
        "7 10.2 <... recvmmsg resumed>) = 1\n"
        "7 10.3 --- SIGUSR1 {} ---\n"
        "7 11.0 sendto(3, ) = 16\n"
    )
    assert reaction_vcan._called(trace, 10.0, 11.0) == {"recvmmsg": 1, "futex": 1}


def test_asking_the_bus_for_room_counts_beyond_the_frames_and_a_write_as_publishing() -> None:
    frames = {"recvmmsg": 3.5, "sendto": 2.2}
    quiet, asking, writing = (
        [target.is_reached for target in reaction._call_targets({reaction.OURS: frames | more})]
        for more in ({}, {"getsockopt": 1.1}, {"pwrite64": 0.9})
    )
    assert (quiet, asking, writing) == ([True, True], [False, True], [True, False])


def test_without_strace_the_table_shows_it() -> None:
    assert reaction._call_tables(None) == []
    assert "strace is not installed" in reaction._notes(None)[-1]


def test_the_vehicle_drives_off_after_three_enabled_pairs_and_keeps_to_its_course() -> None:
    vehicle, course = RailVehicle(figure_of_eight()), figure_of_eight()
    for counter in range(3):
        assert not vehicle.is_autonomous
        vehicle.receive(command_pair(0, counter)[0], now_s=5.0)
    assert vehicle.is_autonomous
    ramp_s = 4.0 / 3.0  # to 4 m/s at 3 m/s², which takes half of its way longer
    decoded = [intact(decode(raw, 0)) for raw in vehicle.sample(5.0 + course.s_m[100] / 4.0 + 0.5 * ramp_s)]
    assert None not in decoded
    pose, motion, _ = (one for one in decoded if one is not None)
    assert (pose["POS_X"], pose["POS_Y"]) == pytest.approx((course.x_m[100], course.y_m[100]), abs=0.005)
    assert motion["SPEED"] == pytest.approx(4.0)


def test_a_failing_part_reports_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reaction, "_vcan", list)
    with pytest.raises(report.BenchmarkError, match="reaction_pass ended with 1"):
        process.run_part("reaction_pass", 1)


def test_frames_that_find_no_room_are_counted_and_so_are_command_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(realtime, "apply_settings", lambda **_: [])
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with near, far:
        for frame in command_pair(0, 0):
            near.send(can_frame(frame.can_id, frame.data))
        outcome = rate_sender.send(far, RailVehicle(figure_of_eight()), rate_hz=2000, seconds=1)
        near.setblocking(False)
        kept = 0
        with contextlib.suppress(BlockingIOError):
            while near.recv(72):
                kept += 1
    assert outcome.commands == 1
    assert outcome.lost == outcome.frames - kept > 0


def control_run(**changes: Any) -> dict[str, Any]:
    """What a control process says of a run in which nothing was late."""
    usual = {"late_ns": [50_000] * 100, "ticks": 50, "periods": 50.2, "state": "ENGAGED", "deadline_misses": 0}
    collections = {"in a pass": 0, "between passes": 1}
    return {**usual, "full_collections": collections, "imports_viser": False, "page": True, **changes}


def paced(**changes: Any) -> dict[pacing.Case, pacing.Found]:
    """Two runs of each case; the changes are in the second ones of those with a reloading page."""
    found = {pacing.Case(pacing.SLOW, pacing.ORDINARY, pacing.ALONE): pacing.Found()}
    found[pacing.Case(pacing.SLOW, pacing.ORDINARY, pacing.ALONE)].add(control_run())
    for how in pacing.ONLOOKERS:
        one = found[pacing.Case(pacing.SLOW, pacing.FIFO, how)] = pacing.Found()
        one.add(control_run())
        one.add(control_run(**changes) if how == pacing.RELOADING else control_run())
    return found


@pytest.mark.parametrize("policy", [pacing.FIFO, pacing.ORDINARY])
def test_the_control_process_watches_its_own_wake_ups(policy: str, tmp_path: Path) -> None:
    found = part("pacing_loop", "reference", str(tmp_path / "telemetry"), "0.5", policy)
    assert 0 < found["ticks"] <= found["periods"] + 1.0
    assert len(found["late_ns"]) >= found["ticks"]
    assert min(found["late_ns"]) >= 0
    assert not found["imports_viser"]


def test_the_fast_profile_drives_at_1_khz(tmp_path: Path) -> None:
    profile = pacing.fast_profile(tmp_path)
    found = part("pacing_loop", str(profile), str(tmp_path / "telemetry"), "0.5", pacing.ORDINARY)
    assert found["periods"] > 490


def test_a_quiet_machine_reaches_every_target() -> None:
    targets = pacing._targets(paced())
    assert all(target.is_reached for target in targets)
    for table in pacing._tables(paced()):
        assert {len(row) for row in table.rows} == {len(table.columns)}
        assert len(table.rows) == 5


@pytest.mark.parametrize(
    ("place", "changes"),
    [
        (1, {"late_ns": [50_000] * 98 + [1_000_001] * 2}),
        (2, {"ticks": 48}),
        (4, {"full_collections": {"in a pass": 1, "between passes": 0}}),
        (5, {"imports_viser": True}),
    ],
)
def test_one_bad_run_misses_its_target(place: int, changes: dict[str, Any]) -> None:
    reached = [target.is_reached for target in pacing._targets(paced(**changes))]
    assert reached == [index != place for index in range(6)]


def test_a_browser_that_makes_the_loop_late_misses_the_target() -> None:
    found = paced()
    found[pacing.Case(pacing.SLOW, pacing.FIFO, pacing.WATCHED)].add(control_run(late_ns=[70_000] * 200))
    assert not pacing._targets(found)[0].is_reached
