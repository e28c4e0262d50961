"""Every error of a profile is named by a simulated drive, and none is invented."""

from pathlib import Path

import pytest

from tests.review.drives import DBC_FOLDER, delay, note, record, record_noisily, review, review_profile, rewrite
from vehicle_iface.review.findings import Judgement, Level

HEADING, SPEED, YAW = "MOTION.HEADING", "MOTION.SPEED", "MOTION.YAW_RATE"
WHEEL, ACCEL = "CHASSIS.FRONT_WHEEL_ANGLE", "CHASSIS.ACCEL"
ERRORS = {
    "wheel sign": (note(WHEEL, "scale = -1.0"), [f"sign of {WHEEL} is reversed"]),
    "yaw sign": (note(YAW, "scale = -1.0"), [f"sign of {YAW} is reversed"]),
    "accel sign": (note(ACCEL, "scale = -1.0"), [f"sign of {ACCEL} is reversed"]),
    "speed sign": (note(SPEED, "scale = -1.0"), [f"sign of {SPEED} is reversed"]),
    "speed unit": (note(SPEED, 'unit = "km/h"'), [f"{SPEED} is in m/s, not in km/h"]),
    "speed mph": (note(SPEED, 'unit = "mph"'), [f"{SPEED} is in m/s, not in mph"]),
    "speed scale": (note(SPEED, "scale = 3.6"), [f"{SPEED} is in km/h, not in m/s"]),
    "wheel unit": (note(WHEEL, 'unit = "deg"'), [f"{WHEEL} is in rad, not in deg"]),
    "wheel degrees": (note(WHEEL, "scale = 57.3"), [f"{WHEEL} is in deg, not in rad"]),
    "yaw unit": (note(YAW, 'unit = "deg/s"'), [f"{YAW} is in rad/s, not in deg/s"]),
    "yaw degrees": (note(YAW, "scale = 57.3"), [f"{YAW} is in deg/s, not in rad/s"]),
    "heading unit": (note(HEADING, 'unit = "deg"'), [f"{HEADING} is in rad, not in deg"]),
    "accel g": (note(ACCEL, "scale = 0.102"), [f"{ACCEL} is in g, not in m/s^2"]),
    "compass": (note(HEADING, "scale = -1.0", "offset = 1.5708"), [f"{HEADING} is clockwise from north"]),
    "clockwise": (note(HEADING, "scale = -1.0"), [f"{HEADING} is clockwise"]),
    "heading from north": (note(HEADING, "offset = -1.5708"), [f"zero of {HEADING} is +90° off"]),
    "heading backwards": (note(HEADING, "offset = 3.1416"), [f"zero of {HEADING} is "]),
    "mirrored": (note("POSE.POS_Y", "scale = -1.0"), ["POSE.POS_X/POS_Y is mirrored: its y axis is reversed"]),
    "position unit": (
        note("POSE.POS_X", 'unit = "ft"') + "\n" + note("POSE.POS_Y", 'unit = "ft"'),
        ["POSE.POS_X/POS_Y is in m, not in ft"],
    ),
    "steering wheel": (note(WHEEL, "scale = 15.4"), ["steering ratio is about "]),
    "wheel and speed": (
        note(WHEEL, "scale = -1.0") + "\n" + note(SPEED, 'unit = "km/h"'),
        [f"sign of {WHEEL} is reversed", f"{SPEED} is in m/s, not in km/h"],
    ),
}
"""Lines that make the profile wrong, and the beginnings of what must be found, and nothing else."""


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_of_the_profile_is_named_and_nothing_else(tmp_path: Path, name: str) -> None:
    more, expected = ERRORS[name]
    found = [finding.text for finding in review(tmp_path, record_noisily("figure8"), more).contradictions]
    assert len(found) == len(expected), found
    for text in expected:
        assert any(one.startswith(text) for one in found), found


