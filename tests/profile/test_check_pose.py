"""`[state.pose]` and the signals that it needs are checked together when the profile is loaded."""

from collections.abc import Callable
from pathlib import Path

import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.motion_sources import has_second_speed
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.profile.state_pose import Mount, StatePose

from .conftest import REFERENCE

Load = Callable[..., Profile]
POSITION = ("x_m", "y_m")
GEOGRAPHIC = ('latitude_deg = "POSE.POS_Y"', 'longitude_deg = "POSE.POS_X"')
FRAMES = '\n[state.frames]                 # names in the DBC = frames of reference\nODOM = "odom"\nMAP = "map"\n'


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Load the reference profile with a `[state.pose]`, some signals of the state left out, and others added."""

    def load_with(
        pose: str, *, without: tuple[str, ...] = (), signals: tuple[str, ...] = (), state: str = ""
    ) -> Profile:
        rows = REFERENCE.replace(FRAMES, "").splitlines()
        start, end = rows.index("[state.signals]"), rows.index("[status.signals]")
        kept = [row for row in rows[start + 1 : end] if row.partition(" = ")[0] not in without]
        head = [*rows[:start], state, "[state.pose]", pose, "[state.signals]", *signals]
        path = tmp_path / "car.toml"
        path.write_text("\n".join([*head, *kept, *rows[end:]]), encoding="utf-8")
        return load_profile(path)

    return load_with


def faults(load: Callable[[], object]) -> list[str]:
    """What the refusal says, without the file's name."""
    with pytest.raises(ConfigError) as refused:
        load()
    return [line.removeprefix("car.toml: ") for line in str(refused.value).splitlines()]


def test_without_the_table_the_position_is_local() -> None:
    pose = load_profile("reference").state.pose
    assert pose == StatePose(source="local", origin=None, mount=Mount(x_m=0.0, y_m=0.0, heading_rad=0.0))


@pytest.mark.parametrize("origin", ["", 'origin = "first"', "origin = [52.0601, 5.1102]", "origin = [-33, 151]"])
def test_a_geographic_position_is_taken_with_any_origin(load: Load, origin: str) -> None:
    profile = load(f'source = "geographic"\n{origin}', without=(*POSITION, "pose_frame"), signals=GEOGRAPHIC)
    assert profile.state.signals.x_m is None
    assert profile.state.frame_id == "map"


@pytest.mark.parametrize("turning", ["yaw_rate_radps", "front_wheel_angle_rad"])
@pytest.mark.parametrize("state", ["", 'frame_id = "odom"'])
def test_odometry_needs_speed_and_one_thing_that_turns(load: Load, turning: str, state: str) -> None:
    profile = load('source = "odometry"', without=(*POSITION, "heading_rad", "pose_frame", turning), state=state)
    assert profile.state.signals.heading_rad is None
    assert profile.state.frame_id == "odom"


def test_odometry_confirms_no_speed(load: Load) -> None:
    without = (*POSITION, "heading_rad", "pose_frame", "accel_mps2")
    assert not has_second_speed(load('source = "odometry"', without=without))


def test_a_mount_on_the_vehicle_is_taken(load: Load) -> None:
    mount = load("mount = { x_m = -0.9, y_m = 1, heading_rad = 3.14 }").state.pose.mount
    assert mount == Mount(x_m=-0.9, y_m=1.0, heading_rad=3.14)
    assert load("mount = { x_m = 1.2 }").state.pose.mount == Mount(x_m=1.2)


