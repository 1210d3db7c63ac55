"""Setups survive JSON; damaged ones are refused with the field."""

import json
from typing import Any

import pytest

from solver.zones import ZoneKind
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles.world.files import WorldFileError, dump, load
from vehicles.world.motion import Circle, Linear, Motion, RandomWalk, Replay, Waypoints
from vehicles.world.setup import WorldSetup, WorldTarget

MOTIONS: tuple[Motion, ...] = (
    Linear(),
    RandomWalk(0.2),
    Waypoints(((1.0, 2.0),), 0.5),
    Circle((0.0, 1.0), -0.3),
    Replay((0.0, 1.0), ((0.0, 0.0), (1.0, 1.0))),
)


def rich_setup() -> WorldSetup:
    targets = tuple(
        WorldTarget(100 + index, (float(index), 0.0), motion=motion)
        for index, motion in enumerate(MOTIONS)
    )
    zones = (zone("s1", ZoneKind.SENSING), zone("c1", ZoneKind.COMMUNICATION))
    return world_setup((robot(21, 0.0), robot(26, 1.0)), targets, zones)


def test_a_setup_survives_the_way_through_json() -> None:
    setup = rich_setup()
    again = load(dump(setup))
    assert again.targets == setup.targets
    assert again.robots == setup.robots
    assert again.zones == setup.zones
    assert dump(again) == dump(setup)
    assert "\n" not in dump(setup)


def damaged(**changes: Any) -> str:
    return json.dumps({**json.loads(dump(rich_setup())), **changes})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "JSON"),
        ("[]", "world"),
        (damaged(robots=[{"id": 1}]), r"robots\.0\.position"),
        (damaged(noise="loud"), "noise"),
        (damaged(attack_period_s=-1.0), "attack_period_s: -1.0"),
        (damaged(recover_density=float("nan")), "recover_density"),
    ],
)
def test_a_damaged_setup_is_refused_with_the_field(text: str, words: str) -> None:
    with pytest.raises(WorldFileError, match=words):
        load(text)
