"""The pose filter: consistent, better than what it is fed with, quick, and hard to upset."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.localization import bounds, errors, feed, nees, position_errors, started
from benchmarks.odometry import DT_S, REGISTERED, TAGS, Flight, Moment, quaternion
from vehicles.localization.measurements import Odometry
from vehicles.localization.ukf import SIZE, Outcome, PoseFilter, PoseNoise

RUNS = 50


def position_error(tracked: PoseFilter, moment: Moment) -> float:
    return float(np.linalg.norm(tracked.pose().position - moment.position))


def test_it_is_as_sure_as_it_may_be() -> None:
    """NEES over 50 runs lies inside its bounds, for the state and for the position.

    Four means are looked at, so the bounds are those of 99.98 %: all hold by chance in 99.9 %.
    """
    means = nees(range(RUNS), 2).mean(axis=0)
    for column, size in enumerate((SIZE, 3)):
        low, high = bounds(RUNS, size, 0.9998)
        for mean in means[:, column]:
            assert low < mean < high


def test_a_filter_that_boasts_is_found_out() -> None:
    """Told of sensors half as noisy as they are, the NEES leaves its bounds."""
    sharp = replace(PoseNoise(), odometry_m=0.025, odometry_rad=0.005)
    found = []
    for seed in range(10):
        flight = Flight(seed)
        boasting = PoseFilter(sharp)
        boasting.start(flight.odometry(), flight.registered, REGISTERED)
        for moment in flight.moments(1.0):
            feed(boasting, moment)
        e, (_, P) = errors(boasting, moment), boasting.belief()
        found.append(e @ np.linalg.solve(P, e))
    assert np.mean(found) > bounds(10, SIZE, 0.9998)[1]


def test_it_is_better_than_the_odometry() -> None:
    """At least 30 % less position error than odometry laid by the registration (see Flight)."""
    ours_m, odometry_m = position_errors(range(100, 103), 12.0)
    assert 1.0 - ours_m / odometry_m > 0.3


def test_wild_odometry_is_left_out() -> None:
    flight = Flight(7)
    tracked = started(flight)
    dice = np.random.default_rng(1)
    outcomes, worst = [], 0.0
    for number, moment in enumerate(flight.moments(6.0)):
        given = moment
        if moment.odometry is not None and number % 25 == 4:
            wild = replace(moment.odometry, position=dice.normal(0.0, 20.0, 3))
            given = replace(moment, odometry=wild)
            outcomes += feed(tracked, given)[:1]
        else:
            feed(tracked, given)
        worst = max(worst, position_error(tracked, moment))
    assert len(outcomes) == 36
    assert set(outcomes) == {Outcome.OUTLIER}
    assert worst < 0.35


def test_a_wrong_tag_is_left_out() -> None:
    flight = Flight(8)
    tracked = started(flight)
    moment = None
    for moment in flight.moments(3.0):
        feed(tracked, moment)
    assert moment is not None
    sighting = flight.sighting()
    wrong = TAGS[(sighting.tag_id + 1) % len(TAGS)]
    before = tracked.pose().position
    assert tracked.sight(sighting, wrong) is Outcome.OUTLIER
    assert (tracked.pose().position == before).all()


def test_a_drop_out_is_survived_and_owned_up_to() -> None:
    flight = Flight(9)
    tracked = started(flight)
    for moment in flight.moments(5.0):
        feed(tracked, moment)
    sure = np.trace(tracked.pose().covariance)
    for moment in flight.moments(2.0, tag_every_s=1e3):
        pose = tracked.propagate(moment.imu, DT_S)
    assert pose.blind_s == pytest.approx(2.0)
    assert np.trace(pose.covariance) > 4.0 * sure
    e = moment.position - pose.position
    assert e @ np.linalg.solve(pose.covariance, e) < chi2.ppf(0.9999, 3)
    for moment in flight.moments(3.0):
        feed(tracked, moment)
    assert tracked.pose().blind_s < 0.04
    assert position_error(tracked, moment) < 0.15


def test_odometry_that_starts_anew_is_laid_anew() -> None:
    """After a restart the odometry counts from where it is, turned as it is."""
    flight = Flight(10)
    tracked = started(flight)
    for moment in flight.moments(5.0):
        feed(tracked, moment)
    flight.shift, flight.yaw = moment.position, moment.yaw + 2.0
    outcomes = []
    for moment in flight.moments(6.0, tag_every_s=1.0):
        outcomes += feed(tracked, moment)
    assert outcomes.count(Outcome.ANCHORED) == 1
    assert position_error(tracked, moment) < 0.2
    e, (_, P) = errors(tracked, moment), tracked.belief()
    assert e @ np.linalg.solve(P, e) < chi2.ppf(0.9999, SIZE)


def test_waypoints_go_back_into_the_odometry_frame() -> None:
    flight = Flight(11)
    tracked = started(flight)
    for moment in flight.moments(5.0):
        feed(tracked, moment)
    alignment = tracked.alignment()
    there = alignment.to_local((1.0, 2.0, 3.0))
    turn = np.array(
        [
            [math.cos(moment.yaw), -math.sin(moment.yaw)],
            [math.sin(moment.yaw), math.cos(moment.yaw)],
        ]
    )
    expected = turn.T @ (np.array([1.0, 2.0]) - moment.shift[:2])
    assert there[:2] == pytest.approx(expected, abs=0.15)


def test_at_rest_it_stays_at_rest() -> None:
    tracked = PoseFilter(Flight(0).noise)
    flight = Flight(0)
    pose = Odometry(np.array([1.0, 2.0, 3.0]), quaternion(flight.attitude))
    tracked.start(pose, flight.registered, 1e-8 * np.eye(4))
    x, y, z = flight.registered.to_common((1.0, 2.0, 3.0))
    assert tracked.pose().position == pytest.approx([x, y, z])
    assert tracked.alignment().shift == pytest.approx(flight.registered.shift)
