"""What a profile's periods, counts and limits change of the reference vehicle's times, tolerances and routes."""

import math
from collections.abc import Mapping
from typing import Any

from hil_bench.peer.command import CommandReader
from hil_bench.peer.layout import Layout
from hil_bench.peer.roles import Roles
from hil_bench.vocabulary import PERIOD_S, Wait

INFER_S = 0.15
"""A stop that is inferred shows within this time; one that is told shows at once."""
REFERENCE_TURN_M, USUAL_MPS, ACROSS_MPS2 = 3.95, 5.0, 3.0
"""Of the reference vehicle: smallest turning radius, speed of most routes, lateral acceleration."""
ALONG_SHARE, BRAKE_SHARE, SPEED_SHARE = 0.4, 0.35, 0.8
"""Of the limits, used by routes; the brake's is below what makes a command a stop."""
SHORTEST_SHARE = 0.2
UNCONFIRMED_MPS = 3.0
"""Speed limit of a vehicle whose speed nothing confirms, where its profile has no other."""
SPEED_BRAKE_MPS2 = 4.0
"""Of the vehicle's own speed controller."""
TOW_SHARE_PER_S = 0.25
"""Of the plausible speeds above the limit: what a tow's acceleration takes beyond the brake's in a second."""
MEASURED_SHARE = 0.8
"""Of what a signal can carry: above it, noise and an accelerating vehicle leave the range."""
PLAUSIBLE_SHARE = 0.6
"""Of the plausible acceleration: a slow message shows the speed in steps."""
TABLE_SHARE, FEEDBACK_SHARE = 0.05, 0.35
"""Of the greatest acceleration: what a pedal's table and its feedback may make of one."""


def speed_max_mps(profile: Mapping[str, Any]) -> float:
    """The speed limit; `unconfirmed_speed_max_mps` where neither a position nor an acceleration confirms the speed."""
    limits, state = profile["limits"], profile["state"]
    is_confirmed = "accel_mps2" in state["signals"] or state.get("pose", {}).get("source") != "odometry"
    least_mps = math.inf if is_confirmed else float(limits.get("unconfirmed_speed_max_mps", UNCONFIRMED_MPS))
    return min(float(limits["speed_max_mps"]), least_mps)


def later_s(profile: Mapping[str, Any], roles: Roles, reader: CommandReader) -> dict[Wait, float]:
    """How much later than the reference vehicle's reactions may come."""
    timing = profile["timing"]
    period_s = float(timing["sample_period_s"])
    late_s = 2.0 * max(0.0, period_s - PERIOD_S)
    infer_s = 0.0 if reader.has_stop else INFER_S
    slow_s = max(0.0, max((roles.periods_s[name] for name in roles.status), default=period_s) - 0.02)
    enable_s = enable_period_s(profile, reader)
    return {
        Wait.NOTHING: late_s,
        Wait.STATE: late_s + max(0.0, timing["state_stale_s"] - 0.05) + infer_s,
        Wait.STATUS: late_s + slow_s + enable_s,
        Wait.STATUS_LOST: late_s + slow_s + max(0.0, timing["status_stale_s"] - 0.1) + infer_s,
        Wait.SILENCE: late_s + max(0.0, timing["state_silent_s"] - 0.5),
    }


def enable_period_s(profile: Mapping[str, Any], reader: CommandReader) -> float:
    """Of the slowest message that says whether commands are enabled; 0 where each command says so itself."""
    sends = {str(send["message"]): float(send.get("period_s", 0.0)) for send in profile.get("send", ())}
    periods = {**sends, **profile["command"].get("periods", {})}
    return max((float(periods.get(name, 0.0)) for name in reader.enabling_messages), default=0.0)


def accel_slack_mps2(profile: Mapping[str, Any], reader: CommandReader) -> float:
    """Tolerance of commanded accelerations: one count, and what pedals make of them."""
    count = max(reader.count(key) for key in ("accel_mps2", "drive_mps2", "brake_mps2"))
    pedals = profile["command"].get("pedals")
    share = 0.0 if pedals is None else FEEDBACK_SHARE if "feedback" in pedals else TABLE_SHARE
    return float(0.002 + count + share * profile["limits"]["accel_max_mps2"])


def tow_mps2(profile: Mapping[str, Any], reader: CommandReader, measured_mps2: float) -> float:
    """Acceleration by a tow: more than any brake, and so little more that the speed stays plausible.

    `measured_mps2` is the greatest acceleration that the vehicle's signal can carry.
    """
    limits = profile["limits"]
    plausible_mps2 = profile.get("plausibility", {}).get("accel_mps2", math.inf)
    most_mps2 = min(MEASURED_SHARE * measured_mps2, PLAUSIBLE_SHARE * plausible_mps2)
    brake_mps2 = max(-limits["accel_min_mps2"], SPEED_BRAKE_MPS2 if reader.longitudinal == "speed" else 0.0)
    room_mps = profile.get("plausibility", {}).get("speed_mps", 2.0 * limits["speed_max_mps"]) - limits["speed_max_mps"]
    return float(min(brake_mps2 + min(8.0, TOW_SHARE_PER_S * room_mps), most_mps2))


def length_share(profile: Mapping[str, Any]) -> float:
    """How much smaller routes are, by the smallest turning radius."""
    turn_m = profile["geometry"]["wheelbase_m"] / math.tan(profile["limits"]["front_wheel_angle_rad"])
    return float(max(SHORTEST_SHARE, turn_m / REFERENCE_TURN_M))


def along_mps2(profile: Mapping[str, Any]) -> float:
    """Acceleration of routes."""
    limits, brake_mps2 = profile["limits"], profile["behavior"]["safe_deceleration_mps2"]
    return float(min(1.0, ALONG_SHARE * limits["accel_max_mps2"], BRAKE_SHARE * brake_mps2))


def speed_share(profile: Mapping[str, Any], length: float) -> float:
    """How much slower routes are, by the limits of speed, acceleration and braking."""
    limits = profile["limits"]
    across = limits["lateral_accel_mps2"] / ACROSS_MPS2
    usual = SPEED_SHARE * limits["speed_max_mps"] / USUAL_MPS
    return float(min(1.0, usual, math.sqrt(length * along_mps2(profile)), math.sqrt(length * across)))


def find_unjudged(layout: Layout, roles: Roles, reader: CommandReader) -> dict[str, str]:
    """What no frame of this vehicle's device can show."""
    found = {}
    if not any(layout.protections[name].counters for name in roles.of_device):
        found["counter"] = "no message of the device has a counter"
    if not reader.has_stop or reader.longitudinal == "speed":
        found["brakes"] = "no signal says that a command is a stop; an expected stop is judged by how it brakes"
        found["stop_steering"] = found["brakes"]
    if not reader.has_reason or not reader.enabling_messages:
        found["release"] = "no signal says why a command does not enable, or whether it does"
    if not roles.reports:
        found["periods"] = "the device sends neither lights nor reports"
    found["report"] = "what this vehicle's reports contain is not compared"
    return found
