"""The steps that the person in the vehicle is asked for: only those for which the profile binds a signal."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from vehicle_iface.codec.binding import Binding
from vehicle_iface.commission.checks import Check
from vehicle_iface.commission.motion_checks import BendCheck, BrakingCheck, Field, PathCheck, RollCheck, TurnCheck
from vehicle_iface.commission.status_checks import ChoiceCheck, PressCheck, RestCheck
from vehicle_iface.profile.signals import DriverConditions
from vehicle_iface.review.series import POSITION, join_signals
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

WHEEL_RAD = 0.05
"""Angle by which a road wheel counts as turned; at most half of the profile's limit."""
MOST_WHEEL_RAD = 1.2
"""Largest plausible angle of a road wheel, about 70°."""
BRAKED_MPS = 1.0
"""Loss of speed that counts as braking; at most half of the profile's speed limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One thing to do, and what it must change."""

    key: str
    ask: str
    checks: tuple[Check, ...]


def build_steps(binding: Binding, labels: Mapping[str, str]) -> list[Step]:
    """Build the walk for a profile; `labels` are the signals of each bound field of the state."""
    builder = _Builder(binding, labels)
    steps = (
        builder.rest(),
        builder.wheel("wheel_left", "left", 1.0),
        builder.wheel("wheel_right", "right", -1.0),
        builder.press("brake", "press the brake", "the brake is pressed"),
        builder.press("throttle", "press the accelerator a little, out of gear", "the accelerator is pressed"),
        builder.mode(VehicleMode.MANUAL, "let the driver drive: mode MANUAL", "the driver drives"),
        builder.gear(Gear.REVERSE, "put it in reverse"),
        builder.gear(Gear.DRIVE, "put it in drive"),
        builder.roll(),
        builder.bend(),
        builder.braking(),
        builder.mode(VehicleMode.READY, "hand it over to the computer: mode READY", "it is handed over"),
    )
    return [step for step in steps if step.checks]


class _Builder:
    """Builds the steps of one profile; a step without a bound signal has no checks."""

    def __init__(self, binding: Binding, labels: Mapping[str, str]) -> None:
        self._profile, self._labels = binding.profile, labels
        self._status = binding.sections["status"]
        self._modes = {binding.profile.status.modes.get(name, name) for name in self._mode_names(binding)}
        driver = binding.profile.status.driver or DriverConditions()
        self._rests: dict[str, RestCheck] = {}
        if driver.steering is not None:
            self._rests["steering"] = RestCheck(self._label("steering"), _driver_steers, "driver_steers")
        if self._label("driver_brake", "brake"):
            self._rests["brake"] = RestCheck(self._label("driver_brake", "brake"), _driver_brakes, "driver_brake")
        if self._label("driver_throttle", "throttle"):
            label = self._label("driver_throttle", "throttle")
            self._rests["throttle"] = RestCheck(label, _driver_accelerates, "driver_throttle")

    @staticmethod
    def _mode_names(binding: Binding) -> Iterator[str]:
        """Return the names of the modes, as the profile or DBC writes them."""
        signals, when = binding.profile.status.signals, binding.profile.status.when
        if signals.mode is not None:
            yield from binding.view(signals.mode).names.values()
        elif when is not None and when.ready is not None:
            yield VehicleMode.READY.name  # manual is an override here: it needs a computer that drives

    def _label(self, *words: str) -> str:
        """Return the signals of fields and conditions of the status; empty where none is bound."""
        return join_signals([dotted for word in words for dotted in self._status.get(word, ())])

    def _field(self, name: str, unit: str, signs: str = "left positive") -> Field:
        return Field(name=name, label=self._labels[name], unit=unit, signs=signs)

    def rest(self) -> Step:
        ask = "take hands off the wheel and feet off the pedals"
        return Step(key="rest", ask=ask, checks=tuple(self._rests.values()))

    def wheel(self, key: str, side: str, sign: float) -> Step:
        checks: list[Check] = []
        action, limits = f"the wheel is turned {side}", self._profile.limits
        if "front_wheel_angle_rad" in self._labels:
            field = self._field("front_wheel_angle_rad", "rad")
            least = min(WHEEL_RAD, 0.5 * limits.front_wheel_angle_rad)
            wrong = "no road wheel turns so far; it is the steering wheel's angle, or in another unit"
            checks.append(TurnCheck(field, sign=sign, least=least, most=MOST_WHEEL_RAD, action=action, wrong=wrong))
        label = self._label("driver_steer_torque_nm")
        if label:
            torque = Field(name="driver_steer_torque_nm", label=label, unit="N·m")
            least = 0.5 * limits.driver_steer_torque_nm
            checks.append(TurnCheck(torque, sign=sign, least=least, most=math.inf, action=action, wrong=""))
        if sign > 0.0 and "steering" in self._rests:
            checks.append(PressCheck(self._rests["steering"], action))
        return Step(key=key, ask=f"turn the wheel {side} and hold it there", checks=tuple(checks))

    def press(self, name: str, ask: str, action: str) -> Step:
        rest = self._rests.get(name)
        return Step(key=name, ask=ask, checks=() if rest is None else (PressCheck(rest, action),))

    def gear(self, wanted: Gear, ask: str) -> Step:
        label = self._label("gear")
        check = ChoiceCheck(label, _gear, "gear", wanted, f"it is {ask.removeprefix('put it ')}")
        return Step(key=f"gear_{wanted.name.lower()}", ask=ask, checks=(check,) if label else ())

    def mode(self, wanted: VehicleMode, ask: str, action: str) -> Step:
        is_bound = wanted.name in self._modes and not (self._profile.only_watches and wanted is VehicleMode.READY)
        check = ChoiceCheck(self._label("mode") or "the mode", _mode, "mode", wanted, action)
        return Step(key=f"mode_{wanted.name.lower()}", ask=ask, checks=(check,) if is_bound else ())

    def roll(self) -> Step:
        speed = self._field("speed_mps", "m/s", "forward positive")
        check = RollCheck(speed, place=self._labels.get(POSITION), heading=self._labels.get("heading_rad"))
        return Step(key="roll", ask="push or roll it forward two metres, and let it stand", checks=(check,))

    def bend(self) -> Step:
        checks: list[Check] = []
        if "yaw_rate_radps" in self._labels:
            checks.append(BendCheck(self._field("yaw_rate_radps", "rad/s"), is_rate=True))
        if "heading_rad" in self._labels:
            field = self._field("heading_rad", "rad", "grows to the left")
            checks.append(BendCheck(field, is_rate=False))
        if POSITION in self._labels:
            checks.append(PathCheck(self._labels[POSITION]))
        return Step(key="bend", ask="drive forward through a bend to the left, a quarter turn", checks=tuple(checks))

    def braking(self) -> Step:
        checks: list[Check] = []
        if "accel_mps2" in self._labels:
            least_mps = min(BRAKED_MPS, 0.5 * self._profile.limits.speed_max_mps)
            field = self._field("accel_mps2", "m/s²", "forward positive")
            checks.append(BrakingCheck(field, least_mps=least_mps))
        return Step(key="braking", ask="drive straight ahead, and brake firmly to a stop", checks=tuple(checks))


def _driver_brakes(status: VehicleStatus) -> bool:
    return status.driver_brake


def _driver_accelerates(status: VehicleStatus) -> bool:
    return status.driver_throttle


def _driver_steers(status: VehicleStatus) -> bool:
    return status.driver_steers


def _gear(status: VehicleStatus) -> Gear | None:
    return status.gear


def _mode(status: VehicleStatus) -> VehicleMode:
    return status.mode
