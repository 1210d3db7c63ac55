"""The airframe against scipy's answer to the same linear system."""

import math

import pytest
from scipy.signal import TransferFunction, step

from vehicles.mavlink.airframe import GRAVITY_M_S2, Airframe, AirframeSettings

STILL = (0.0, 0.0, 0.0)


def test_a_small_step_is_a_second_order_response() -> None:
    settings = AirframeSettings(frequency_rad_s=2.0, damping=0.7)
    body = Airframe(settings, STILL)
    system = TransferFunction([4.0], [1.0, 2.8, 4.0])
    times, expected = step(system, T=[0.02 * k for k in range(201)])
    for k in range(1, len(times)):
        body.chase((0.5, 0.0, 0.0), STILL, 0.02)
        assert body.position[0] == pytest.approx(0.5 * expected[k], abs=0.006)


def test_it_tracks_a_moving_reference() -> None:
    body = Airframe(AirframeSettings(), STILL)
    for k in range(500):
        body.chase((0.02 * k, -0.04 * k, 0.0), (1.0, -2.0, 0.0), 0.02)
    assert body.velocity == pytest.approx((1.0, -2.0, 0.0), abs=1e-3)
    assert body.position == pytest.approx((10.0, -20.0, 0.0), abs=0.05)


def test_limits_hold() -> None:
    settings = AirframeSettings(acceleration_m_s2=2.0, speed_m_s=3.0, climb_m_s=1.0)
    body = Airframe(settings, STILL)
    for _ in range(1000):
        before = body.velocity
        body.chase((1e3, -1e3, 1e3), STILL, 0.02)
        assert math.dist(before, body.velocity) <= 2.0 * 0.02 + 1e-9
        assert math.hypot(*body.velocity[:2]) <= 3.0 + 1e-9
        assert abs(body.velocity[2]) <= 1.0 + 1e-9


def test_it_leans_where_it_accelerates() -> None:
    body = Airframe(AirframeSettings(), STILL)
    body.chase(None, (5.0, 0.0, 0.0), 0.01)
    assert body.pitch_rad == pytest.approx(-math.atan2(body.acceleration[0], GRAVITY_M_S2))
    assert body.roll_rad == 0.0
