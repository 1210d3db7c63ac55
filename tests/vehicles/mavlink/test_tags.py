"""Tags seen by a vehicle's camera, told over MAVLink, lay its frame into the common one."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.vehicles.mavlink.air import STEP_S, Air, build
from vehicles.body import BodyEventKind
from vehicles.localization.aligner import TagAligner, TagAlignerSettings
from vehicles.mavlink.codec import Codec
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import Start
from vehicles.mavlink.frames import Alignment
from vehicles.mavlink.launch import VehicleOptions
from vehicles.mavlink.protocol import mavlink
from vehicles.mavlink.tags import PER_METRE, STILL_M, sighting_of
from vehicles.mavlink.udp import Endpoint, Side

TAGS = {0: (0.0, 0.0, 1.5), 1: (4.0, 0.0, 1.0), 2: (4.0, 3.0, 1.5), 3: (0.0, 3.0, 2.0)}
CAMERA = mavlink.MAV_COMP_ID_CAMERA
TRUE = Alignment((1.5, -2.0, 0.3), 0.8)
"""Where the vehicle's local frame really lies."""


def landing_target(tag: int, place: tuple[float, float, float], **changes: Any) -> Any:
    """Return the message of a tag seen forward, right and down of the body."""
    fields: dict[str, Any] = {
        "time_usec": 0,
        "target_num": tag,
        "frame": mavlink.MAV_FRAME_BODY_FRD,
        "angle_x": 0.0,
        "angle_y": 0.0,
        "distance": 0.0,
        "size_x": 0.0,
        "size_y": 0.0,
        **dict(zip("xyz", place, strict=True)),
        "q": [1.0, 0.0, 0.0, 0.0],
        "type": 2,
        "position_valid": 1,
    } | changes
    return mavlink.MAVLink_landing_target_message(**fields)


class Camera:
    """A companion that tells of one tag after the other, ten a second."""

    def __init__(self, air: Air, system: int = 7, **changes: Any) -> None:
        self._air, self._changes = air, changes
        self._codec = Codec(system, CAMERA, None, None)
        self._due_s, self._number = 0.0, 0
        self.truth = TRUE

    def look(self, now_s: float) -> None:
        if now_s < self._due_s:
            return
        self._due_s = now_s + 0.1
        self._number += 1
        tag = self._number % len(TAGS)
        body = self._air.autopilot.flight.body
        local = Rotation.from_euler("ZYX", [0.0, -body.pitch_rad, body.roll_rad])
        turn = Rotation.from_euler("z", self.truth.yaw_rad) * local
        away = np.array(TAGS[tag]) - np.array(self.truth.to_common(body.position))
        forward, left, up = turn.inv().apply(away).tolist()
        message = landing_target(tag, (forward, -left, -up), **self._changes)
        self._air.session.receive(self._codec.encode(message, now_s), now_s)


def indoors() -> Air:
    aligner = TagAligner(TAGS, TagAlignerSettings())
    return build(Autopilot.ARDUPILOT, aligner=aligner, tags=aligner, start=Start.AIRBORNE)


def test_the_tags_place_the_vehicle_in_the_team() -> None:
    air = indoors()
    air.run(1.0)
    assert air.session.state(air.now_s) is None
    camera = Camera(air)
    air.run(5.0, camera.look)
    state = air.session.state(air.now_s)
    assert state is not None
    x, y, z = TRUE.to_common(air.autopilot.flight.body.position)
    assert state.position == pytest.approx((x, y), abs=0.05)
    assert state.altitude_m == pytest.approx(z, abs=0.05)


