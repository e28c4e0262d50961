"""A guided walk confirms a sound profile, and names in words what is wrong with another one."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from tests.commission.walks import BEGINS, Person, walk, walk_with, write_profile
from tests.harness import START_NS, reference
from tests.plain_vehicle import write_vehicle
from tests.review.drives import Rewriter, disturbance, note
from vehicle_iface.codec.database import build_database, load_binding
from vehicle_iface.commission.readings import Readings
from vehicle_iface.commission.report import Commissioning, describe, summarize
from vehicle_iface.commission.steps import build_steps
from vehicle_iface.profile import load_profile, profile_names
from vehicle_iface.review.findings import Judgement
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.status import VehicleMode

HEADING, SPEED, YAW = "MOTION.HEADING", "MOTION.SPEED", "MOTION.YAW_RATE"
WHEEL, ACCEL, POSITION = "CHASSIS.FRONT_WHEEL_ANGLE", "CHASSIS.ACCEL", "POSE.POS_X/POS_Y"
MIRRORED = "\n".join(note(signal, "scale = -1.0") for signal in (WHEEL, YAW, HEADING, "POSE.POS_Y"))
BRAKE = 'driver_brake = "VEHICLE_STATUS.DRIVER_BRAKE"\n'


def of_walk(found: Commissioning) -> list[str]:
    """What the walk alone holds against the profile."""
    return [one.text for step in found.steps for one in step.results if one.judgement is Judgement.CONTRADICTED]


def step_keys(profile: Path | str) -> list[str]:
    binding = load_binding(load_profile(profile))
    return [step.key for step in build_steps(binding, Readings(binding, build_database(binding)).labels)]


def test_a_sound_profile_is_confirmed_step_by_step_and_nothing_is_sent(tmp_path: Path) -> None:
    vehicle = simulated_vehicle(reference(), start_ns=START_NS, mode=VehicleMode.MANUAL)
    person = Person(vehicle)
    found = walk_with(vehicle, person, tmp_path, write_profile(tmp_path))  # on a bus that fails when one sends
    assert [step.judgement for step in found.steps] == [Judgement.AGREES] * len(BEGINS)
    assert found.is_sound
    assert describe(found) == "all 12 steps were seen, and nothing contradicts the profile"
    assert found.log_sha256 == hashlib.sha256((tmp_path / "walk.log").read_bytes()).hexdigest()
    assert found.review is not None
    assert found.review.drive.duration_s > 10.0
    assert "front_wheel_angle_rad +0.11 rad (left positive)" in person.shown
    assert "gear DRIVE" in person.shown
    texts = {one.text for step in found.steps for one in step.results}
    assert f"{WHEEL} rises by 0.11 rad when the wheel is turned left" in texts
    assert f"{SPEED} is positive and adds up to 2.4 m" in texts


WRONG: Mapping[str, tuple[str, Mapping[str, str], list[str]]] = {
    "wheel sign": (
        note(WHEEL, "scale = -1.0"),
        {},
        [
            f"{WHEEL} falls when the wheel is turned left: its sign is reversed",
            f"{WHEEL} rises when the wheel is turned right: its sign is reversed",
        ],
    ),
    "wheel degrees": (note(WHEEL, "scale = 57.3"), {}, [f"{WHEEL} reads +", f"{WHEEL} reads -"]),
    "torque sign": (
        note("VEHICLE_STATUS.DRIVER_STEER_TORQUE", "scale = -1.0"),
        {},
        [
            "VEHICLE_STATUS.DRIVER_STEER_TORQUE falls when the wheel is turned left: its sign is reversed",
            "VEHICLE_STATUS.DRIVER_STEER_TORQUE rises when the wheel is turned right: its sign is reversed",
        ],
    ),
    "yaw sign": (
        note(YAW, "scale = -1.0"),
        {},
        [f"{YAW} turns right in a bend to the left: its sign is reversed"],
    ),
    "clockwise": (
        note(HEADING, "scale = -1.0"),
        {},
        [f"{HEADING} turns right in a bend to the left: it is clockwise, like a compass"],
    ),
    "heading degrees": (
        note(HEADING, "scale = 57.3", "offset = 60.0"),
        {},
        [f"{HEADING} reads +", f"{POSITION} moves by 2.4 m, "],
    ),
    "heading from north": (
        note(HEADING, "offset = -1.5708"),
        {},
        [f"{POSITION} moves by 2.4 m, +90° off the heading by {HEADING}, when the vehicle rolls forward"],
    ),
    "speed sign": (
        note(SPEED, "scale = -1.0"),
        {},
        [f"{SPEED} is negative when the vehicle rolls forward: its sign is reversed"],
    ),
    "speed unit": (
        note(SPEED, "scale = 3.6"),
        {},
        [
            f"{SPEED} adds up to 8.6 m when the vehicle rolls forward two metres: in another unit",
            f"{ACCEL} adds up to -0.4 m/s while the speed falls by 1.0 m/s: one of them is in another unit",
        ],
    ),
    "accel sign": (
        note(ACCEL, "scale = -1.0"),
        {},
        [f"{ACCEL} is positive while the vehicle brakes: its sign is reversed"],
    ),
    "accel g": (
        note(ACCEL, "scale = 0.102"),
        {},
        [f"{ACCEL} adds up to -0.1 m/s while the speed falls by 1.0 m/s: one of them"],
    ),
    "position unit": (
        note("POSE.POS_X", 'unit = "ft"') + "\n" + note("POSE.POS_Y", 'unit = "ft"'),
        {},
        [f"{POSITION} moves by 0.7 m when the vehicle rolls forward two metres: in another unit"],
    ),
    "axes swapped": (
        "",
        {'x_m = "POSE.POS_X"': 'x_m = "POSE.POS_Y"', 'y_m = "POSE.POS_Y"': 'y_m = "POSE.POS_X"'},
        [
            "POSE.POS_Y/POS_X moves by 2.4 m, +90° off the heading",
            "the path by POSE.POS_Y/POS_X turns right in a bend to the left: it is mirrored",
        ],
    ),
    "gears exchanged": (
        "",
        {"[status.gears]": '[status.gears]\nDRIVE = "REVERSE"\nREVERSE = "DRIVE"'},
        [
            "VEHICLE_STATUS.GEAR is DRIVE when it is in reverse: a name of its table means another one",
            "VEHICLE_STATUS.GEAR is REVERSE when it is in drive: a name of its table means another one",
        ],
    ),
    "modes exchanged": (
        "",
        {"[status.modes] ": '[status.modes]\nMANUAL = "READY"\nREADY = "MANUAL" '},
        ["VEHICLE_STATUS.MODE is MANUAL when it is handed over: a name of its table means another one"],
    ),
    "brake inverted": (
        '[status.driver]\nbrake = { not = "VEHICLE_STATUS.DRIVER_BRAKE" }',
        {BRAKE: ""},
        ["VEHICLE_STATUS.DRIVER_BRAKE is cleared when the brake is pressed: it is inverted"],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_profile_is_described_in_plain_text(tmp_path: Path, name: str) -> None:
    more, edits, expected = WRONG[name]
    found = walk(tmp_path, write_profile(tmp_path, more, edits))
    texts = of_walk(found)
    assert len(texts) == len(expected), texts
    for text in expected:
        assert any(one.startswith(text) for one in texts), texts
    assert not found.is_sound


def test_a_profile_that_is_mirrored_as_a_whole_contradicts_no_drive_but_the_person(tmp_path: Path) -> None:
    found = walk(tmp_path, write_profile(tmp_path, MIRRORED))
    assert found.review is not None
    assert found.review.contradictions == []
    assert of_walk(found) == [
        f"{WHEEL} falls when the wheel is turned left: its sign is reversed",
        f"{WHEEL} rises when the wheel is turned right: its sign is reversed",
        f"{YAW} turns right in a bend to the left: its sign is reversed",
        f"{HEADING} turns right in a bend to the left: it is clockwise, like a compass",
        f"the path by {POSITION} turns right in a bend to the left: it is mirrored, "
        "x and y are swapped or one is reversed",
    ]
    assert describe(found) == "5 contradictions between profile and vehicle"


@pytest.mark.parametrize(("more", "count"), [("", 0), (MIRRORED, 5)])
@pytest.mark.parametrize("seed", [0, 1])
def test_noise_of_poor_sensors_changes_no_verdict_of_the_walk(tmp_path: Path, seed: int, more: str, count: int) -> None:
    vehicle = simulated_vehicle(reference(), start_ns=START_NS, mode=VehicleMode.MANUAL)
    rewriter = Rewriter(disturbance(np.random.default_rng(seed), times=3.0))
    found = walk_with(vehicle, Person(vehicle), tmp_path, write_profile(tmp_path, more), rewriter=rewriter)
    assert len(of_walk(found)) == count
    assert found.unseen == []


def test_a_contradiction_in_the_log_counts_although_every_step_was_seen(tmp_path: Path) -> None:
    found = walk(tmp_path, write_profile(tmp_path, edits={"wheelbase_m = 2.7": "wheelbase_m = 2.0"}))
    assert of_walk(found) == []
    assert found.unseen == []
    assert not found.is_sound
    assert found.contradictions[0].startswith("wheelbase should be about 2.7 m, not 2 m")


def test_a_missing_step_is_named_with_the_values_that_were_seen(tmp_path: Path) -> None:
    found = walk(tmp_path, write_profile(tmp_path), lazy=frozenset(BEGINS), step_timeout_s=1.5)
    assert found.contradictions == []
    assert [step.ask for step in found.steps if step.judgement is Judgement.AGREES] == [
        "take hands off the wheel and feet off the pedals",
        "let the driver drive: mode MANUAL",
    ]
    lines = list(summarize(found))
    assert f"not seen: turn the wheel left and hold it there: {WHEEL} moved by 0 rad at most" in lines[0]
    assert any("VEHICLE_STATUS.DRIVER_BRAKE was clear all the time, also when the brake is pressed" in x for x in lines)
    assert any("VEHICLE_STATUS.GEAR is PARK" in line for line in lines)
    assert any("MOTION.SPEED adds up to +0.00 m, at least 1 m were needed" in line for line in lines)
    assert lines[-1] == "10 of 12 steps not seen; nothing contradicts the profile"


def test_a_message_that_never_comes_is_named_by_its_signals(tmp_path: Path) -> None:
    vehicle = simulated_vehicle(reference(), start_ns=START_NS, mode=VehicleMode.MANUAL)
    for name in ("CHASSIS", "VEHICLE_STATUS"):
        assert execute(vehicle, f"mute {name} on") == "ok"
    found = walk_with(vehicle, Person(vehicle), tmp_path, write_profile(tmp_path), step_timeout_s=3.0)
    texts = [one.text for step in found.unseen for one in step.results]
    assert f"no value of {WHEEL} came" in texts
    assert f"no value of {ACCEL} came together with the speed" in texts
    assert "no status came that the loop accepts" in texts


def test_a_bus_without_the_vehicle_ends_in_a_report_without_a_log(tmp_path: Path) -> None:
    vehicle = simulated_vehicle(reference(), start_ns=START_NS)
    assert execute(vehicle, "mute ALL on") == "ok"
    found = walk_with(vehicle, Person(vehicle), tmp_path, write_profile(tmp_path), step_timeout_s=0.5)
    assert describe(found) == "no frame of the profile's messages came: nothing was seen"
    assert (found.log_name, found.review, found.is_sound) == ("", None, False)
    assert not (tmp_path / "walk.log").exists()


def test_a_step_can_be_skipped_and_the_walk_be_ended(tmp_path: Path) -> None:
    vehicle = simulated_vehicle(reference(), start_ns=START_NS, mode=VehicleMode.MANUAL)
    person = Person(vehicle)
    calls: list[int] = []

    def skips() -> bool:
        calls.append(1)
        return len(calls) == 1

    def ends() -> bool:
        return "gear REVERSE" in person.shown

    person.skips, person.ends = skips, ends
    found = walk_with(vehicle, person, tmp_path, write_profile(tmp_path))
    skipped = [number for number, step in enumerate(found.steps) if step.was_skipped]
    assert skipped[0] == 0
    assert skipped[-1] == len(found.steps) - 1
    assert found.steps[1].judgement is Judgement.AGREES
    assert not found.is_sound


def test_only_what_the_profile_binds_is_asked_for(tmp_path: Path) -> None:
    assert step_keys("reference") == list(BEGINS)
    plain = ["rest", "brake", "mode_manual", "roll", "bend", "mode_ready"]
    assert step_keys(write_vehicle(tmp_path)) == plain


def test_a_vehicle_whose_driver_overrides_by_conditions_is_asked_to_do_that(tmp_path: Path) -> None:
    more = (
        '[status.driver]\nsteering = { signal = "VEHICLE_STATUS.DRIVER_STEER_TORQUE", above = 3.0, magnitude = true }\n'
    )
    found = walk(tmp_path, write_profile(tmp_path, more))
    assert found.is_sound
    texts = [one.text for one in found.steps[1].results]
    assert texts[-1] == "VEHICLE_STATUS.DRIVER_STEER_TORQUE is set when the wheel is turned left"


@pytest.mark.parametrize("name", profile_names())
def test_there_is_a_walk_for_each_profile_of_the_package(name: str) -> None:
    assert {"roll"} <= set(step_keys(name))
