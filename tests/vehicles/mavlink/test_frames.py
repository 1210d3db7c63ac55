"""Frames against an oracle of their own: geodesy by numerical integration, numpy rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.mavlink.frames import Alignment, Datum, flipped, heading_of_yaw, wrapped

FAR = st.floats(-5e3, 5e3)
ANGLES = st.floats(-20.0, 20.0)


def arc_north_m(latitude_deg: float, to_deg: float) -> float:
    """Length of the meridian between two latitudes, by Simpson's rule over its curvature."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    phi = np.radians(np.linspace(latitude_deg, to_deg, 201))
    radius = a * (1 - e2) / (1 - e2 * np.sin(phi) ** 2) ** 1.5
    h = phi[1] - phi[0]
    return float(
        h / 3 * (radius[0] + radius[-1] + 4 * radius[1:-1:2].sum() + 2 * radius[2:-2:2].sum())
    )


def test_north_is_the_length_of_the_meridian() -> None:
    datum = Datum(47.0, 8.0)
    north = datum.enu(47.01, 8.0, 0.0)
    # The tangent plane is shorter than the arc by the cube of the distance over 6 R squared.
    assert north[1] == pytest.approx(arc_north_m(47.0, 47.01), abs=1e-3)
    assert abs(north[0]) < 1e-6


def test_east_is_the_length_of_the_parallel() -> None:
    datum = Datum(60.0, 8.0)
    a, e2 = 6378137.0, 0.0066943799901413165
    radius = a / math.sqrt(1 - e2 * math.sin(math.radians(60.0)) ** 2) * 0.5
    east = datum.enu(60.0, 8.001, 0.0)
    assert east[0] == pytest.approx(radius * math.radians(0.001), rel=1e-8)


def test_up_is_altitude() -> None:
    assert Datum(-33.0, 151.0, 20.0).enu(-33.0, 151.0, 50.0) == pytest.approx(
        (0, 0, 30.0), abs=1e-6
    )


@given(FAR, FAR, st.floats(-100, 500), st.floats(-80, 80), st.floats(-180, 180))
def test_geodetic_is_the_way_back(
    east: float, north: float, up: float, latitude: float, longitude: float
) -> None:
    datum = Datum(latitude, longitude, 123.0)
    there = datum.enu(*datum.geodetic((east, north, up)))
    assert there == pytest.approx((east, north, up), abs=1e-6)


@pytest.mark.parametrize(
    ("latitude", "longitude", "altitude"),
    [(90.0, 0.0, 0.0), (0.0, 181.0, 0.0), (math.nan, 0.0, 0.0), (0.0, 0.0, math.inf)],
)
def test_a_datum_is_a_place(latitude: float, longitude: float, altitude: float) -> None:
    with pytest.raises(ValueError, match="datum"):
        Datum(latitude, longitude, altitude)


def test_flipped() -> None:
    assert flipped((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)
    assert flipped(flipped((1.0, 2.0, 3.0))) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("yaw_deg", "heading_deg"), [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (-90.0, 180.0)]
)
def test_heading_of_yaw(yaw_deg: float, heading_deg: float) -> None:
    assert heading_of_yaw(math.radians(yaw_deg)) == pytest.approx(math.radians(heading_deg))


@given(ANGLES)
def test_wrapped(angle: float) -> None:
    result = wrapped(angle)
    assert -math.pi < result <= math.pi
    assert math.cos(result - angle) == pytest.approx(1.0)


@given(FAR, FAR, FAR, ANGLES)
def test_alignment_turns_then_shifts(x: float, y: float, z: float, yaw: float) -> None:
    alignment = Alignment((3.0, -4.0, 5.0), yaw)
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    expected = [*(turn @ [x, y] + [3.0, -4.0]), z + 5.0]
    assert alignment.to_common((x, y, z)) == pytest.approx(expected, abs=1e-8)
    assert alignment.to_local(alignment.to_common((x, y, z))) == pytest.approx((x, y, z), abs=1e-8)
    assert alignment.turned_back(alignment.turned((x, y, z))) == pytest.approx((x, y, z), abs=1e-8)
