"""What a command of any form asks of the vehicle: whether to obey, speed or acceleration, and front wheel angle."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from vehicle_bus_contract.reference import DRIVE, NO_REQUEST, REASONS, REVERSE

from hil_bench.peer.signals import PeerSignal, field_signals, sent_values

STANDS_MPS = 0.05
UNSTATED = len(REASONS)
"""The number of a reason that is not told."""
GEARS = {"DRIVE": DRIVE, "FORWARD": DRIVE, "REVERSE": REVERSE, "NO_REQUEST": NO_REQUEST}
Newest = Mapping[str, float]
"""MESSAGE.SIGNAL → newest value, in the field's unit."""


class CommandReader:
    """Reads the newest signals of all sent messages as one command with the reference vehicle's names."""

    def __init__(self, profile: Mapping[str, Any], signals: Mapping[str, PeerSignal]) -> None:
        command = profile["command"]
        self._signals, self._fields = signals, field_signals(profile)
        self.longitudinal: str = command.get("longitudinal", "acceleration")
        self.lateral: str = command.get("lateral", "wheel_angle")
        self._wheelbase_m = float(profile["geometry"]["wheelbase_m"])
        pedals = command.get("pedals", {})
        self._throttle = [(row[1], row[0]) for row in pedals.get("throttle", ())]
        self._brake = [(row[1], row[0]) for row in pedals.get("brake", ())]
        self._gears: Mapping[str, str] = profile.get("status", {}).get("gears", {})
        self._enabling = {
            dotted: float(value["value"])
            for dotted, value in sent_values(profile).items()
            if isinstance(value, Mapping) and value.get("when") == "enabled" and "value" in value
        }
        self.has_stop = "safe_stop" in self._fields
        self.has_reason = "reason" in self._fields
        self.has_gear = "gear_request" in self._fields
        speed = self._fields.get("speed_mps", ())
        self.is_signed = not speed or all(signals[name].bits_range[0] < 0.0 for name in speed)

    @property
    def enabling_messages(self) -> set[str]:
        """The messages that say whether commands are enabled."""
        return {name.partition(".")[0] for name in (*self._enabling, *self._fields.get("enable", ()))}

    def read(self, newest: Newest, *, speed_mps: float, direction: float) -> dict[str, float]:
        """Without ACCEL_REQUEST where a speed is commanded, without what the vehicle has no signal for."""
        found = {
            "ENABLE": float(self.is_enabled(newest)),
            "REASON": self._reason(newest),
            "FRONT_WHEEL_ANGLE_REQUEST": self._angle_rad(newest, speed_mps),
        }
        if self.has_stop:
            found["SAFE_STOP"] = float(bool(self._value("safe_stop", newest)))
        if self.has_gear:
            found["GEAR_REQUEST"] = self._gear(newest)
        if self.longitudinal == "speed":
            found["SPEED_REQUEST"] = self._value("speed_mps", newest) * (1.0 if self.is_signed else direction)
        else:
            found["ACCEL_REQUEST"] = self._accel_mps2(newest, speed_mps, direction)
        return found

    def is_enabled(self, newest: Newest) -> bool:
        """Whether the vehicle shall obey; commands of a vehicle without such a signal always say so."""
        return all(newest.get(name, 0.0) != 0.0 for name in self._fields.get("enable", ())) and all(
            abs(newest.get(name, math.nan) - value) < 1e-6 for name, value in self._enabling.items()
        )

    def count(self, field: str) -> float:
        """One count of a field's coarsest signal; 0 for a field that is not bound."""
        return max((self._signals[name].count for name in self._fields.get(field, ())), default=0.0)

    def _value(self, field: str, newest: Newest) -> float:
        names = self._fields.get(field, ())
        return max((newest.get(name, 0.0) for name in names), key=abs, default=0.0)

    def _accel_mps2(self, newest: Newest, speed_mps: float, direction: float) -> float:
        if self.longitudinal == "acceleration":
            return self._value("accel_mps2", newest)
        if self.longitudinal == "drive_and_brake":
            drive, brake = self._value("drive_mps2", newest), self._value("brake_mps2", newest)
        else:
            drive = between(self._throttle, self._value("throttle", newest))
            brake = between(self._brake, self._value("brake", newest))
        travel = direction if abs(speed_mps) < STANDS_MPS else math.copysign(1.0, speed_mps)
        forward = direction if self.has_gear else 1.0
        return forward * drive - travel * brake

    def _angle_rad(self, newest: Newest, speed_mps: float) -> float:
        if self.lateral == "wheel_angle":
            return self._value("front_wheel_angle_rad", newest)
        if self.lateral == "curvature":
            return math.atan(self._value("curvature_per_m", newest) * self._wheelbase_m)
        if abs(speed_mps) < STANDS_MPS:
            return 0.0
        return math.atan(self._value("yaw_rate_radps", newest) / speed_mps * self._wheelbase_m)

    def _reason(self, newest: Newest) -> float:
        if not self.has_reason:
            return float(UNSTATED)
        signal = self._signals[self._fields["reason"][0]]
        number = self._value("reason", newest)
        word = signal.word_of(number)
        return float(REASONS.index(word)) if word in REASONS else number

    def _gear(self, newest: Newest) -> float:
        signal = self._signals[self._fields["gear_request"][0]]
        word = signal.word_of(self._value("gear_request", newest))
        return float(GEARS.get(self._gears.get(word, word), NO_REQUEST))


def between(table: Sequence[tuple[float, float]], at: float) -> float:
    """Linear between rows, and beyond the last one: a pedal may be pressed further than the table goes."""
    if not table or at <= table[0][0]:
        return table[0][1] if table else 0.0
    rows = [(low, high) for low, high in pairwise(table) if high[0] > low[0]]
    (x0, y0), (x1, y1) = next((row for row in rows if at <= row[1][0]), rows[-1])
    return y0 + (y1 - y0) * (at - x0) / (x1 - x0)
