"""Latitude and longitude become east and north, and the reverse, judged by geodesy of another kind."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.pose.geographic import MAX_DISTANCE_M, Fix, GeographicPlane, PlanePoint

from .geodesics import measure_geodesic, meridian_m, radii_m

UTRECHT = Fix(52.0601, 5.1102)
ORIGINS = [UTRECHT, Fix(0.0, 0.0), Fix(-33.9, 151.2), Fix(64.1, -21.9), Fix(-17.0, 180.0), Fix(88.9, 45.0)]
EARTH_M = 6.37e6
LATITUDES = st.floats(-89.0, 89.0)
LONGITUDES = st.floats(-180.0, 180.0)


def located(plane: GeographicPlane, fix: Fix) -> PlanePoint:
    point = plane.locate(fix)
    assert point is not None
    return point


def at(origin: Fix, distance_m: float, azimuth_rad: float) -> Fix:
    """A place near `origin`, roughly at this distance and azimuth."""
    north_m, east_m = radii_m(origin.latitude_deg)
    latitude_deg = origin.latitude_deg + math.degrees(distance_m * math.cos(azimuth_rad) / north_m)
    longitude_deg = origin.longitude_deg + math.degrees(distance_m * math.sin(azimuth_rad) / east_m)
    return Fix(latitude_deg, math.remainder(longitude_deg, 360.0))


@pytest.mark.parametrize("origin", ORIGINS)
def test_the_origin_is_zero(origin: Fix) -> None:
    east_m, north_m = located(GeographicPlane(origin), origin)
    assert (east_m, north_m) == (0.0, 0.0)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("azimuth_deg", range(0, 360, 30))
def test_within_ten_kilometres_distance_and_direction_are_those_of_the_geodesic(origin: Fix, azimuth_deg: int) -> None:
    plane = GeographicPlane(origin)
    for wanted_m in (1.0, 100.0, 3_000.0, 9_900.0):
        fix = at(origin, wanted_m, math.radians(azimuth_deg))
        east_m, north_m = located(plane, fix)
        geodesic = measure_geodesic(origin, fix)
        shortened_m = geodesic.distance_m - geodesic.distance_m**3 / (6 * EARTH_M**2)
        assert math.hypot(east_m, north_m) == pytest.approx(shortened_m, abs=0.001)
        across_m = geodesic.distance_m * math.remainder(math.atan2(east_m, north_m) - geodesic.azimuth_rad, math.tau)
        assert abs(across_m) < 0.001


@pytest.mark.parametrize(("latitude_deg", "length_m"), [(0.0, 110_574.30), (60.0, 111_412.27)])
def test_a_degree_of_latitude_has_its_known_length(latitude_deg: float, length_m: float) -> None:
    south_deg, steps = latitude_deg - 0.5, 100
    way_m = 0.0
    for step in range(steps):
        low_deg, high_deg = south_deg + step / steps, south_deg + (step + 1) / steps
        plane = GeographicPlane(Fix(0.5 * (low_deg + high_deg), 5.0))
        way_m += located(plane, Fix(high_deg, 5.0)).north_m - located(plane, Fix(low_deg, 5.0)).north_m
    assert way_m == pytest.approx(length_m, abs=0.01)
    assert way_m == pytest.approx(meridian_m(south_deg, south_deg + 1.0), abs=0.001)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("azimuth_deg", [0, 45, 90, 180, 290])
def test_up_to_a_hundred_kilometres_further_away_is_further_in_the_plane(origin: Fix, azimuth_deg: int) -> None:
    plane = GeographicPlane(origin)
    before_m = 0.0
    for kilometres in range(1, 96):
        fix = at(origin, 1000.0 * kilometres, math.radians(azimuth_deg))
        distance_m = math.hypot(*located(plane, fix))
        assert distance_m > before_m
        assert distance_m == pytest.approx(measure_geodesic(origin, fix).distance_m, abs=4.5)
        before_m = distance_m


@given(LATITUDES, LONGITUDES, st.floats(0.0, MAX_DISTANCE_M - 20.0), st.floats(0.0, math.tau))
def test_there_and_back_is_the_same_place(
    latitude_deg: float, longitude_deg: float, distance_m: float, azimuth_rad: float
) -> None:
    plane = GeographicPlane(Fix(latitude_deg, longitude_deg))
    point = PlanePoint(distance_m * math.sin(azimuth_rad), distance_m * math.cos(azimuth_rad))
    fix = plane.fix_at(point)
    assert abs(fix.longitude_deg) <= 180.0
    assert located(plane, fix) == pytest.approx(point, abs=1e-6)


@pytest.mark.parametrize("longitude_deg", [180.0, -180.0, 179.999, -179.999])
def test_across_the_antimeridian_the_way_is_short(longitude_deg: float) -> None:
    plane = GeographicPlane(Fix(-17.0, longitude_deg))
    metres_per_degree = math.radians(1.0) * radii_m(-17.0)[1]
    for east_deg in (-0.01, 0.01):
        there = math.remainder(longitude_deg + east_deg, 360.0)
        for written in (there, there % 360.0):
            east_m, _ = located(plane, Fix(-17.0, written))
            assert east_m == pytest.approx(east_deg * metres_per_degree, abs=0.01)
        assert abs(plane.fix_at(PlanePoint(east_deg * metres_per_degree, 0.0)).longitude_deg) <= 180.0


@pytest.mark.parametrize("origin", [fix for fix in ORIGINS if abs(fix.latitude_deg) < 70.0])
def test_a_heading_from_the_local_east_is_turned_to_that_of_the_plane(origin: Fix) -> None:
    plane = GeographicPlane(origin)
    for distance_m, tolerance_rad in ((0.0, 1e-6), (10_000.0, 5e-6), (90_000.0, 2e-4)):
        for azimuth_deg in range(0, 360, 45):
            fix = at(origin, distance_m, math.radians(azimuth_deg))
            for heading_rad in (-3.0, -1.5, 0.0, 0.7, 1.6):
                ahead = at(fix, 1.0, 0.5 * math.pi - heading_rad)
                east_m, north_m = (b - a for a, b in zip(located(plane, fix), located(plane, ahead), strict=True))
                seen_rad = math.atan2(north_m, east_m)
                error_rad = math.remainder(heading_rad + plane.convergence_rad(fix) - seen_rad, math.tau)
                assert abs(error_rad) < tolerance_rad


def test_meridians_converge_by_two_milliradians_in_ten_kilometres() -> None:
    plane = GeographicPlane(UTRECHT)
    assert plane.convergence_rad(at(UTRECHT, 10_000.0, math.pi / 2)) == pytest.approx(0.0020, abs=0.0001)
    assert GeographicPlane(Fix(0.0, 5.0)).convergence_rad(Fix(0.0, 5.1)) == 0.0


@pytest.mark.parametrize(
    "fix",
    [
        Fix(0.0, 0.0),
        Fix(-UTRECHT.latitude_deg, UTRECHT.longitude_deg - 180.0),  # the other side of the earth: 0 east, 0 north
        Fix(math.nan, 5.0),
        Fix(52.0, math.nan),
        Fix(math.inf, 5.0),
        Fix(52.0, math.inf),
        Fix(127.9399, UTRECHT.longitude_deg - 180.0),  # the origin's place, over the pole
        at(UTRECHT, 101_000.0, 0.0),
    ],
)
def test_a_place_that_is_none_or_far_away_is_not_located(fix: Fix) -> None:
    assert GeographicPlane(UTRECHT).locate(fix) is None


@pytest.mark.parametrize("point", [PlanePoint(100_001.0, 0.0), PlanePoint(0.0, -2e7), PlanePoint(math.nan, 0.0)])
def test_a_point_far_away_has_no_place_on_the_earth(point: PlanePoint) -> None:
    with pytest.raises(InvalidValueError, match="must be at most 100000 m from the origin"):
        GeographicPlane(UTRECHT).fix_at(point)


@pytest.mark.parametrize(
    ("origin", "text"),
    [
        (Fix(90.0, 0.0), "origin latitude 90.0: must be within ±89"),
        (Fix(-89.1, 0.0), "origin latitude -89.1"),
        (Fix(120.5, 31.0), "latitude is the first of the two"),
        (Fix(math.nan, 0.0), "origin latitude nan"),
        (Fix(52.0, 180.1), "origin longitude 180.1: must be within ±180"),
        (Fix(52.0, math.nan), "origin longitude nan"),
    ],
)
def test_an_origin_at_a_pole_or_off_the_earth_is_refused(origin: Fix, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        GeographicPlane(origin)
