"""The forms in which a vehicle is commanded, `[command]`: which signals each needs, and the tables of the pedals."""

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec

NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
LongitudinalForm = Literal["acceleration", "speed", "drive_and_brake", "pedals"]
LateralForm = Literal["wheel_angle", "curvature", "yaw_rate"]
FORM_SIGNALS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "longitudinal": {
        "acceleration": ("accel_mps2",),
        "speed": ("speed_mps",),
        "drive_and_brake": ("drive_mps2", "brake_mps2"),
        "pedals": ("throttle", "brake"),
    },
    "lateral": {
        "wheel_angle": ("front_wheel_angle_rad",),
        "curvature": ("curvature_per_m",),
        "yaw_rate": ("yaw_rate_radps",),
    },
}
"""Key of `[command]` → form → the signals that it needs; those of the other forms must not be bound."""
_DEFAULTS = {"longitudinal": "acceleration", "lateral": "wheel_angle"}

PedalTable = Annotated[tuple[tuple[NonNegative, NonNegative], ...], msgspec.Meta(min_length=2)]
"""Rows of acceleration in m/s² (rising from 0, also that of the brake) and pedal in the unit of its signal."""


class Feedback(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Correction of the acceleration by its error: permitted less measured, along the direction of travel."""

    kp: NonNegative = 0.0
    """m/s² for each m/s² of the error."""
    ki: NonNegative = 0.0
    """m/s² for each m/s² of error and second."""


class Pedals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """From acceleration to pedals: linear between rows."""

    throttle: PedalTable
    brake: PedalTable
    feedback: Feedback | None = None


def needed_command_signals(command: Mapping[str, object]) -> dict[str, str]:
    """Return the signals that a document's `[command]` needs for its forms, each with the end of its error."""
    needed: dict[str, str] = {}
    for key, forms in FORM_SIGNALS.items():
        form = command.get(key, _DEFAULTS[key])
        fields = forms.get(form, ()) if isinstance(form, str) else ()
        if key in command:
            needed |= dict.fromkeys(fields, f'; $.command.{key} = "{form}" needs it')
        else:
            others = " or ".join(f'"{other}"' for other in forms if other != form)
            needed |= dict.fromkeys(fields, f"; a vehicle that is commanded otherwise has $.command.{key} = {others}")
    return needed
