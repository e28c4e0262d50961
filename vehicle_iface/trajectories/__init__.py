"""Sources of trajectories: CSV files, built-in routes, and a receding horizon over a route.

load_csv ─▶ drop_backward_steps ─▶ FixedTrajectory ─┐
                                                    ├─▶ TrajectorySource ─▶ the loop
make_route ─▶ Route ─▶ RecedingRoute ───────────────┘
"""

from vehicle_iface.trajectories.cleaning import CleanedTrajectory, drop_backward_steps
from vehicle_iface.trajectories.csv_file import load_csv, save_csv
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.route import Route, RouteConfig
from vehicle_iface.trajectories.shapes import ROUTES, make_route
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource

__all__ = [
    "ROUTES",
    "CleanedTrajectory",
    "FixedTrajectory",
    "RecedingRoute",
    "Route",
    "RouteConfig",
    "TrajectorySource",
    "drop_backward_steps",
    "load_csv",
    "make_route",
    "save_csv",
]
