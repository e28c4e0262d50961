"""What a device does after an override, how its wheels stand in a stop, and its memory are watched in every case."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from hil_bench import judges
from hil_bench.judges import stops
from hil_bench.result import Verdict
from hil_bench.vehicle import Instant
from hil_bench.wire import Wire
from scenes import WIRE, at, other_wire, pair, released, steady
from vehicle_bus_contract.judge import Pair, Record, Sample
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MANUAL, READY, S

OVERRIDDEN = [*steady(0, 2), *steady(2, 5, released)]


def modes(*changes: tuple[float, int]) -> list[Instant]:
    """Ten seconds in which the vehicle's mode changes."""
    found = []
    for tick in range(1000):
        mode = [mode for from_s, mode in changes if from_s <= tick / 100][-1]
        found.append(at(tick / 100, 2.0, mode))
    return found


@pytest.mark.parametrize("left", [MANUAL, FAULT])
def test_a_device_that_drives_again_unarmed_is_found_whenever_it_does(left: int) -> None:
    history = modes((0.0, AUTONOMOUS), (2.0, left), (3.0, READY))
    again = Record(pairs=[*OVERRIDDEN, *steady(6.0, 6.5), *steady(6.5, 7)])
    found = list(stops.find_unarmed(again, history, []))
    assert found[0] == "6.010 s: ENABLE 1 with NOMINAL, 4.0 s after it ended, not armed"
    assert list(stops.find_unarmed(again, history, [round(5.9 * S)])) == []
    assert list(stops.find_unarmed(Record(pairs=OVERRIDDEN), history, [])) == []


def test_commands_on_the_way_and_one_after_a_pause_are_no_drive() -> None:
    history = modes((0.0, AUTONOMOUS), (2.0, MANUAL))
    late = Record(pairs=[*steady(0, 2.3), *steady(2.3, 5, released)])
    assert list(stops.find_unarmed(late, history, [])) == []
    paused = Record(pairs=[*steady(0, 2), pair(4.0), *steady(4.01, 5, released)])
    assert list(stops.find_unarmed(paused, history, [])) == []
    assert list(stops.find_unarmed(Record(pairs=[*steady(0, 4)]), modes((0.0, AUTONOMOUS)), [])) == []
    assert list(stops.find_unarmed(Record(pairs=[*steady(0, 4)]), modes((0.0, MANUAL), (1.0, AUTONOMOUS)), [])) == []


def turned(angles_rad: Sequence[float], speed_mps: float = 4.0) -> Record:
    """A stop with these angles of the front wheels."""
    pairs = []
    for tick, angle_rad in enumerate(angles_rad):
        one = pair(1.0 + tick / 100, stop=1, reason="DEVIATION", accel=-3.0)
        steer = WIRE.intact(WIRE.pack("STEER_COMMAND", 1, ENABLE=1, FRONT_WHEEL_ANGLE_REQUEST=angle_rad))
        assert steer is not None
        pairs.append(Pair(one.drive, steer))
    samples = [Sample(S + tick * S // 100, 0.0, 0.0, 0.0, speed_mps) for tick in range(len(angles_rad))]
    return Record(pairs=pairs, samples=samples)


def unmeasured(folder: Path, policy: str) -> Wire:
    """The reference vehicle with another policy, whose wheels nobody measures."""
    text = other_wire(folder, profile=('stop_steering = "straight"', f'stop_steering = "{policy}"')).path
    text.write_text(text.read_text().replace('front_wheel_angle_rad = "CHASSIS.FRONT_WHEEL_ANGLE"\n', ""))
    return Wire(str(text))


@pytest.mark.parametrize(
    ("policy", "last_rad", "is_wrong"),
    [
        ("straight", 0.2, True),
        ("straight", 0.0, False),
        ("hold", 0.0, True),
        ("hold", 0.2, False),
        ("track", 0.2, False),
    ],
)
def test_a_stop_that_steers_otherwise_than_the_profile_is_found(
    tmp_path: Path, policy: str, last_rad: float, is_wrong: bool
) -> None:
    angles = [0.2 + (last_rad - 0.2) * min(1.0, tick / 30) for tick in range(200)]
    found = list(stops.find_wrong_steering(unmeasured(tmp_path, policy), turned(angles)))
    assert bool(found) is is_wrong
    assert all(f"where the profile has them {policy}" in text for text in found)


def test_wheels_of_a_vehicle_at_rest_may_stay_where_they_are(tmp_path: Path) -> None:
    assert list(stops.find_wrong_steering(unmeasured(tmp_path, "straight"), turned([0.2] * 200, 0.1))) == []


def memory(bytes_per_sample: float, seconds: int = 60) -> list[tuple[int, int]]:
    return [(second * S, 40_000_000 + round(bytes_per_sample * 100 * second)) for second in range(seconds)]


def test_a_list_that_grows_by_300_bytes_a_sample_is_found() -> None:
    (grows,) = judges.check_memory(memory(300.0), S, 0.01)
    assert grows.verdict is Verdict.FAIL
    assert grows.found[0].endswith("300 B a sample")
    assert [one.verdict for one in judges.check_memory(memory(0.0), S, 0.01)] == [Verdict.PASS]
    arena = [(at_ns, held + (262_144 if at_ns > 40 * S else 0)) for at_ns, held in memory(0.0)]
    assert [one.verdict for one in judges.check_memory(arena, S, 0.01)] == [Verdict.PASS]


def test_memory_is_not_judged_where_it_was_not_seen_for_long() -> None:
    assert judges.check_memory(memory(300.0, 20), S, 0.01) == []
    assert judges.check_memory([], S, 0.01) == []
    assert judges.check_memory(memory(300.0), 0, 0.01) == []
