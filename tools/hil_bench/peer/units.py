"""Units as DBCs spell them, and their size in SI."""

import math

SIZES: dict[float, str] = {
    1.0: "m rad m/s rad/s m/s^2 m/s2 m/s² m/s/s nm n*m n·m 1/m rad/m ratio 1 s v a hz",
    1e-3: "mm mrad mm/s ms",
    1e-2: "cm cm/s % percent",
    1e3: "km",
    1.0 / 3.6: "km/h kph kmh kmph",
    0.44704: "mph mi/h",
    1852.0 / 3600.0: "kn kt knot knots kts",
    9.80665: "g",
    math.radians(1.0): "deg ° degree degrees deg/s °/s degree/s degrees/s deg/sec degpersec dps",
    math.tau / 60.0: "rpm 1/min rev/min",
}
_SIZES = {spelling: size for size, spellings in SIZES.items() for spelling in spellings.split()}


def size_of(unit: str | None) -> float:
    """Value in SI = value · size; 1 for a unit that is not known, which is compared in its own unit."""
    return _SIZES.get("".join((unit or "").split()).lower(), 1.0)