@pytest.mark.parametrize("route", ["figure8", "slalom", "circle", "three_point_turn", "stop_and_go"])
@pytest.mark.parametrize("is_noisy", [False, True])
def test_nothing_is_invented_about_a_sound_drive(tmp_path: Path, route: str, is_noisy: bool) -> None:
    frames = record_noisily(route, 11) if is_noisy else record(route)
    findings = review(tmp_path, frames).findings
    assert [finding.text for finding in findings if finding.level is not Level.NOTE] == []


@pytest.mark.parametrize(("stated_m", "factor"), [("3.1", 1.0), ("2.3", 1.0)])
def test_a_wrong_wheelbase_is_measured(tmp_path: Path, stated_m: str, factor: float) -> None:
    (found,) = review(tmp_path, record_noisily("figure8"), wheelbase_m=stated_m).contradictions
    assert found.text.startswith(f"wheelbase should be about 2.{7 * factor:.0f} m, not {stated_m} m")


@pytest.mark.parametrize("message", ["POSE", "MOTION", "CHASSIS"])
@pytest.mark.parametrize("delay_ms", [60, 200])
def test_a_late_message_is_named_with_its_delay(tmp_path: Path, message: str, delay_ms: int) -> None:
    frames = delay(record_noisily("figure8"), message, delay_ms)
    (found,) = review(tmp_path, frames).contradictions
    assert found.about == message
    measured_ms = float(found.text.partition(" is ")[2].partition(" ms")[0])
    assert measured_ms == pytest.approx(delay_ms, abs=20)


def drop_sign(values: dict[str, float]) -> None:
    if "speed_mps" in values:
        values["speed_mps"] = abs(values["speed_mps"])


def mix_up(values: dict[str, float]) -> None:
    if "speed_mps" in values:
        values["yaw_rate_radps"] = 0.2 * values["speed_mps"]


def test_swapped_axes_are_named_with_the_lines_that_exchange_them(tmp_path: Path) -> None:
    profile = (DBC_FOLDER / "reference.toml").read_text()
    for old, new in (("POS_X", "POS_Q"), ("POS_Y", "POS_X"), ("POS_Q", "POS_Y")):
        profile = profile.replace(f"POSE.{old}", f"POSE.{new}")
    (found,) = review_profile(tmp_path, record_noisily("figure8"), profile).contradictions
    assert found.text == "POSE.POS_Y/POS_X is mirrored: x and y are swapped"
    assert found.fix.splitlines()[1:] == ['x_m = "POSE.POS_X"', 'y_m = "POSE.POS_Y"']


def test_a_speed_without_a_sign_is_named_once_the_vehicle_reverses(tmp_path: Path) -> None:
    frames = rewrite(record_noisily("three_point_turn"), drop_sign)
    (found,) = review(tmp_path, frames).contradictions
    assert found.text == "MOTION.SPEED has no sign: it is positive while the vehicle drives backwards"


def test_a_field_bound_to_another_quantity_is_named(tmp_path: Path) -> None:
    frames = record_noisily("figure8")
    mixed = rewrite(frames, mix_up)
    found = review(tmp_path, mixed).contradictions
    assert {one.about for one in found} == {"MOTION.YAW_RATE"}
    assert found[0].text.startswith("heading rate does not follow yaw rate: MOTION.YAW_RATE is another quantity")


def test_signals_that_a_straight_drive_cannot_show_are_not_judged(tmp_path: Path) -> None:
    found = review(tmp_path, record_noisily("stop_and_go", 1), note(WHEEL, "scale = -1.0"))
    assert found.contradictions == []
    wheel = next(one for one in found.bindings if one.field == "front_wheel_angle_rad")
    assert wheel.judgement is Judgement.UNKNOWN
    assert "not enough turning to tell" in wheel.text


def test_a_correction_is_given_as_lines_of_the_profile(tmp_path: Path) -> None:
    (found,) = review(
        tmp_path, record_noisily("figure8"), note(HEADING, "scale = -1.0", "offset = 1.5708")
    ).contradictions
    header, scale, offset = found.fix.splitlines()
    assert (header, scale) == (f'[signals."{HEADING}"]', "scale = 1")
    assert float(offset.partition(" = ")[2]) == pytest.approx(0.0, abs=0.03)
