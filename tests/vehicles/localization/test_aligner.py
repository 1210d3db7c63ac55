"""A MAVLink vehicle indoors: no satellite, no datum; tags lay its frame into the team's."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.odometry import TAGS
from solver.arrays import FloatArray
from solver.setpoints import Setpoint
from tests.vehicles.mavlink.air import Air, build
from vehicles.localization.aligner import TagAligner, TagAlignerSettings
from vehicles.localization.drift import Drift
from vehicles.localization.measurements import TagSighting
from vehicles.localization.seeking import Sighted
from vehicles.localization.senses import TagSenses
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import Start
from vehicles.mavlink.frames import Alignment

TRUE = Alignment((1.5, -2.0, 0.3), 0.8)
"""Where the autopilot's local frame really lies."""

PLACES = {number: tuple(place) for number, place in TAGS.items()}
NOISE_M = 0.03
TARGET = np.array([2.0, -1.0, -0.5])
"""From the vehicle."""


class Camera:
    """Sees a tag ten times a second from where the simulated vehicle truly is."""

    def __init__(self, air: Air, aligner: TagAligner) -> None:
        self._air, self._aligner = air, aligner
        self._dice = np.random.default_rng(5)
        self.truth = TRUE
        self.outcomes: list[Sighted] = []
        self._due_s = 0.0
        self._number = 0

    def attitude(self) -> Rotation:
        """Return the turn from the body (forward, left, up) to the common frame."""
        body = self._air.autopilot.flight.body
        local = Rotation.from_euler("ZYX", [0.0, -body.pitch_rad, body.roll_rad])
        return Rotation.from_euler("z", self.truth.yaw_rad) * local

    def place(self) -> FloatArray:
        """Return where the vehicle truly is in the common frame."""
        return np.array(self.truth.to_common(self._air.autopilot.flight.body.position))

    def offset(self, common: object) -> FloatArray:
        """Return where a place of the common frame is from the body, with noise."""
        away = self.attitude().inv().apply(np.asarray(common) - self.place())
        return np.asarray(away + self._dice.normal(0.0, NOISE_M, 3))

    def look(self, now_s: float) -> None:
        if now_s < self._due_s:
            return
        self._due_s = now_s + 0.1
        self._number += 1
        tag = self._number % len(TAGS)
        seen = TagSighting(tag, self.offset(TAGS[tag]), NOISE_M**2 * np.eye(3))
        self.outcomes.append(self._aligner.sight(seen, now_s))


def flight(drift: Drift | None = None) -> tuple[Air, TagAligner, Camera]:
    aligner = TagAligner(PLACES, TagAlignerSettings(drift=drift or Drift()))
    air = build(Autopilot.ARDUPILOT, aligner=aligner, start=Start.AIRBORNE)
    return air, aligner, Camera(air, aligner)


def test_it_is_nowhere_until_it_has_seen_enough() -> None:
    air, aligner, camera = flight()
    air.run(2.0)
    assert air.session.state(air.now_s) is None
    assert aligner.reason == "no tag of known place has been seen"
    air.run(3.0, camera.look)
    assert camera.outcomes.count(Sighted.REGISTERED) == 1
    assert camera.outcomes.count(Sighted.OUTLIER) <= 1
    assert aligner.reason == ""
    state = air.session.state(air.now_s)
    assert state is not None
    assert math.dist(state.position, camera.place()[:2]) < 0.05
    assert state.altitude_m == pytest.approx(camera.place()[2], abs=0.05)
    assert aligner.alignment is not None
    assert abs(aligner.alignment.yaw_rad - TRUE.yaw_rad) < math.radians(1.0)


