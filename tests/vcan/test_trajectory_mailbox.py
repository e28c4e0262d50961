"""Trajectories that another process posts while the vehicle drives: bad ones, unwanted ones, huge ones, and many."""

import signal
from itertools import pairwise

import pytest
from vehicle_bus_contract.judge import lateral_errors_m

from vehicle_iface.trajectories.shapes import make_route

from .conftest import ROOT, Programs
from .driving import driven, own_faults, summary
from .observer import Observer, decided
from .peer import Vehicle

POSTER = str(ROOT / "tests" / "vcan" / "poster.py")
PICKY = """
from vehicle_iface.control.pure_pursuit import PurePursuit, PurePursuitConfig


class Picky(PurePursuit):
    def __init__(self, behavior):
        super().__init__(PurePursuitConfig(wheelbase_m=2.7), behavior=behavior)

    def check_new_trajectory(self, trajectory):
        return len(trajectory) != 7

    def handle_new_trajectory(self, trajectory):
        return trajectory if len(trajectory) != 8 else 1 / 0
"""
REFUSED_READING = [
    r"mailbox trajectory rejected: .*: x_m\[7\] = nan: must be a finite number",
    r"mailbox trajectory rejected: .*: speed_mps\[7\] = inf: must be a finite number",
    r"mailbox trajectory rejected: .*: time_from_start_ns\[7\] = 0: must not be below \[6\]",
    r"mailbox trajectory rejected: .* bytes do not hold 40 points",
    r"mailbox trajectory rejected: .*: not a mailbox trajectory, or damaged",
    r"mailbox trajectory rejected: .*: a mailbox takes at most 20000 points",
]
REFUSED_TAKING = [
    r"trajectory rejected, .*: speed_mps\[7\] = 20.5: must be in \[-20.0, 20.0\]",
    r"trajectory rejected, .*: front_wheel_angle_rad\[7\] = -0.61: must be in \[-0.6, 0.6\]",
    r"trajectory rejected, .*: the path turns by .* rad/m at point \d+: must be at most",
    r"trajectory rejected, .*: point 20 lies 0.005 m behind point 19 in the direction of travel, .*drop_backward_steps",
]
TAKEN_REFUSED = len(REFUSED_TAKING) + 2
"""And those two that the controller refuses."""
LONG = 1000
"""An index that no other trajectory here has."""
HAIRPIN_RAD = 2.5
BESIDE_M = 0.3


@pytest.mark.usefixtures("vehicle")
def test_a_bad_or_unwanted_trajectory_changes_nothing_and_a_long_one_is_driven(
    programs: Programs, bus: Observer
) -> None:
    file, picky = str(programs.folder / "posted"), programs.folder / "picky.py"
    picky.write_text(PICKY)
    programs.start_python(POSTER, file, "line", "300", "100", name="poster")
    loop, moving = driven(programs, bus, "--trajectory-mailbox", file, "--controller", f"{picky}:Picky")
    poster = programs.start_python(POSTER, file, "bad", name="poster")
    assert poster.wait_for_end() == 0
    for line in (*REFUSED_READING, *REFUSED_TAKING):
        loop.wait_for_line(line)
    loop.wait_for_line("ZeroDivisionError")
    bad = bus.wait_samples(30)
    record = bus.record(moving, bad)
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    indices = [decoded["REF_SPATIAL_INDEX"] for decoded in record.of("CONTROLLER_STATUS")]
    assert all(before <= after for before, after in pairwise(indices))
    assert programs.start_python(POSTER, file, "long", name="poster").wait_for_end() == 0
    is_far = lambda decoded: decoded.name == "CONTROLLER_STATUS" and decoded["REF_SPATIAL_INDEX"] > LONG  # noqa: E731
    far, _ = bus.wait_until("an index in a long trajectory", is_far, since=bad)
    assert decided(bus.record(bad, bus.wait_samples(10, since=far))) == ["NOMINAL"]
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    counts = summary(programs)["counts"]
    assert counts["trajectories_rejected"] == TAKEN_REFUSED
    assert counts["trajectories"] >= 2


def test_a_hairpin_republished_at_10_hz_is_driven_without_a_late_command(programs: Programs, bus: Observer) -> None:
    vehicle, route = Vehicle(x_m=14.0), make_route("u_turn")
    vehicle.start()
    try:
        file = str(programs.folder / "posted")
        programs.start_python(POSTER, file, "route", "u_turn", name="poster")
        loop, moving = driven(programs, bus, "--trajectory-mailbox", file)
        end, _ = bus.wait_until(
            "the way back", lambda decoded: decoded.name == "MOTION" and decoded["HEADING"] > HAIRPIN_RAD, since=moving
        )
        loop.send_signal(signal.SIGTERM)
        assert loop.wait_for_end() == 0
    finally:
        vehicle.close()
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert record.faults() == []
    assert max(lateral_errors_m(record.samples, route.x_m.tolist(), route.y_m.tolist())) < BESIDE_M
    found = summary(programs)
    assert found["counts"]["trajectories"] > 50
    assert found["counts"]["trajectories_rejected"] == 0