def test_a_frame_that_jumps_is_told_and_sought_anew() -> None:
    air = indoors()
    camera = Camera(air)
    air.run(5.0, camera.look)
    assert air.session.state(air.now_s) is not None
    camera.truth = Alignment((4.5, 1.0, 0.3), 0.8)
    air.run(2.0, camera.look)
    lost = [e for e in air.events if e.kind is BodyEventKind.POSITION_LOST]
    assert [event.text for event in lost] == [
        "the tags are not where they should be: its frame has jumped"
    ]
    air.run(5.0, camera.look)
    state = air.session.state(air.now_s)
    assert state is not None
    x, y, _ = camera.truth.to_common(air.autopilot.flight.body.position)
    assert state.position == pytest.approx((x, y), abs=0.05)


@pytest.mark.parametrize(
    "changes",
    [
        {"position_valid": 0},
        {"frame": mavlink.MAV_FRAME_LOCAL_NED},
        {"target_num": 200},
        {"system": 9},
        {"x": math.nan},
        {"z": 1e6},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_what_tells_of_no_tag_of_ours_places_nobody(changes: dict[str, Any]) -> None:
    air = indoors()
    camera = Camera(air, **changes)
    air.run(3.0, camera.look)
    assert air.session.state(air.now_s) is None
    assert (air.session.counts.implausible > 0) == bool({"x", "z"} & set(changes))


def test_a_camera_alone_is_not_the_autopilot() -> None:
    aligner = TagAligner(TAGS, TagAlignerSettings())
    air = build(Autopilot.ARDUPILOT, aligner=aligner, tags=aligner)
    codec = Codec(7, CAMERA, None, None)
    frame = codec.encode(landing_target(0, (1.0, 0.0, 0.0)), STEP_S)
    assert not air.session.receive(frame, STEP_S)
    assert air.session.telemetry.heard_s is None


def test_the_place_on_the_wire_becomes_one_from_the_body() -> None:
    found = sighting_of(landing_target(3, (4.0, 3.0, -12.0)))
    assert found is not None
    assert found.tag_id == 3
    assert found.offset.tolist() == [4.0, -3.0, 12.0]
    spread_m = STILL_M + 13.0 * PER_METRE
    assert found.covariance == pytest.approx(spread_m**2 * np.eye(3))


def test_a_vehicle_with_tags_is_flown_by_them() -> None:
    options = VehicleOptions(7, Endpoint(Side.IN, "127.0.0.1", 0), system=7, tags=TAGS)
    air = build(Autopilot.ARDUPILOT, start=Start.AIRBORNE)
    air.session = options.session()
    camera = Camera(air)
    air.run(5.0, camera.look)
    assert air.session.state(air.now_s) is not None


def test_targets_that_carry_tags_are_seen_for_the_team() -> None:
    link = Endpoint(Side.IN, "127.0.0.1", 0)
    options = VehicleOptions(7, link, system=7, tags=TAGS, targets={50: 122, 51: 124})
    fitting = options.fitting()
    assert fitting.senses is not None
    air = build(Autopilot.ARDUPILOT, start=Start.AIRBORNE)
    air.session = fitting.session
    codec = Codec(7, CAMERA, None, None)

    def see(tag: int, forward_m: float) -> None:
        frame = codec.encode(landing_target(tag, (forward_m, 0.0, 0.0)), air.now_s)
        air.session.receive(frame, air.now_s)

    see(50, 3.0)
    assert fitting.senses.detect([122, 124]) is None, "nobody knows where it looks from"
    air.run(5.0, Camera(air).look)
    see(50, 3.0)
    see(51, 2.0)
    found = fitting.senses.detect([122, 124])
    assert found is not None
    assert {one.target_id: round(one.range_m) for one in found.sightings} == {122: 3, 124: 2}
    see(51, 2.0)
    again = fitting.senses.detect([122, 124])
    assert again is not None
    assert [one.target_id for one in again.sightings] == [124], "what was told is not told twice"


def test_targets_alone_do_not_say_where_they_are_seen_from() -> None:
    options = VehicleOptions(7, Endpoint(Side.IN, "127.0.0.1", 0), system=7, targets={50: 122})
    with pytest.raises(ValueError, match="where tags say where the vehicle is"):
        options.fitting()
