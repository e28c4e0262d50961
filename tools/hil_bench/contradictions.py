"""Whether the fields of a vehicle's state contradict one another by more than its profile's tolerances.

The comparisons are those of FAILURES.md (S3, S4, S7, X1), so that a device must see at least what is found here.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from vehicle_bus_contract.reference import S

from hil_bench.vehicle import Instant
from hil_bench.wire import Wire

OPPONENTS: Mapping[str, frozenset[str]] = {
    "POS_X": frozenset({"SPEED"}),
    "POS_Y": frozenset({"SPEED"}),
    "HEADING": frozenset({"POS_X", "YAW_RATE"}),
    "SPEED": frozenset({"POS_X", "ACCEL"}),
    "ACCEL": frozenset({"SPEED"}),
    "YAW_RATE": frozenset({"HEADING", "FRONT_WHEEL_ANGLE"}),
    "LATERAL_SPEED": frozenset({"POS_X"}),
    "FRONT_WHEEL_ANGLE": frozenset({"YAW_RATE"}),
    "REAR_WHEEL_ANGLE": frozenset({"YAW_RATE"}),
}
"""The fields that are numbers, and what can contradict each."""
PLACED = frozenset({"POS_X", "POS_Y", "HEADING"})
CLEAR = 1.25
"""A contradiction must be greater than the tolerances by this factor before a reaction is required."""
WINDOWS_S = (0.5, 2.0)
SPEED_DRIFT_MPS, SPEED_SHARE, SLIP_SHARE = 0.05, 0.03, 0.06
ACCEL_DRIFT_MPS2 = 0.7
YAW_RATE_DRIFT_RADPS, YAW_RATE_SHARE = 0.03, 0.05
WHEEL_NOISE_RAD, WHEEL_OFFSET_RAD, UNDERSTEER_SHARE = 0.05, 0.03, 0.3

Told = Mapping[str, float]
"""The fields of one sample by the reference vehicle's names, SI."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances:
    """What the fields of a vehicle may differ by."""

    position_m: float
    speed_mps: float
    heading_rad: float
    yaw_rate_radps: float
    frozen_s: float
    frozen_above_mps: float
    wheelbase_m: float
    has: frozenset[str]
    """The fields that its bus has, dead reckoning left out."""

    @classmethod
    def of(cls, wire: Wire) -> "Tolerances":
        """Of a vehicle's profile."""
        stated = wire.profile["plausibility"]
        has = frozenset(name for name in OPPONENTS if wire.has(name))
        return cls(
            position_m=float(stated["position_tolerance_m"]),
            speed_mps=float(stated["speed_tolerance_mps"]),
            heading_rad=float(stated["heading_tolerance_rad"]),
            yaw_rate_radps=float(stated["yaw_rate_tolerance_radps"]),
            frozen_s=float(stated["frozen_time_s"]),
            frozen_above_mps=float(stated["frozen_min_speed_mps"]),
            wheelbase_m=float(wire.profile["geometry"]["wheelbase_m"]),
            has=has - PLACED if wire.loses_its_place else has,
        )

    def is_compared(self, name: str) -> bool:
        """Whether another field of this vehicle can contradict this one."""
        return name in self.has and bool(OPPONENTS[name] & self.has)


