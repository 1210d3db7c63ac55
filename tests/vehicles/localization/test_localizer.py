"""A robot that knows nothing of its place finds it by tags, keeps it, and finds it again."""

import numpy as np
import pytest

from benchmarks.odometry import DT_S, TAGS, Flight, Moment
from vehicles.localization.localizer import Localizer
from vehicles.localization.measurements import TagSighting
from vehicles.localization.seeking import SeekSettings, Sighted
from vehicles.localization.ukf import PoseNoise

AWAY = np.array([3.0, -2.0, 0.0])
PLACES = {number: tuple(place) for number, place in TAGS.items()}


def fed(robot: Localizer, flight: Flight, seconds: float, tag_every_s: float) -> list[Sighted]:
    """Fly, feed the robot, and return what became of the sightings."""
    outcomes = []
    for moment in flight.moments(seconds, tag_every_s):
        robot.propagate(moment.imu, DT_S)
        if moment.odometry is not None:
            robot.observe(moment.odometry)
        if moment.sighting is not None:
            outcomes.append(robot.sight(moment.sighting))
    return outcomes


def off_m(robot: Localizer, moment: Moment | Flight) -> float:
    pose = robot.pose()
    assert pose is not None
    return float(np.linalg.norm(pose.position - moment.position))


@pytest.fixture
def robot() -> Localizer:
    return Localizer(PLACES, PoseNoise(), SeekSettings())


def test_it_finds_its_place_and_keeps_it(robot: Localizer) -> None:
    flight = Flight(21)
    outcomes = fed(robot, flight, 4.0, 0.2)
    registered = outcomes.index(Sighted.REGISTERED)
    assert set(outcomes[:registered]) == {Sighted.KEPT}
    assert outcomes[registered + 1 :].count(Sighted.TAKEN) >= len(outcomes) - registered - 2
    assert robot.reason == ""
    assert off_m(robot, flight) < 0.15
    alignment = robot.alignment()
    assert alignment is not None
    assert alignment.shift == pytest.approx(flight.shift, abs=0.2)


def test_before_that_it_says_why_it_does_not_know(robot: Localizer) -> None:
    flight = Flight(22)
    assert robot.sight(flight.sighting()) is Sighted.IGNORED, "no odometry yet"
    fed(robot, flight, 0.5, 0.2)
    assert robot.pose() is None
    assert robot.alignment() is None
    assert robot.stance(0.0) is None
    assert "more sightings" in robot.reason
    strange = TagSighting(99, np.ones(3), np.eye(3))
    assert robot.sight(strange) is Sighted.IGNORED


def test_carried_elsewhere_it_notices_and_finds_itself_again(robot: Localizer) -> None:
    """Somebody carries it three metres away and its odometry does not notice."""
    flight = Flight(23)
    fed(robot, flight, 3.0, 0.2)
    flight.position = flight.position + AWAY
    flight.shift = flight.shift + AWAY
    outcomes = fed(robot, flight, 6.0, 0.2)
    assert Sighted.LOST in outcomes
    lost = outcomes.index(Sighted.LOST)
    assert outcomes[:lost].count(Sighted.TAKEN) == 0, "it believes no tag that cannot be"
    assert Sighted.REGISTERED in outcomes[lost:]
    assert off_m(robot, flight) < 0.2


def test_its_stance_is_as_sure_as_its_attitude(robot: Localizer) -> None:
    flight = Flight(24)
    fed(robot, flight, 4.0, 0.2)
    stance, pose = robot.stance(0.0), robot.pose()
    assert stance is not None
    assert pose is not None
    assert stance.position == pytest.approx(pose.position)
    assert 0.0 < stance.attitude_variance < 0.02**2
