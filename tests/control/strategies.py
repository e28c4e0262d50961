"""Trajectories and states that laws are tried on."""

import numpy as np
from hypothesis import strategies as st

from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory

coordinates = st.floats(-100.0, 100.0).map(lambda metres: round(metres, 6)) | st.integers(-5, 5).map(float)
"""Whole micrometres: what is nearer than a nanometre is the same place. Small whole numbers too, so that points
coincide and products are exactly 0."""
angles = st.floats(-4.0, 4.0)
speeds = st.floats(-30.0, 30.0)
stamps = st.integers(-3_000_000_000, 3_000_000_000)


@st.composite
def trajectories(draw: st.DrawFn, *, least: int = 0, greatest: int = 60) -> Trajectory:
    n = draw(st.integers(least, greatest))
    steps = draw(st.lists(st.integers(0, 200_000_000), min_size=n, max_size=n))

    def column(values: st.SearchStrategy[float]) -> list[float]:
        return draw(st.lists(values, min_size=n, max_size=n))

    return Trajectory(
        stamp_ns=draw(stamps),
        time_from_start_ns=np.cumsum(np.array(steps, dtype=np.int64)),
        x_m=np.array(column(coordinates)),
        y_m=np.array(column(coordinates)),
        heading_rad=np.array(column(angles)),
        speed_mps=np.array(column(speeds)),
    )


def states(frame_id: str = "map") -> st.SearchStrategy[VehicleState]:
    return st.builds(
        VehicleState,
        stamp_ns=stamps,
        frame_id=st.just(frame_id),
        x_m=coordinates,
        y_m=coordinates,
        heading_rad=angles,
        speed_mps=speeds,
        front_wheel_angle_rad=st.floats(-0.6, 0.6),
        rear_wheel_angle_rad=st.floats(-0.1, 0.1),
    )