@pytest.mark.parametrize(
    ("pose", "texts"),
    [
        ('source = "gps"', ["$.state.pose.source: Invalid enum value 'gps'"]),
        ("source = 3", ["$.state.pose.source: Expected str, got int"]),
        ("sorce = 'local'", ["$.state.pose.sorce: unknown key; did you mean 'source'?"]),
        ("mount = { x = 1.0 }", ["$.state.pose.mount.x: unknown key; must be one of: x_m, y_m, heading_rad"]),
        ("mount = { x_m = nan }", ["$.state.pose.mount.x_m: nan: must be finite"]),
        ("mount = { x_m = 120.0 }", ["$.state.pose.mount.x_m: 120.0: must be within ±$.geometry.length_m = 4.6"]),
        ("mount = { y_m = -4.7 }", ["$.state.pose.mount.y_m: -4.7: must be within"]),
        ("mount = { heading_rad = 90 }", ["$.state.pose.mount.heading_rad: 90.0: must be in rad, within ±π"]),
        ('origin = "first"', ['$.state.pose.origin: only with source = "geographic", and it is "local"; remove it']),
        (
            'source = "geographic"\norigin = [52.0, 5.0]',
            [
                '$.state.signals: latitude_deg is missing; $.state.pose.source = "geographic" needs it',
                '$.state.signals: longitude_deg is missing; $.state.pose.source = "geographic" needs it',
                '$.state.signals.x_m: POSE.POS_X: not used with source = "geographic"; remove it, or set '
                '$.state.pose.source to "local"',
                "$.state.signals.y_m: POSE.POS_Y: not used",
                "$.state.signals.pose_frame: POSE.POSE_FRAME: not used",
            ],
        ),
        (
            'source = "odometry"\norigin = "first"\nmount = { x_m = 1.0 }',
            [
                "$.state.signals.x_m: POSE.POS_X: not used",
                "$.state.signals.y_m: POSE.POS_Y: not used",
                '$.state.signals.heading_rad: MOTION.HEADING: not used with source = "odometry"; remove it, or set '
                '$.state.pose.source to "local" or "geographic"',
                "$.state.signals.pose_frame: POSE.POSE_FRAME: not used",
                '$.state.pose.mount: not used with source = "odometry", which has no position sensor; remove it',
                '$.state.pose.origin: only with source = "geographic", and it is "odometry"; remove it',
            ],
        ),
    ],
)
def test_a_fault_of_the_table_is_refused_with_its_place(load: Load, pose: str, texts: list[str]) -> None:
    found = faults(lambda: load(pose))
    assert [fault[: len(text)] for text, fault in zip(texts, found, strict=True)] == texts


@pytest.mark.parametrize(
    ("origin", "texts"),
    [
        ('"frist"', ["""'frist': must be [latitude, longitude] in degrees, or "first\""""]),
        ("[90.0, 5.0]", ["latitude 90.0: must be within ±89; latitude is the first of the two"]),
        ("[120.5, 181.0]", ["latitude 120.5: must be within", "longitude 181.0: must be within ±180"]),
    ],
)
def test_an_origin_must_be_on_the_earth(load: Load, origin: str, texts: list[str]) -> None:
    pose = f'source = "geographic"\norigin = {origin}'
    found = faults(lambda: load(pose, without=(*POSITION, "pose_frame"), signals=GEOGRAPHIC))
    places = [f"$.state.pose.origin: {text}" for text in texts]
    assert [fault[: len(place)] for place, fault in zip(places, found, strict=True)] == places


@pytest.mark.parametrize("origin", ["[52.0]", "52.0", '["52.0", "5.0"]', "[52.0, 5.0, 0.0]"])
def test_an_origin_is_two_numbers(load: Load, origin: str) -> None:
    pose = f'source = "geographic"\norigin = {origin}'
    found = faults(lambda: load(pose, without=(*POSITION, "pose_frame"), signals=GEOGRAPHIC))
    assert [fault.partition(": ")[0].partition("[")[0] for fault in found] == ["$.state.pose.origin"]


def test_every_signal_of_a_local_position_is_missed_at_once_and_the_way_on_is_named(load: Load) -> None:
    found = faults(lambda: load("", without=(*POSITION, "heading_rad")))
    assert [fault.partition(";")[0] for fault in found] == [
        f"$.state.signals: {field} is missing" for field in ("x_m", "y_m", "heading_rad")
    ]
    assert all("$.state.pose.source" in fault for fault in found)


def test_a_misspelt_signal_is_one_fault(load: Load) -> None:
    found = faults(lambda: load("", without=("heading_rad",), signals=('heading_rd = "MOTION.HEADING"',)))
    assert found == ["$.state.signals.heading_rd: unknown key; did you mean 'heading_rad'?"]


def test_latitude_and_longitude_are_not_for_a_local_position(load: Load) -> None:
    found = faults(lambda: load("", signals=('latitude_deg = "POSE.POS_Y"',)))
    assert len(found) == 1
    assert found[0].startswith("$.state.signals.latitude_deg: POSE.POS_Y: not used with source =")
    assert found[0].endswith('set $.state.pose.source to "geographic"')


def test_odometry_without_anything_that_turns_or_in_another_frame_is_refused(load: Load) -> None:
    without = (*POSITION, "heading_rad", "pose_frame", "yaw_rate_radps", "front_wheel_angle_rad")
    assert faults(lambda: load('source = "odometry"', without=without, state='frame_id = "map"')) == [
        '$.state.signals: source = "odometry" needs yaw_rate_radps or front_wheel_angle_rad, and neither is bound',
        '$.state.frame_id: \'map\': must be "odom" with source = "odometry"; remove it',
    ]