def test_setpoints_of_the_common_frame_are_flown_there() -> None:
    air, _, camera = flight()
    air.run(3.0, camera.look)
    goal = camera.place()[:2] + np.array([1.5, 1.0])

    def towards(now_s: float) -> Setpoint:
        camera.look(now_s)
        away = goal - camera.place()[:2]
        speed = away / max(np.linalg.norm(away), 1.0)
        return Setpoint(7, (float(speed[0]), float(speed[1])), tuple(goal), 2.0, 0.5)

    air.flown(8.0, towards)
    assert math.dist(camera.place()[:2], goal) < 0.15


def test_a_frame_that_drifts_is_followed() -> None:
    """The local frame wanders by a metre and ten degrees in 50 s."""
    air, aligner, camera = flight(Drift(shift_m=0.1, turn_rad=0.02))
    air.run(3.0, camera.look)

    def drifting(now_s: float) -> None:
        east, north, up = camera.truth.shift
        yaw = camera.truth.yaw_rad + math.radians(0.2) * 0.02
        camera.truth = Alignment((east + 0.02 * 0.02, north, up), yaw)
        camera.look(now_s)

    air.run(50.0, drifting)
    state = air.session.state(air.now_s)
    assert state is not None
    assert math.dist(state.position, camera.place()[:2]) < 0.1
    assert camera.outcomes.count(Sighted.LOST) == 0
    assert aligner.covariance is not None
    assert aligner.covariance[3, 3] < math.radians(3.0) ** 2


def test_a_frame_that_jumps_is_given_up_and_found_again() -> None:
    air, aligner, camera = flight()
    air.run(3.0, camera.look)
    camera.truth = Alignment((-4.0, 1.0, 0.3), -1.0)
    camera.outcomes.clear()
    air.run(1.1, camera.look)
    assert camera.outcomes.count(Sighted.LOST) == 1
    assert Sighted.TAKEN not in camera.outcomes
    assert air.session.state(air.now_s) is None, "a place known to be wrong is none"
    assert "jumped" in aligner.reason or "more sightings" in aligner.reason
    air.run(2.0, camera.look)
    state = air.session.state(air.now_s)
    assert state is not None
    assert math.dist(state.position, camera.place()[:2]) < 0.1


def test_a_tag_seen_from_nobody_knows_where_is_ignored() -> None:
    aligner = TagAligner(PLACES, TagAlignerSettings())
    seen = TagSighting(0, np.ones(3), np.eye(3))
    assert aligner.sight(seen, 10.0) is Sighted.IGNORED
    assert aligner.stance(10.0) is None
    air, heard, camera = flight()
    air.run(2.0, camera.look)
    assert heard.sight(seen, air.now_s + 5.0) is Sighted.IGNORED, "its position is stale"
    unknown = TagSighting(99, np.ones(3), np.eye(3))
    assert heard.sight(unknown, air.now_s) is Sighted.IGNORED


def test_tags_on_targets_become_detections_of_the_common_frame() -> None:
    air, aligner, camera = flight()
    senses = TagSenses(7, {50: 122, 51: 124}, aligner)
    target = camera.place() + TARGET
    seen = TagSighting(50, camera.offset(target), NOISE_M**2 * np.eye(3))
    senses.look([seen], air.now_s)
    assert senses.detect([122, 124]) is None, "it does not know where it is"
    air.run(4.0, camera.look)
    target = camera.place() + TARGET
    seen = TagSighting(50, camera.offset(target), NOISE_M**2 * np.eye(3))
    senses.look([seen], air.now_s)
    detections = senses.detect([122, 124])
    assert detections is not None
    (sighting,) = detections.sightings
    assert sighting.target_id == 122
    where = np.array(detections.position) + sighting.range_m * np.array(
        [math.cos(sighting.bearing_rad), math.sin(sighting.bearing_rad)]
    )
    assert math.dist(where, target[:2]) < 0.25
    assert senses.detect([122]) is None, "each picture is told once"
    senses.look([seen], air.now_s)
    others = senses.detect([124])
    assert others is not None
    assert others.sightings == ()
    assert senses.take_incidents() == ()
    assert not senses.failures().sensing
