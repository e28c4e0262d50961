"""No single sensor fault makes the vehicle run away: every signal, fault and situation, in virtual time."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from tests.harness import Drive, straight
from vehicle_iface import Reason, Trajectory
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.signal_faults import SignalFault, delayed, frozen, offset, scaled
from vehicle_iface.trajectories.source import FixedTrajectory

RUN_S = 8.0
OVERSPEED_MPS, OVERSPEED_S = 1.0, 1.0
LATERAL_STOP_M = 3.0
"""Of the profile: the vehicle may be driven so far off its path, and no farther."""
BRAKING_M = 6.0
"""What it may be off in the end: straight on while it brakes from 5 m/s in a bend of 12 m radius."""
ENDS = {Mode.HALTING, Mode.HALTED, Mode.SILENT, Mode.FAULT}

FAULTS: Mapping[str, Callable[[], SignalFault]] = {
    "frozen": frozen,
    "scaled by 0.3": lambda: scaled(0.3),
    "scaled by 0.7": lambda: scaled(0.7),
    "scaled by 1.5": lambda: scaled(1.5),
    "of the wrong sign": lambda: scaled(-1.0),
    "late by 0.3 s": lambda: delayed(30),
    "late by 1 s": lambda: delayed(100),
}
OFFSETS: Mapping[str, tuple[float, ...]] = {
    "x_m": (0.45, 2.0),
    "y_m": (0.45, -2.0),
    "heading_rad": (0.19, -1.0),
    "speed_mps": (-0.4, -2.0),
    "accel_mps2": (1.5, -5.0),
    "yaw_rate_radps": (0.2, -0.7),
    "lateral_speed_mps": (0.5, -2.0),
    "front_wheel_angle_rad": (0.1, -0.4),
    "rear_wheel_angle_rad": (0.05, -0.2),
}
"""A small one and a great one for each signal."""


def bend(speed_mps: float = 5.0, straight_m: float = 15.0, radius_m: float = 12.0) -> Trajectory:
    """Straight on, and then three quarters round to the left."""
    s_m = np.arange(0.0, straight_m + 1.5 * math.pi * radius_m, 0.25)
    turned_rad = np.maximum(0.0, s_m - straight_m) / radius_m
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.rint(np.linspace(0.0, 1000.0, len(s_m)) * 1e9).astype(np.int64),
        x_m=np.minimum(s_m, straight_m) + radius_m * np.sin(turned_rad),
        y_m=radius_m * (1.0 - np.cos(turned_rad)),
        heading_rad=np.remainder(turned_rad + math.pi, math.tau) - math.pi,
        speed_mps=np.full(len(s_m), speed_mps),
    )


def slowing_down() -> Trajectory:
    """From 8 m/s to 2 m/s, at 1.5 m/s²."""
    s_m = np.arange(0.0, 90.0, 0.5)
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.rint(np.linspace(0.0, 1000.0, len(s_m)) * 1e9).astype(np.int64),
        x_m=s_m,
        y_m=np.zeros(len(s_m)),
        heading_rad=np.zeros(len(s_m)),
        speed_mps=np.sqrt(np.clip(64.0 - 2.0 * 1.5 * (s_m - 35.0), 4.0, 64.0)),
    )


@dataclass(frozen=True)
class Situation:
    """When the fault begins."""

    trajectory: Callable[[], Trajectory]
    begins: Callable[[Drive], bool]


SITUATIONS: Mapping[str, Situation] = {
    "at standstill": Situation(bend, lambda drive: drive.now_s > 0.1),
    "starting": Situation(bend, lambda drive: drive.vehicle.state.speed_mps > 0.3),
    "driving straight": Situation(lambda: straight(300.0, 10.0, time_s=1e3), lambda d: d.vehicle.state.speed_mps > 9.0),
    "driving in a bend": Situation(bend, lambda drive: drive.vehicle.state.x_m > 20.0),
    "braking": Situation(slowing_down, lambda drive: drive.vehicle.state.x_m > 38.0),
    "reversing": Situation(lambda: straight(80.0, -4.0, time_s=1e3), lambda d: d.vehicle.state.speed_mps < -3.0),
}


def distance_m(path: Trajectory, x_m: float, y_m: float) -> float:
    """From the polyline through the points."""
    ax, ay = path.x_m[:-1] - x_m, path.y_m[:-1] - y_m
    bx, by = np.diff(path.x_m), np.diff(path.y_m)
    share = (-(ax * bx + ay * by) / (bx * bx + by * by)).clip(0.0, 1.0)
    ax += share * bx
    ay += share * by
    return math.sqrt((ax * ax + ay * ay).min())


def path_speed_mps(path: Trajectory, x_m: float, y_m: float) -> float:
    """The greatest without sign within a metre of this place."""
    near_m = np.hypot(path.x_m - x_m, path.y_m - y_m)
    return float(np.abs(path.speed_mps[near_m < near_m.min() + 1.0]).max())


def harm(situation: Situation, faults: Mapping[str, SignalFault]) -> list[str]:
    """What the vehicle truly did that it must not do; `faults` by field."""
    path = situation.trajectory()
    drive = Drive(FixedTrajectory(path))
    drive.run_until(lambda: situation.begins(drive), 20.0)
    drive.vehicle.signal_faults.update(faults)
    found, too_fast_s, until_s = [], 0.0, drive.now_s + RUN_S
    while drive.now_s < until_s:
        before_s = drive.now_s
        drive.step()
        truth, safe = drive.vehicle.state, drive.last_command()
        is_driven = safe is not None and safe.enable and not safe.safe_stop
        off_m = distance_m(path, truth.x_m, truth.y_m)
        is_too_fast = abs(truth.speed_mps) > path_speed_mps(path, truth.x_m, truth.y_m) + OVERSPEED_MPS
        too_fast_s = too_fast_s + drive.now_s - before_s if is_too_fast else 0.0
        if too_fast_s > OVERSPEED_S:
            found.append(f"{truth.speed_mps:.1f} m/s for {too_fast_s:.2f} s")
        if is_driven and off_m > LATERAL_STOP_M:
            found.append(f"driven {off_m:.1f} m off the path")
        if off_m > BRAKING_M:
            found.append(f"{off_m:.1f} m off the path")
        if found:
            return [f"{what}, {drive.mode().name}, {drive.loop.reason.name}" for what in found]
        if drive.mode() in ENDS and truth.speed_mps == 0.0:
            return []
    return []


@cache
def undisturbed_values(name: str) -> Mapping[str, Sequence[float]]:
    """Each signal's values from the moment at which a fault would begin; fails when this drive does harm."""
    values: dict[str, list[float]] = {field: [] for field in OFFSETS}

    def record(field: str) -> SignalFault:
        def note(value: float) -> float:
            values[field].append(value)
            return value

        return note

    assert harm(SITUATIONS[name], {field: record(field) for field in OFFSETS}) == []
    return values


