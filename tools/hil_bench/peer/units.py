"""Units as DBCs spell them, and their size in SI."""

import math

SIZES: dict[float, str] = {
    1.0: "m meter metre meters metres rad radian radians m/s mps m/sec rad/s rad/sec radps m/s^2 m/s2 m/s² m/s/s "
    "m/s**2 m/sec^2 m/sec2 mps2 nm n*m n·m n.m 1/m m^-1 rad/m ratio 1 - s sec n kg v a w pa k hz",
    1e-3: "mm mrad mm/s ms mm/s^2 mm/s2 1/km km^-1 km-1",
    1e-2: "cm cm/s % percent pct",
    1e3: "km kw kpa",
    1e5: "bar",
    0.3048: "ft feet",
    0.0254: "in inch",
    1609.344: "mi mile miles",
    1.0 / 3.6: "km/h kph kmh kmph km/hr",
    0.44704: "mph mi/h",
    1852.0 / 3600.0: "kn kt knot knots kts",
    9.80665: "g",
    math.radians(1.0): "deg ° º degree degrees deg/s °/s º/s degree/s degrees/s deg/sec degpersec dps",
    math.tau / 60.0: "rpm 1/min rev/min u/min min-1",
}
_SIZES = {spelling: size for size, spellings in SIZES.items() for spelling in spellings.split()}


def size_of(unit: str | None) -> float | None:
    """Value in SI = value · size; 1 without a unit, None for one that is not known."""
    spelling = "".join((unit or "").split()).lower()
    return _SIZES.get(spelling) if spelling else 1.0
