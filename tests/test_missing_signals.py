"""What a vehicle does not measure is unknown, and not 0: nothing is compared with it."""

import msgspec
import pytest

from tests.harness import Drive, reference
from vehicle_iface import VehicleState
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import make_route


def without(*names: str) -> VehicleDatabase:
    """The reference vehicle, but its profile binds no such signals; what it sends of them is not looked at."""
    profile = reference().profile
    signals = msgspec.structs.replace(profile.state.signals, **dict.fromkeys(names))
    return load_database(
        msgspec.structs.replace(profile, state=msgspec.structs.replace(profile.state, signals=signals))
    )


@pytest.mark.parametrize(
    "names",
    [("front_wheel_angle_rad",), ("yaw_rate_radps",), ("front_wheel_angle_rad", "yaw_rate_radps"), ("accel_mps2",)],
    ids=" ".join,
)
def test_a_vehicle_without_wheel_angle_or_yaw_rate_is_driven_round_tight_curves(
    names: tuple[str, ...],
) -> None:
    drive = Drive(RecedingRoute(make_route("u_turn"), frame_id="map"), database=without(*names)).engage()
    drive.run_s(15.0)
    assert not any(drive.loop.details().implausible.values())
    assert max(abs(pair["FRONT_WHEEL_ANGLE_REQUEST"]) for pair in drive.pairs()) > 0.31


def test_the_rear_wheels_are_part_of_the_curvature() -> None:
    check = PlausibilityCheck(reference().profile.plausibility, wheelbase_m=2.7)
    crab = VehicleState(
        stamp_ns=0,
        x_m=0.0,
        y_m=0.0,
        heading_rad=0.0,
        speed_mps=10.0,
        front_wheel_angle_rad=0.3,
        rear_wheel_angle_rad=0.3,
    )
    assert check.is_plausible(crab, pose_valid=True)