def tell_truth(instant: Instant, wheelbase_m: float) -> dict[str, float]:
    """What sound sensors of the bench's vehicle say."""
    return dict.fromkeys(OPPONENTS, 0.0) | {
        "POS_X": instant.x_m,
        "POS_Y": instant.y_m,
        "HEADING": instant.heading_rad,
        "SPEED": instant.speed_mps,
        "ACCEL": instant.accel_mps2,
        "YAW_RATE": instant.speed_mps * math.tan(instant.wheel_rad) / wheelbase_m,
        "LATERAL_SPEED": instant.drift_mps,
        "FRONT_WHEEL_ANGLE": instant.wheel_rad,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _Apart:
    """By how much two sources differ since the first sample, and the way and the turn until then."""

    forward_m: float = 0.0
    sideways_m: float = 0.0
    speed_mps: float = 0.0
    heading_rad: float = 0.0
    wheels_rad: float = 0.0
    way_m: float = 0.0
    turn_rad: float = 0.0


def find_contradiction(samples: Sequence[tuple[int, Told]], may: Tolerances, from_ns: int) -> tuple[int, str]:
    """When samples (stamp, ns; fields) first contradict one another from an instant on, and what does; 0 if never."""
    sums = [_Apart()]
    stood_s = 0.0
    for number, ((before_ns, before), (at_ns, told)) in enumerate(pairwise(samples), 1):
        dt_s = (at_ns - before_ns) / S
        sums.append(_add(sums[-1], before, told, dt_s, may))
        if at_ns < from_ns:
            continue
        is_frozen = all(before[name] == told[name] for name in ("POS_X", "POS_Y"))
        stood_s = stood_s + dt_s if is_frozen and abs(told["SPEED"]) > CLEAR * may.frozen_above_mps else 0.0
        if "POS_X" in may.has and stood_s > CLEAR * may.frozen_s:
            return at_ns, "a position that stands, and a speed"
        apart_radps = abs(told["YAW_RATE"] - _by_wheels_radps(told, may))
        if {"YAW_RATE", "FRONT_WHEEL_ANGLE"} <= may.has and apart_radps > CLEAR * may.yaw_rate_radps:
            return at_ns, "yaw rate and wheels"
        for window_s in WINDOWS_S:
            first = next(i for i in range(number + 1) if samples[i][0] >= at_ns - round(window_s * S))
            what = next(_exceeded(sums[first], sums[-1], (at_ns - samples[first][0]) / S, may), "")
            if what:
                return at_ns, what
    return 0, ""


def _by_wheels_radps(told: Told, may: Tolerances) -> float:
    front, rear = math.tan(told["FRONT_WHEEL_ANGLE"]), math.tan(told["REAR_WHEEL_ANGLE"])
    return told["SPEED"] * (front - rear) / may.wheelbase_m


def _add(since: _Apart, before: Told, told: Told, dt_s: float, may: Tolerances) -> _Apart:
    def over_time(name: str) -> float:
        return 0.5 * dt_s * (before[name] + told[name])

    turned_rad = math.remainder(told["HEADING"] - before["HEADING"], math.tau)
    cosine, sine = (f(before["HEADING"] + 0.5 * turned_rad) for f in (math.cos, math.sin))
    dx_m, dy_m = told["POS_X"] - before["POS_X"], told["POS_Y"] - before["POS_Y"]
    wheels_rad = 0.5 * dt_s * (_by_wheels_radps(before, may) + _by_wheels_radps(told, may))
    yawed_rad = over_time("YAW_RATE") if "YAW_RATE" in may.has else wheels_rad
    sideways_m = over_time("LATERAL_SPEED") if "LATERAL_SPEED" in may.has else 0.0
    return _Apart(
        forward_m=since.forward_m + dx_m * cosine + dy_m * sine - over_time("SPEED"),
        sideways_m=since.sideways_m + dy_m * cosine - dx_m * sine - sideways_m,
        speed_mps=since.speed_mps + told["SPEED"] - before["SPEED"] - over_time("ACCEL"),
        heading_rad=since.heading_rad + turned_rad - yawed_rad,
        wheels_rad=since.wheels_rad + yawed_rad - wheels_rad,
        way_m=since.way_m + abs(over_time("SPEED")),
        turn_rad=since.turn_rad + abs(yawed_rad),
    )


def _exceeded(since: _Apart, now: _Apart, window_s: float, may: Tolerances) -> Iterator[str]:
    """The pairs that differ clearly by more than their tolerances."""
    way_m, turn_rad = now.way_m - since.way_m, now.turn_rad - since.turn_rad
    by_wheels_rad = WHEEL_NOISE_RAD + WHEEL_OFFSET_RAD * way_m / may.wheelbase_m + UNDERSTEER_SHARE * turn_rad
    by_heading_rad = may.heading_rad + YAW_RATE_DRIFT_RADPS * window_s + YAW_RATE_SHARE * turn_rad
    if "YAW_RATE" not in may.has:
        by_heading_rad += by_wheels_rad
    compared = (
        (
            {"POS_X", "SPEED"}, "position and speed", now.forward_m - since.forward_m,
            may.position_m + SPEED_DRIFT_MPS * window_s + SPEED_SHARE * way_m,
        ),
        (
            {"POS_X", "HEADING"}, "position and heading", now.sideways_m - since.sideways_m,
            may.position_m + SLIP_SHARE * way_m,
        ),
        (
            {"SPEED", "ACCEL"}, "speed and acceleration", now.speed_mps - since.speed_mps,
            may.speed_mps + ACCEL_DRIFT_MPS2 * window_s,
        ),
        ({"HEADING"}, "heading and yaw rate", now.heading_rad - since.heading_rad, by_heading_rad),
        ({"YAW_RATE", "FRONT_WHEEL_ANGLE"}, "yaw rate and wheels", now.wheels_rad - since.wheels_rad, by_wheels_rad),
    )  # fmt: skip
    for needs, what, apart, tolerance in compared:
        if needs <= may.has and abs(apart) > CLEAR * tolerance:
            yield what
