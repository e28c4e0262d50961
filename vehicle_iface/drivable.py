"""Trajectories that the vehicle can drive: a built route, or a file."""

import logging

from vehicle_iface.errors import BackwardStepError, ConfigError
from vehicle_iface.profile import Profile
from vehicle_iface.safety.feasibility import find_violation
from vehicle_iface.trajectories.cleaning import NOISE_M, CleanedTrajectory, drop_backward_steps
from vehicle_iface.trajectories.csv_file import line_of_point, load_csv
from vehicle_iface.trajectories.route import Route, RouteConfig
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.trajectory import Trajectory

log = logging.getLogger(__name__)


def build_route(name: str, profile: Profile) -> Route:
    """A route that the vehicle can drive; `ConfigError` when its wheels cannot turn so far."""
    geometry, limits, usual = profile.geometry, profile.limits, RouteConfig()
    route = make_route(
        name,
        RouteConfig(
            speed_mps=min(usual.speed_mps, limits.speed_max_mps),
            lateral_accel_mps2=min(usual.lateral_accel_mps2, limits.lateral_accel_mps2),
            accel_mps2=min(usual.accel_mps2, limits.accel_max_mps2),
            decel_mps2=min(usual.decel_mps2, -limits.accel_min_mps2),
            vehicle_width_m=geometry.width_m,
            wheelbase_m=geometry.wheelbase_m,
        ),
    )
    needed_rad = float(abs(route.front_wheel_angle_rad).max())
    if needed_rad > limits.front_wheel_angle_rad:
        raise ConfigError(
            f"route {name!r} needs front wheels at {needed_rad:.3f} rad: "
            f"{profile.name} allows {limits.front_wheel_angle_rad} rad"
        )
    text = find_violation(route.to_trajectory(), limits, geometry.wheelbase_m)
    if text:
        raise ConfigError(f"route {name!r}: {text}")
    return route


def load_trajectory(file: str, profile: Profile) -> Trajectory:
    """The CSV file's trajectory, cleaned of recording noise; what was changed is logged.

    Raises `ConfigError` when the vehicle cannot follow it, with the point and its line where a point does not lead on,
    and what `load_csv` raises.
    """
    trajectory = load_csv(file)
    _require_feasible(file, trajectory, profile)  # first as it is written, so that points have the file's numbers
    try:
        cleaned = drop_backward_steps(trajectory)
    except BackwardStepError as error:
        raise ConfigError(f"{file}, line {line_of_point(file, error.point)}: {error}") from error
    if cleaned.trajectory is not trajectory:
        _require_feasible(file, cleaned.trajectory, profile)
        log.warning("%s", _cleaning_report(file, cleaned, len(trajectory)))
    return cleaned.trajectory


def _require_feasible(file: str, trajectory: Trajectory, profile: Profile) -> None:
    text = find_violation(trajectory, profile.limits, profile.geometry.wheelbase_m)
    if text:
        raise ConfigError(f"{file}: {text}")


def _cleaning_report(file: str, cleaned: CleanedTrajectory, count: int) -> str:
    """How many of a file's `count` points were changed, and the first of them."""
    dropped, moved = cleaned.dropped.tolist(), cleaned.moved.tolist()
    first = min(dropped + moved)
    return (
        f"{file}: {len(dropped)} of {count} points left out and {len(moved)} moved to the place of the point before: "
        f"they lie within {NOISE_M} m of it and not ahead of it, which is taken for noise; "
        f"the first is point {first}, line {line_of_point(file, first)}"
    )
