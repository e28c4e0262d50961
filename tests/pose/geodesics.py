"""Geodesy for tests, by other formulas than the product's: Vincenty's inverse method and an integrated meridian."""

import math
from typing import NamedTuple

A_M, B_M = 6_378_137.0, 6_356_752.314245
"""WGS 84."""
F = (A_M - B_M) / A_M


class Geodesic(NamedTuple):
    distance_m: float
    azimuth_rad: float
    """At the start, clockwise from north."""


def measure_geodesic(start: tuple[float, float], end: tuple[float, float]) -> Geodesic:
    """Between two pairs of latitude and longitude in degrees (Vincenty 1975, inverse), to a tenth of a millimetre."""
    u1, u2 = (math.atan((1 - F) * math.tan(math.radians(latitude))) for latitude, _ in (start, end))
    difference = lam = math.radians(math.remainder(end[1] - start[1], 360.0))
    for _ in range(20):
        p = math.cos(u2) * math.sin(lam)
        q = math.cos(u1) * math.sin(u2) - math.sin(u1) * math.cos(u2) * math.cos(lam)
        sin_s, cos_s = math.hypot(p, q), math.sin(u1) * math.sin(u2) + math.cos(u1) * math.cos(u2) * math.cos(lam)
        if sin_s == 0.0:
            return Geodesic(0.0, 0.0)
        sigma = math.atan2(sin_s, cos_s)
        sin_a = math.cos(u1) * math.cos(u2) * math.sin(lam) / sin_s
        cos2_a = 1 - sin_a**2
        cos_m = cos_s - 2 * math.sin(u1) * math.sin(u2) / cos2_a if cos2_a > 1e-15 else 0.0
        c = F / 16 * cos2_a * (4 + F * (4 - 3 * cos2_a))
        lam = difference + (1 - c) * F * sin_a * (sigma + c * sin_s * (cos_m + c * cos_s * (2 * cos_m**2 - 1)))
    k = cos2_a * (A_M**2 - B_M**2) / B_M**2
    big_a = 1 + k / 16384 * (4096 + k * (-768 + k * (320 - 175 * k)))
    big_b = k / 1024 * (256 + k * (-128 + k * (74 - 47 * k)))
    inner = cos_s * (2 * cos_m**2 - 1) - big_b / 6 * cos_m * (4 * sin_s**2 - 3) * (4 * cos_m**2 - 3)
    return Geodesic(B_M * big_a * (sigma - big_b * sin_s * (cos_m + big_b / 4 * inner)), math.atan2(p, q))


def radii_m(latitude_deg: float) -> tuple[float, float]:
    """Of curvature: along the meridian, and across it times the cosine of the latitude."""
    sin2 = math.sin(math.radians(latitude_deg)) ** 2
    e2 = F * (2 - F)
    w = math.sqrt(1 - e2 * sin2)
    return A_M * (1 - e2) / w**3, A_M / w * math.cos(math.radians(latitude_deg))


def meridian_m(south_deg: float, north_deg: float, steps: int = 1000) -> float:
    """The arc of the meridian between two latitudes, integrated (midpoint rule)."""
    step_deg = (north_deg - south_deg) / steps
    return sum(math.radians(step_deg) * radii_m(south_deg + (i + 0.5) * step_deg)[0] for i in range(steps))