def changes_anything(fault: SignalFault, values: Sequence[float]) -> bool:
    """Whether a drive with this fault is another one: no angle of a vehicle that goes straight on is late."""
    return any(fault(value) != value for value in values)


@pytest.mark.parametrize("field", OFFSETS)
@pytest.mark.parametrize("name", SITUATIONS)
def test_no_fault_of_a_signal_makes_the_vehicle_run_away_or_leave_its_path(name: str, field: str) -> None:
    """Every fault meets every signal and every situation, but only every third combination of the two is driven."""
    offsets = {f"off by {amount}": lambda amount=amount: offset(amount) for amount in OFFSETS[field]}
    if name == "at standstill" and field in ("x_m", "y_m"):
        del offsets[f"off by {OFFSETS[field][1]}"]  # where a vehicle truly stands at first, nothing else can tell
    values = undisturbed_values(name)[field]
    first = (list(SITUATIONS).index(name) + list(OFFSETS).index(field)) % 3
    third = dict(list(FAULTS.items())[first::3])
    faults = {what: make for what, make in {**third, **offsets}.items() if changes_anything(make(), values)}
    assert offsets.keys() <= faults.keys()
    harms = {what: harm(SITUATIONS[name], {field: make()}) for what, make in faults.items()}
    assert {what: found for what, found in harms.items() if found} == {}


@pytest.mark.parametrize(
    ("field", "fault"), [("speed_mps", scaled(0.3)), ("yaw_rate_radps", offset(0.2)), ("accel_mps2", offset(-5.0))]
)
def test_sources_that_agree_again_do_not_end_the_stop_before_a_new_arming(field: str, fault: SignalFault) -> None:
    drive = Drive(FixedTrajectory(straight(300.0, 5.0, time_s=1e3))).engage(0.3)
    drive.vehicle.signal_faults[field] = fault
    drive.run_until(lambda: drive.last()["SAFE_STOP"] == 1, 5.0)
    drive.run_until(lambda: drive.vehicle.state.speed_mps == 0.0, 5.0)
    del drive.vehicle.signal_faults[field]
    drive.run_s(5.0)
    assert (drive.mode(), drive.loop.reason) == (Mode.HALTED, Reason.STATE_INVALID)
    assert drive.vehicle.state.speed_mps == 0.0
    drive.loop.arming.request()
    drive.run_s(2.0)
    assert drive.mode() is Mode.ENGAGED
    assert drive.vehicle.state.speed_mps > 0.5


def test_the_judge_of_this_file_sees_a_vehicle_that_runs_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the comparison of sources switched off, a speed that reads 30 % of the truth makes the vehicle too fast."""
    monkeypatch.setattr("vehicle_iface.safety.motion.MotionCheck.update", lambda *_, **__: None)
    found = harm(SITUATIONS["at standstill"], {"speed_mps": scaled(0.3)})
    assert "m/s for" in found[0]
