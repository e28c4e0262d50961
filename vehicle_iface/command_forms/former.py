"""The last step before the encoder: a permitted command in the form that the vehicle obeys."""

import math
from collections.abc import Collection, Mapping

from vehicle_iface.command import SafeCommand, WireCommand
from vehicle_iface.command_forms.motion import UNLIMITED, MeasuredMotion, WireRange
from vehicle_iface.command_forms.pedals import RELEASED, PedalFormer, PedalPair, identity_table
from vehicle_iface.command_forms.speed_target import SpeedTarget
from vehicle_iface.profile import Profile
from vehicle_iface.profile.command_forms import FORM_SIGNALS

_SI_FIELDS = {"longitudinal": "accel_mps2", "lateral": "front_wheel_angle_rad"}


class CommandFormer:
    """Forms the commands of one profile. All numbers are finite and within the ranges of their signals.

    `form` proposes and `commit` says that it was sent, as with the gate: the next command starts from what was sent.
    """

    def __init__(self, profile: Profile, ranges: Mapping[str, WireRange]) -> None:
        """`ranges` are those of the bound command fields."""
        command, limits = profile.command, profile.limits
        changes_gear = command.signals.gear_request is not None and profile.status.signals.gear is not None
        self._speed: SpeedTarget | None = None
        self._pedals: PedalFormer | None = None
        self._names = FORM_SIGNALS["longitudinal"][command.longitudinal]
        wire = [ranges.get(name, UNLIMITED) for name in self._names]
        if command.longitudinal == "speed":
            self._speed = SpeedTarget(limits, wire[0], changes_gear=changes_gear)
        elif command.longitudinal != "acceleration":
            pedals = command.pedals
            self._pedals = PedalFormer(
                limits,
                drive=pedals.throttle if pedals is not None else identity_table(limits.accel_max_mps2),
                brake=pedals.brake if pedals is not None else identity_table(-limits.accel_min_mps2),
                ranges=(wire[0], wire[1]),
                changes_gear=changes_gear,
                feedback=pedals.feedback if pedals is not None else None,
            )
        self._is_in_si = command.longitudinal == "drive_and_brake"
        self._wheelbase_m = profile.geometry.wheelbase_m
        self._curvature = ranges.get("curvature_per_m", UNLIMITED)
        self._yaw_rate = ranges.get("yaw_rate_radps", UNLIMITED)
        self._replaced = {_SI_FIELDS[key]: frozenset(FORM_SIGNALS[key][getattr(command, key)]) for key in FORM_SIGNALS}

    def form(self, permitted: SafeCommand, motion: MeasuredMotion, now_ns: int) -> WireCommand:
        """Return the command to be encoded, from what is permitted at `now_ns` and the vehicle as it was measured."""
        speed_mps = permitted.speed_mps
        if self._speed is not None:
            speed_mps = self._speed.form(permitted, motion, now_ns)
        pair = self._pedals.form(permitted, motion, now_ns) if self._pedals is not None else RELEASED
        tan_rear = math.tan(permitted.rear_wheel_angle_rad)
        curvature_per_m = (math.tan(permitted.front_wheel_angle_rad) - tan_rear) / self._wheelbase_m
        in_si, own = (pair, RELEASED) if self._is_in_si else (RELEASED, pair)
        return _wire_command(
            permitted, speed_mps, in_si, own, _cut(curvature_per_m, self._curvature),
            _cut(motion.speed_mps * curvature_per_m, self._yaw_rate),
        )  # fmt: skip

    def commit(self) -> None:
        """Record that the last command was sent."""
        if self._speed is not None:
            self._speed.commit()
        if self._pedals is not None:
            self._pedals.commit()

    def commit_fields(self, fields: Collection[str]) -> set[str]:
        """Record that only these fields were sent; return the fields of the permission that they carry.

        A quantity in several signals counts as sent when all of them were.
        """
        carried = {field for field, names in self._replaced.items() if names <= set(fields)}
        if "accel_mps2" in carried:
            self.commit()
        return carried | set(fields)


def _wire_command(
    permitted: SafeCommand,
    speed_mps: float,
    in_si: PedalPair,
    own: PedalPair,
    curvature_per_m: float,
    yaw_rate_radps: float,
) -> WireCommand:
    return WireCommand(
        enable=permitted.enable,
        safe_stop=permitted.safe_stop,
        reason=permitted.reason,
        gear_request=permitted.gear_request,
        accel_mps2=permitted.accel_mps2,
        speed_mps=speed_mps,
        drive_mps2=in_si.drive,
        brake_mps2=in_si.brake,
        throttle=own.drive,
        brake=own.brake,
        front_wheel_angle_rad=permitted.front_wheel_angle_rad,
        rear_wheel_angle_rad=permitted.rear_wheel_angle_rad,
        curvature_per_m=curvature_per_m,
        yaw_rate_radps=yaw_rate_radps,
    )


def _cut(value: float, wire: WireRange) -> float:
    """Limit to the signal's range; NaN stays NaN, and the encoder rejects it."""
    if not math.isfinite(value):
        return value
    return min(wire.high, max(wire.low, value))


def build_former(profile: Profile, ranges: Mapping[str, WireRange]) -> CommandFormer | None:
    """Return the profile's former; None where the vehicle takes acceleration and wheel angle as they are permitted."""
    command = profile.command
    if command.longitudinal == "acceleration" and command.lateral == "wheel_angle":
        return None
    return CommandFormer(profile, ranges)
