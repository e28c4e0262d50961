"""Values for tests of data: what is no number, and the fields of valid objects."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from vehicle_iface.errors import InvalidValueError

NOT_FINITE = [math.nan, math.inf, -math.inf]
NOT_NUMBERS = [None, "1.0", b"1", True, False, [], {}, object(), 1j]
STATE: dict[str, Any] = {"stamp_ns": 1, "x_m": 1.0, "y_m": 2.0, "heading_rad": 0.5, "speed_mps": 3.0}
COMMAND: dict[str, Any] = {"stamp_ns": 1, "accel_mps2": 1.0, "front_wheel_angle_rad": 0.1}
LINE: dict[str, Any] = {
    "stamp_ns": 5,
    "time_from_start_ns": [0, 10, 20],
    "x_m": [0.0, 1.0, 2.0],
    "y_m": [0.0, 0.0, 0.0],
    "heading_rad": [0.0, 0.0, 0.0],
    "speed_mps": [1.0, 1.0, 1.0],
}


def refusal(build: Callable[[], object]) -> str:
    """What the refusal says."""
    with pytest.raises(InvalidValueError) as caught:
        build()
    return str(caught.value)
