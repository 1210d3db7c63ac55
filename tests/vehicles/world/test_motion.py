"""Target motions."""

import math

import pytest

from vehicles.world.motion import (
    Circle,
    Ending,
    Kinematics,
    Linear,
    RandomWalk,
    Replay,
    Waypoints,
    advance,
    at_time,
)


def test_linear_motion_keeps_its_velocity() -> None:
    now = Kinematics((1.0, 2.0), (0.1, -0.2))
    for _ in range(10):
        now = advance(Linear(), now, (0.1, -0.2), 0.5, (9.0, 9.0))
    assert now.position == pytest.approx((1.5, 1.0))
    assert now.velocity == (0.1, -0.2)


def test_a_random_walk_spreads_with_the_root_of_time_whatever_the_step() -> None:
    start = Kinematics((0.0, 0.0), (0.0, 0.0))
    one = advance(RandomWalk(0.3), start, (1.0, 0.0), 4.0, (1.0, -1.0))
    assert one.position == pytest.approx((4.0 + 0.6, -0.6))
    quarter = advance(RandomWalk(0.3), start, (1.0, 0.0), 1.0, (1.0, -1.0))
    assert quarter.position == pytest.approx((1.0 + 0.3, -0.3))
    assert quarter.velocity == pytest.approx((1.3, -0.3))


def test_a_circle_keeps_its_radius_and_direction() -> None:
    motion = Circle(centre=(1.0, 1.0), rate_rad_s=math.pi / 4)
    quarter = at_time(motion, (3.0, 1.0), 2.0, 1e-6)
    assert quarter.position == pytest.approx((1.0, 3.0))
    assert quarter.velocity == pytest.approx((-math.pi / 2, 0.0), abs=1e-5)


@pytest.mark.parametrize(
    ("time_s", "expected"),
    [
        (0.0, (0.0, 0.0)),
        (1.0, (2.0, 0.0)),
        (2.5, (4.0, 1.0)),
        (3.5, (4.0, 3.0)),
        (99.0, (4.0, 3.0)),
    ],
)
def test_waypoints_are_flown_at_constant_speed_and_then_it_stops(
    time_s: float, expected: tuple[float, float]
) -> None:
    motion = Waypoints(points=((4.0, 0.0), (4.0, 3.0)), speed_m_s=2.0)
    assert at_time(motion, (0.0, 0.0), time_s, 0.1).position == pytest.approx(expected)


def test_a_loop_comes_back_to_its_start() -> None:
    motion = Waypoints(((4.0, 0.0), (4.0, 3.0)), speed_m_s=2.0, ending=Ending.LOOP)
    assert at_time(motion, (0.0, 0.0), 6.0, 0.1).position == pytest.approx((0.0, 0.0))
    assert at_time(motion, (0.0, 0.0), 7.0, 0.1).position == pytest.approx((2.0, 0.0))
    assert at_time(motion, (0.0, 0.0), 5.0, 0.1).position == pytest.approx((1.6, 1.2))


def test_a_loop_of_no_length_stands_still() -> None:
    motion = Waypoints(((1.0, 1.0),), speed_m_s=2.0, ending=Ending.LOOP)
    assert at_time(motion, (1.0, 1.0), 3.0, 0.1).position == (1.0, 1.0)


def test_a_replay_is_linear_between_samples_and_still_outside() -> None:
    motion = Replay(times_s=(1.0, 2.0, 4.0), positions=((0.0, 0.0), (1.0, 0.0), (1.0, 4.0)))
    places = [at_time(motion, (9.0, 9.0), t, 0.5).position for t in (0.0, 1.5, 3.0, 9.0)]
    assert places == [(0.0, 0.0), (0.5, 0.0), (1.0, 2.0), (1.0, 4.0)]
    assert at_time(motion, (9.0, 9.0), 9.0, 0.5).velocity == (0.0, 0.0)
    assert at_time(motion, (9.0, 9.0), 3.0, 0.5).velocity == pytest.approx((0.0, 2.0))
