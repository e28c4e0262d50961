"""Vehicles whose speed nothing confirms are reported, and are driven slower."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from vehicle_iface.codec.lint import check_file
from vehicle_iface.motion_sources import cap_unconfirmed_speed, describe_missing, has_second_speed, sources_of
from vehicle_iface.profile import Profile, load_profile

ROOT = Path(__file__).resolve().parents[1]


def profile(*, without: tuple[str, ...] = (), frames: dict[str, str] | None = None, **limits: float) -> Profile:
    """The reference vehicle's, with some fields of the state not bound, and other frames."""
    reference = load_profile("reference")
    state = reference.state
    signals = msgspec.structs.replace(state.signals, **dict.fromkeys(without))
    state = msgspec.structs.replace(state, signals=signals, frames=state.frames if frames is None else frames)
    return msgspec.structs.replace(
        reference,
        state=state,
        limits=msgspec.structs.replace(reference.limits, **limits) if limits else reference.limits,
    )


ODOM = {"ODOM": "odom"}


@pytest.mark.parametrize(
    ("without", "frames", "has", "said"),
    [
        ((), None, True, []),
        ((), ODOM, True, []),
        (("accel_mps2",), None, True, ["accel_mps2 is not bound: only the position reveals a wrong speed"]),
        (("accel_mps2",), ODOM, False, ["nothing confirms the speed signal"]),
        (("yaw_rate_radps",), None, True, []),
        (("front_wheel_angle_rad",), None, True, []),
        (("yaw_rate_radps", "front_wheel_angle_rad"), None, True, ["only the position reveals a wrong heading"]),
        (("lateral_speed_mps",), None, True, []),
    ],
)
def test_quantities_that_cannot_be_compared_are_reported(
    without: tuple[str, ...], frames: dict[str, str] | None, has: bool, said: list[str]
) -> None:
    vehicle = profile(without=without, frames=frames)
    assert has_second_speed(vehicle) is has
    texts = list(describe_missing(vehicle))
    assert [part in text for part, text in zip(said, texts, strict=True)] == [True] * len(said)


@pytest.mark.parametrize(
    ("field", "source"),
    [
        ("accel_mps2", "accel"),
        ("yaw_rate_radps", "yaw_rate"),
        ("lateral_speed_mps", "lateral_speed"),
        ("front_wheel_angle_rad", "front_wheels"),
    ],
)
def test_a_source_is_there_when_its_field_is_bound(field: str, source: str) -> None:
    assert getattr(sources_of(profile()), source)
    assert not getattr(sources_of(profile(without=(field,))), source)


@pytest.mark.parametrize(
    ("make", "speed_max_mps"),
    [
        (lambda: profile(), 20.0),
        (lambda: profile(without=("accel_mps2",), frames=ODOM), 3.0),
        (lambda: profile(without=("accel_mps2",), frames=ODOM, unconfirmed_speed_max_mps=5.0), 5.0),
        (lambda: profile(without=("accel_mps2",), frames=ODOM, speed_max_mps=2.0), 2.0),
    ],
)
def test_a_speed_that_nothing_confirms_is_capped(make: Callable[[], Profile], speed_max_mps: float) -> None:
    assert cap_unconfirmed_speed(make()).limits.speed_max_mps == speed_max_mps


def test_check_dbc_reports_it_at_the_profiles_line(tmp_path: Path) -> None:
    text = (ROOT / "dbc" / "reference.toml").read_text()
    text = text.replace('accel_mps2 = "CHASSIS.ACCEL"\n', "").replace('MAP = "map"', 'MAP = "odom"')
    text = text.replace("ignored = [] ", 'ignored = ["CHASSIS.ACCEL"] ')
    path = tmp_path / "rover.toml"
    path.write_text(text)
    (tmp_path / "reference.dbc").write_bytes((ROOT / "dbc" / "reference.dbc").read_bytes())
    found = [str(finding) for finding in check_file(path)]
    line = 1 + text.splitlines().index("[state.signals]")
    assert any(
        f"rover.toml:{line}: warning: $.state.signals: nothing confirms the speed signal" in one for one in found
    )
