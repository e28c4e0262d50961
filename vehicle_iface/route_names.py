"""The names of the built-in routes, which a command line shows without importing the routes."""

ROUTE_NAMES = (
    "line",
    "circle",
    "figure8",
    "slalom",
    "double_lane_change",
    "stop_and_go",
    "u_turn",
    "three_point_turn",
)
