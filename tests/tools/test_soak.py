"""tools/soak where there is no bus: its judge on drives that are made up, clean ones and others."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from drive_checks.soak import wrong_with_summary
from drive_checks.soak_judge import Judge, LinkOutage, SoakLog, without_expired, wrong_with_cable, wrong_with_counts
from vehicle_bus_contract.reference import AUTONOMOUS, DRIVE, FAULT, MS, REFERENCE, Frame, S
from vehicle_bus_contract.socketcan import ReceivedFrame

from .running import run_module

BEGIN_NS = 1_700_000_000 * S
PERIOD_NS, DELAY_NS, ANSWER_NS = 10 * MS, 20 * MS, 1 * MS
SAMPLES = 300
MIDDLE = 150
"""A sample well within the drive."""


@dataclass
class Scene:
    """What both ends have seen of a drive of three seconds, one list for each sample, to be tampered with."""

    log: SoakLog = field(default_factory=lambda: SoakLog(BEGIN_NS))
    at_loop: list[list[ReceivedFrame]] = field(default_factory=list)
    at_vehicle: list[list[ReceivedFrame]] = field(default_factory=list)

    def judged(self, *, pieces: int = 1) -> Judge:
        """All of it, in the order of time, in so many pieces."""
        judge = Judge(self.log)
        bounds = [BEGIN_NS + (SAMPLES + 100) * PERIOD_NS * piece // pieces for piece in range(1, pieces + 1)]
        ends = [in_order(self.at_loop), in_order(self.at_vehicle)]
        for bound_ns in bounds:
            judge.take(*([seen for seen in end if seen.frame.stamp_ns <= bound_ns] for end in ends))
            ends = [[seen for seen in end if seen.frame.stamp_ns > bound_ns] for end in ends]
        judge.finish()
        return judge

    def pair(self, i: int) -> tuple[int, int]:
        """Where the answer to sample number i lies in its list: the places of its two frames."""
        own = [place for place, seen in enumerate(self.at_loop[i]) if seen.is_own]
        return own[0], own[1]

    def answer(self, i: int, *, counter: int | None = None, **signals: float) -> None:
        """Another answer to sample number i."""
        for place in self.pair(i):
            old = self.at_loop[i][place].frame
            decoded = REFERENCE.intact(old)
            assert decoded is not None
            layout = REFERENCE.messages[decoded.name][2]
            changed = {name: value for name, value in {**decoded.signals, **signals}.items() if name in layout}
            changed["COUNTER"] = decoded.counter if counter is None else counter
            frame = sent(old.stamp_ns, decoded.name, **changed)
            self.at_loop[i][place] = ReceivedFrame(frame, is_own=True)
            self.at_vehicle[i] = [seen for seen in self.at_vehicle[i] if seen.frame.data != old.data]
            self.at_vehicle[i].append(ReceivedFrame(later(frame, DELAY_NS), is_own=False))


def in_order(lists: list[list[ReceivedFrame]]) -> list[ReceivedFrame]:
    return sorted((seen for each in lists for seen in each), key=lambda seen: seen.frame.stamp_ns)


def sent(stamp_ns: int, name: str, **signals: float) -> Frame:
    counter = int(signals.pop("COUNTER"))
    return Frame(stamp_ns, *REFERENCE.pack(name, counter, **signals))


def later(frame: Frame, by_ns: int) -> Frame:
    return Frame(frame.stamp_ns + by_ns, frame.can_id, frame.data)


@pytest.fixture
def scene() -> Scene:
    """A drive straight ahead at 3 m/s over a cable that only delays; the loop is asked to end after the last sample."""
    made = Scene()
    for i in range(SAMPLES):
        at_ns, counter = BEGIN_NS + i * PERIOD_NS, i % REFERENCE.counters
        state = [
            sent(at_ns, "POSE", COUNTER=counter, POSE_FRAME=1, POSE_VALID=1, POS_X=0.03 * i),
            sent(at_ns + 1, "MOTION", COUNTER=counter, SPEED=3.0),
            sent(at_ns + 2, "CHASSIS", COUNTER=counter),
        ]
        if i % 2 == 0:
            status = {"GEAR": DRIVE, "MODE": AUTONOMOUS}
            state.insert(0, sent(at_ns - 1, "VEHICLE_STATUS", COUNTER=(i // 2) % REFERENCE.counters, **status))
        answer_ns = at_ns + DELAY_NS + ANSWER_NS
        answer = [
            sent(answer_ns, "DRIVE_COMMAND", COUNTER=counter, ENABLE=1, SPEED_REQUEST=3.0, GEAR_REQUEST=7),
            sent(answer_ns + 1, "STEER_COMMAND", COUNTER=counter, ENABLE=1),
        ]
        made.at_vehicle.append([ReceivedFrame(frame, is_own=True) for frame in state])
        made.at_loop.append([ReceivedFrame(later(frame, DELAY_NS), is_own=False) for frame in state])
        made.at_loop[i] += [ReceivedFrame(frame, is_own=True) for frame in answer]
        made.at_vehicle[i] += [ReceivedFrame(later(frame, DELAY_NS), is_own=False) for frame in answer]
    made.log.end_ns = BEGIN_NS + (SAMPLES - 2) * PERIOD_NS
    return made


@pytest.mark.parametrize("pieces", [1, 2, 7, 40])
def test_a_clean_drive_is_found_clean_in_however_many_pieces_it_is_looked_at(scene: Scene, pieces: int) -> None:
    judge = scene.judged(pieces=pieces)
    assert list(judge.wrong) == []
    assert judge.pairs == judge.samples.complete == SAMPLES
    assert judge.to_loop.came == judge.to_loop.sent == 3 * SAMPLES + SAMPLES // 2
    assert not judge.to_loop.clear + judge.to_vehicle.clear


def send_a_command_again(scene: Scene) -> None:
    scene.at_loop[MIDDLE] += [
        ReceivedFrame(later(scene.at_loop[MIDDLE][place].frame, 2 * MS), is_own=True) for place in scene.pair(MIDDLE)
    ]


def give_new_values_an_old_counter(scene: Scene) -> None:
    scene.answer(MIDDLE, counter=(MIDDLE - 1) % REFERENCE.counters, ACCEL_REQUEST=0.5)


def answer_twice(scene: Scene) -> None:
    for i in range(MIDDLE, SAMPLES):
        scene.answer(i, counter=(i + 1) % REFERENCE.counters)
    answer_ns = BEGIN_NS + MIDDLE * PERIOD_NS + DELAY_NS + 3 * MS
    for name, values in (("DRIVE_COMMAND", {"SPEED_REQUEST": 3.0, "GEAR_REQUEST": 7}), ("STEER_COMMAND", {})):
        frame = sent(answer_ns - 3 * MS, name, COUNTER=MIDDLE % REFERENCE.counters, ENABLE=1, **values)
        scene.at_loop[MIDDLE].append(ReceivedFrame(frame, is_own=True))


def leave_a_sample_unanswered(scene: Scene) -> None:
    first, second = scene.pair(MIDDLE)
    del scene.at_loop[MIDDLE][second], scene.at_loop[MIDDLE][first]


def drive_on_blindly(scene: Scene) -> None:
    for i in range(MIDDLE, MIDDLE + 15):
        scene.at_loop[i] = [seen for seen in scene.at_loop[i] if seen.is_own]


def accelerate_too_much(scene: Scene) -> None:
    scene.answer(MIDDLE, ACCEL_REQUEST=3.5)


def stop_for_no_reason(scene: Scene) -> None:
    scene.answer(MIDDLE, SAFE_STOP=1, REASON=6)


def deviate(scene: Scene) -> None:
    scene.answer(MIDDLE, SAFE_STOP=1, REASON=9)


def let_go(scene: Scene) -> None:
    scene.answer(MIDDLE, ENABLE=0, REASON=17)


def let_go_of_a_vehicle_with_a_fault(scene: Scene) -> None:
    let_go(scene)
    place = next(i for i, seen in enumerate(scene.at_loop[MIDDLE]) if seen.frame.can_id == 0x100)
    decoded = REFERENCE.intact(scene.at_loop[MIDDLE][place].frame)
    assert decoded is not None
    status = sent(decoded.stamp_ns, "VEHICLE_STATUS", COUNTER=decoded.counter, GEAR=DRIVE, MODE=FAULT)
    scene.at_loop[MIDDLE][place] = ReceivedFrame(status, is_own=False)
    scene.at_vehicle[MIDDLE].append(ReceivedFrame(later(status, -DELAY_NS), is_own=True))


def lose_the_link_and_drive_on(scene: Scene) -> None:
    down_ns = BEGIN_NS + MIDDLE * PERIOD_NS
    scene.log.outages.append(LinkOutage(down_ns, down_ns + 300 * MS))
    for i in range(MIDDLE - 2, MIDDLE + 30):
        scene.at_loop[i].clear()


def fall_silent(scene: Scene) -> None:
    for i in range(MIDDLE, MIDDLE + 20):
        scene.at_loop[i] = [seen for seen in scene.at_loop[i] if not seen.is_own]


def let_damage_pass(scene: Scene) -> None:
    place = next(i for i, seen in enumerate(scene.at_loop[MIDDLE]) if seen.frame.can_id == 0x111)
    frame = sent(scene.at_loop[MIDDLE][place].frame.stamp_ns, "MOTION", COUNTER=MIDDLE % 15, SPEED=4.0)
    scene.at_loop[MIDDLE][place] = ReceivedFrame(frame, is_own=False)


def keep_a_command_back(scene: Scene) -> None:
    scene.answer(MIDDLE, ACCEL_REQUEST=0.123)  # no other command is the same
    place = next(i for i, seen in enumerate(scene.at_vehicle[MIDDLE]) if seen.frame.can_id == 0x080)
    old = scene.at_vehicle[MIDDLE][place].frame
    scene.at_vehicle[MIDDLE][place] = ReceivedFrame(later(old, 300 * MS), is_own=False)


@pytest.mark.parametrize(
    ("tamper", "finding"),
    [
        (send_a_command_again, "DRIVE_COMMAND with the counter of the one before it, 0"),
        (give_new_values_an_old_counter, "STEER_COMMAND with the counter of the one before it, 14"),
        (answer_twice, "a pair that answers nothing, NOMINAL"),
        (leave_a_sample_unanswered, "1.531 s: a sample shortly before this is not answered"),
        (leave_a_sample_unanswered, "DRIVE_COMMAND counts from 14 to 1"),
        (drive_on_blindly, "driven on without a sample for 101 ms"),
        (accelerate_too_much, "ACCEL_REQUEST 3.500 m/s²"),
        (stop_for_no_reason, "a stop for STATE_STALE, and the newest sample is not old"),
        (deviate, "a command that says DEVIATION"),
        (let_go, "the last command of a drive that had no cause to end"),
        (let_go, "commands again, and nobody had armed the loop again"),
        (let_go_of_a_vehicle_with_a_fault, "commands again, and nobody had armed the loop again"),
        (lose_the_link_and_drive_on, "DRIVE_COMMAND after the link was down, and nobody had armed the loop again"),
        (fall_silent, "the last command of a drive that had no cause to end"),
        (let_damage_pass, "an intact MOTION arrives that was not sent"),
        (keep_a_command_back, "DRIVE_COMMAND arrives 320 ms after it was sent"),
    ],
)
def test_each_deviation_from_the_expected_is_named(scene: Scene, tamper: Callable[[Scene], None], finding: str) -> None:
    tamper(scene)
    assert any(text.endswith(finding) for text in scene.judged(pieces=3).wrong)


def test_a_vehicle_with_a_fault_is_a_cause_of_release(scene: Scene) -> None:
    let_go_of_a_vehicle_with_a_fault(scene)
    assert not any("no cause" in text for text in scene.judged().wrong)


def test_a_loop_that_is_armed_again_may_drive_on_after_the_link_was_down(scene: Scene) -> None:
    lose_the_link_and_drive_on(scene)
    scene.log.armings_ns.append(BEGIN_NS + (MIDDLE + 20) * PERIOD_NS)
    assert not any("armed" in text or "no cause" in text for text in scene.judged().wrong)


def test_a_loop_that_was_silent_for_a_moment_and_is_armed_again_owes_no_answers(scene: Scene) -> None:
    for i in range(MIDDLE, MIDDLE + 4):
        scene.at_loop[i] = [seen for seen in scene.at_loop[i] if not seen.is_own]
    assert any("is not answered" in text for text in scene.judged().wrong)
    scene.log.armings_ns.append(BEGIN_NS + (MIDDLE + 4) * PERIOD_NS)
    assert not any("is not answered" in text for text in scene.judged().wrong)


def test_a_machine_that_stands_still_again_and_again_is_not_taken_for_a_loop_that_does(scene: Scene) -> None:
    stalls = range(20, SAMPLES - 20, 25)
    for lists in (scene.at_loop, scene.at_vehicle):
        for begin in stalls:
            for i in range(begin, begin + 13):
                lists[i].clear()
    judge = scene.judged()
    assert not any("no cause" in text or "armed" in text or "answer" in text for text in judge.wrong)
    assert len(judge.log.stalls) == len(stalls)


def test_expected_drops_are_counted_by_cause_and_message(scene: Scene) -> None:
    pose = next(seen for seen in scene.at_loop[100] if seen.frame.can_id == 0x110)
    scene.at_loop[100].append(ReceivedFrame(later(pose.frame, 3), is_own=False))
    scene.at_loop[120] = [seen for seen in scene.at_loop[120] if seen.frame.can_id != 0x111 or seen.is_own]
    chassis = next(i for i, seen in enumerate(scene.at_loop[140]) if seen.frame.can_id == 0x112)
    old = scene.at_loop[140][chassis].frame
    damaged = bytes((old.data[0] ^ 4,)) + old.data[1:]
    scene.at_loop[140][chassis] = ReceivedFrame(Frame(old.stamp_ns, old.can_id, damaged), is_own=False)
    judge = scene.judged()
    expected = {"repeated POSE": 1, "lost MOTION": 1, "bad CRC CHASSIS": 1, "lost CHASSIS": 1}
    assert judge.to_loop.clear == expected
    assert judge.samples.complete == SAMPLES - 2
    summary = {
        "drops": {"repeated POSE": 1, "bad CRC CHASSIS": 1},
        "lost": {"POSE": 0, "MOTION": 1, "CHASSIS": 1, "VEHICLE_STATUS": 0},
        "counts": {"commands": SAMPLES, "frames_sent": 2 * SAMPLES, "foreign_commands": 0},
    }
    assert wrong_with_counts(judge, summary) == []
    summary["drops"]["repeated POSE"] = 9
    summary["counts"]["commands"] = SAMPLES - 5
    assert wrong_with_counts(judge, summary) == [
        "the loop counts repeated POSE: 9, and 0 to 2 were seen",
        f"the loop counts commands: {SAMPLES - 5}, and {SAMPLES} were seen",
    ]


def test_a_cable_that_does_no_harm_is_no_soak(scene: Scene) -> None:
    way = scene.judged().to_loop
    assert wrong_with_cable(way, "to the loop", {"lost": 0.02, "repeated": 0.0}) == [
        "the cable to the loop did nothing of this kind: lost"
    ]


CLEAN: dict[str, Any] = {
    "counts": {"controller_errors": 0, "trajectories_rejected": 0},
    "implausible": {"jumped": 0, "out of order": 40},
    "tx_blocked": {},
    "bus_counters": {"receive_overflow": 0},
    "latched_fault": None,
}


def test_errors_reported_by_the_loop_are_listed() -> None:
    assert wrong_with_summary(CLEAN) == []
    assert wrong_with_summary(CLEAN | {"latched_fault": "LINK_DOWN"}) == ["latched fault LINK_DOWN"]
    assert wrong_with_summary(CLEAN | {"implausible": {"jumped": 2}}) == ["the loop counts implausible: jumped: 2"]
    assert wrong_with_summary(CLEAN | {"bus_counters": {"receive_overflow": 3}}) == [
        "the loop counts receive overflow: 3"
    ]


@pytest.mark.parametrize("option", [["--duration", "3"], ["--loss", "-1"], ["--flap-every", "soon"]])
def test_a_soak_that_makes_no_sense_is_refused(option: list[str]) -> None:
    done = run_module("drive_checks.soak", *option)
    assert done.returncode == 2
    assert "must be a number from" in done.stderr


@pytest.mark.parametrize(
    ("unanswered", "expired", "held_up", "left"),
    [(0, 0, 0, 0), (2, 2, 0, 0), (2, 1, 1, 0), (2, 1, 0, 2), (5, 9, 9, 0), (6, 9, 9, 6), (1, 0, 0, 1)],
)
def test_samples_that_the_loop_counts_as_not_answered_are_excused_while_they_are_few(
    unanswered: int, expired: int, held_up: int, left: int
) -> None:
    summary = {"samples": 1000, "counts": {"samples_expired": expired, "samples_held_up": held_up}}
    wrong = [f"{at} s: a sample that is not answered" for at in range(unanswered)]
    assert len(without_expired([*wrong, "half a pair"], summary)) == left + 1
