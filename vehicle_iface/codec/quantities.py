"""Units of signals: all spellings that DBCs use, the quantity that each measures, and its size in SI."""

import math
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit of a quantity: value in SI = value · factor."""

    quantity: str
    factor: float


_G_MPS2 = 9.80665
_SPELLINGS: dict[tuple[str, float], str] = {
    ("length", 1.0): "m meter metre meters metres",
    ("length", 1e-2): "cm",
    ("length", 1e-3): "mm",
    ("length", 1e3): "km",
    ("length", 0.3048): "ft feet",
    ("length", 0.0254): "in inch",
    ("length", 1609.344): "mi mile miles",
    ("angle", 1.0): "rad radian radians",
    ("angle", 1e-3): "mrad",
    ("angle", math.radians(1.0)): "deg ° º â° degree degrees",
    ("angular rate", 1.0): "rad/s rad/sec radps",
    ("angular rate", math.radians(1.0)): "deg/s °/s º/s â°/s deg/sec degree/s degrees/s degpersec dps",
    ("angular rate", math.tau / 60.0): "rpm 1/min rev/min u/min min-1",
    ("speed", 1.0): "m/s mps m/sec meter/s",
    ("speed", 1e-2): "cm/s",
    ("speed", 1e-3): "mm/s",
    ("speed", 1.0 / 3.6): "km/h kph kmh kmph km/hr",
    ("speed", 0.44704): "mph mi/h",
    ("speed", 1852.0 / 3600.0): "kn kt knot knots kts",
    ("acceleration", 1.0): "m/s^2 m/s2 m/s² m/s/s m/(s^2) m/s**2 m/sec^2 m/sec2 mps2 m/ss",
    ("acceleration", 1e-3): "mm/s^2 mm/s2",
    ("acceleration", _G_MPS2): "g",
    ("torque", 1.0): "nm n*m n·m n.m newton-meter",
    ("curvature", 1.0): "1/m m^-1 rad/m",
    ("curvature", 1e-3): "1/km km^-1 km-1",
    ("ratio", 1.0): "ratio 1 -",
    ("ratio", 0.01): "% percent pct",
    ("time", 1.0): "s sec",
    ("time", 1e-3): "ms",
    ("time", 1e-6): "us µs",
    ("force", 1.0): "n",
    ("mass", 1.0): "kg",
    ("voltage", 1.0): "v",
    ("current", 1.0): "a",
    ("power", 1.0): "w",
    ("power", 1e3): "kw",
    ("pressure", 1.0): "pa",
    ("pressure", 1e3): "kpa",
    ("pressure", 1e5): "bar",
    ("temperature", 1.0): "k",
    ("frequency", 1.0): "hz",
    ("angular acceleration", 1.0): "rad/s^2 rad/s2 rad/s²",
    ("angular acceleration", math.radians(1.0)): "deg/s^2 deg/s2 °/s² °/s^2",
    ("jerk", 1.0): "m/s^3 m/s3 m/s³",
}  # fmt: skip
"""Maps quantity and size in SI to the spellings, in lower case and without blanks."""
_UNITS = {
    spelling: Unit(quantity, factor)
    for (quantity, factor), spellings in _SPELLINGS.items()
    for spelling in spellings.split()
}
_FIELD_UNITS = {
    "m": ("m", Unit("length", 1.0)),
    "rad": ("rad", Unit("angle", 1.0)),
    "deg": ("deg", Unit("angle", math.radians(1.0))),
    "mps": ("m/s", Unit("speed", 1.0)),
    "mps2": ("m/s^2", Unit("acceleration", 1.0)),
    "radps": ("rad/s", Unit("angular rate", 1.0)),
    "nm": ("N*m", Unit("torque", 1.0)),
}
"""Maps the last part of a field's name to the unit's spelling and the unit."""


class FieldUnit(NamedTuple):
    """The unit in which the program keeps a field."""

    name: str
    unit: Unit


def find_unit(spelling: str) -> Unit | None:
    """Return the unit with that spelling, ignoring case and blanks; None if it is unknown."""
    return _UNITS.get("".join(spelling.split()).lower())


def unit_of_field(field: str) -> FieldUnit | None:
    """Return the unit that the last part of the field's name states; None for a field without a unit."""
    if field.endswith("_per_m"):
        return FieldUnit("1/m", Unit("curvature", 1.0))
    found = _FIELD_UNITS.get(field.rpartition("_")[2])
    return FieldUnit(*found) if found is not None else None
