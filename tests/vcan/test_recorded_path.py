"""A path that was recorded: its positions have noise in them, along the way and where the vehicle stood."""

import random
import signal
from pathlib import Path

import pytest

from .conftest import Programs
from .driving import driven, own_faults
from .observer import Observer, decided

STOOD_S, PERIOD_S, SPACING_M, SPEED_MPS = 1.5, 0.05, 0.5, 3.0
STEPS_BACK = (20, 30, 31)
"""Points on the way that lie 5 mm behind the one before."""
FAR = 40
"""A point behind all of them."""


def recorded_file(folder: Path) -> str:
    """A CSV trajectory along +x: standstill with 2 cm of noise, then 300 m with steps back."""
    dice, path = random.Random(3), folder / "recorded.csv"
    rows = [
        (i * PERIOD_S, dice.uniform(-0.02, 0.02), dice.uniform(-0.02, 0.02), 0.0)
        for i in range(round(STOOD_S / PERIOD_S))
    ]
    x_m = [i * SPACING_M for i in range(1, 600)]
    for i in STEPS_BACK:
        x_m[i] = x_m[i - 1] - 0.005
    rows += [(STOOD_S + 0.2 * i, each_m, 0.0, SPEED_MPS) for i, each_m in enumerate(x_m)]
    lines = (f"{time_s:.3f},{x:.4f},{y:.4f},0,{speed_mps}" for time_s, x, y, speed_mps in rows)
    path.write_text("time_s,x_m,y_m,heading_rad,speed_mps\n" + "\n".join(lines) + "\n")
    return str(path)


@pytest.mark.usefixtures("vehicle")
def test_a_recorded_file_with_backward_steps_is_cleaned_and_driven(programs: Programs, bus: Observer) -> None:
    loop, moving = driven(programs, bus, "--trajectory", recorded_file(programs.folder))
    loop.wait_for_line(r"recorded\.csv: 31 of 629 points left out and 1 moved .* the first is point 1, line 3")
    is_far = lambda decoded: decoded.name == "CONTROLLER_STATUS" and decoded["REF_SPATIAL_INDEX"] > FAR  # noqa: E731
    far, _ = bus.wait_until("the index behind the steps back", is_far, since=moving)
    record = bus.record(moving, bus.wait_samples(10, since=far))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
