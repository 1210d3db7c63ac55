"""What a team makes of its chances: two lines of sight, and ways around what it knows."""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from server.lockstep.council import Council
from server.lockstep.driver import Lockstep
from server.mission.core import MissionCore
from server.mission.tape import NoTape, TapedCore
from server.scenarios.schema import Scenario
from solver import engines
from solver.observations import ZoneDrawn
from solver.planner import Planner
from solver.streams import Streams
from solver.zones import Point, Zone, ZoneKind
from vehicles.world.state import Truth
from vehicles.world.world import World

SPREAD_M = 0.7
"""Standard deviation of the zones."""


def scenario(
    robots: list[Point],
    targets: list[dict[str, Any]],
    assignment: dict[int, tuple[int, ...]],
    steps: int,
) -> Scenario:
    """Return a world without zones: robots 21, 22, ..., targets 122, 123, ..."""
    return Scenario.model_validate(
        {
            "name": "teamwork",
            "tick_s": 0.2,
            "steps": steps,
            "field": {"lower": (-8.0, -8.0), "upper": (8.0, 8.0)},
            "robots": [
                {"id": 21 + i, "position": place, "altitude_m": 1.0 + i, "capacity": 4}
                for i, place in enumerate(robots)
            ],
            "targets": [
                {
                    "id": 122 + j,
                    "prior": {"mean": t["position"], "covariance": ((0.2, 0.0), (0.0, 0.2))},
                    **t,
                }
                for j, t in enumerate(targets)
            ],
            "assignment": assignment,
        }
    )


def flown(
    given: Scenario, known: tuple[Zone, ...], look: Callable[[Truth], None], seed: int = 0
) -> None:
    """Fly with some zones known from the start (to the team; the world has none)."""
    setup = given.varied(seed=seed).mission_setup()
    core = MissionCore(setup)
    for zone in known:
        core.observe(ZoneDrawn(zone))
    world = World(given.world_setup(), Streams(setup.seed))
    planner = Planner(engines.create(engines.default_engine()))
    council = Council(TapedCore(core, NoTape()), setup.gate, planner)
    mission = Lockstep(setup, world, council, planner, None)
    asyncio.run(mission.run(lambda _: look(world.truth())))


def angle_of_sight(truth: Truth) -> float:
    """Return the angle (degrees) between two robots as the first target sees them."""
    target = np.array(truth.targets[0].position)
    first, second = (np.array(robot.position) - target for robot in truth.robots)
    cosine = first @ second / max(float(np.hypot(*first) * np.hypot(*second)), 1e-9)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


@pytest.mark.parametrize("seed", range(3))
def test_two_robots_on_one_target_look_at_it_from_different_sides(seed: int) -> None:
    """They start beside each other; crosswise each makes up for the other's bearing."""
    given = scenario(
        [(-5.0, 0.3), (-5.0, -0.3)],
        [{"position": (0.0, 0.0), "motion": {"kind": "linear", "velocity": (0.05, 0.0)}}],
        {21: (122,), 22: (122,)},
        150,
    )
    angles: list[float] = []
    flown(given, (), lambda truth: angles.append(angle_of_sight(truth)), seed)
    assert angles[0] < 10.0
    settled = np.array(angles[75:])
    assert 60.0 < np.median(settled) < 150.0
    assert np.percentile(settled, 10) > 40.0


@pytest.mark.parametrize("kind", ZoneKind)
def test_nobody_follows_a_target_through_a_zone_that_is_known(kind: ZoneKind) -> None:
    """The target goes straight through the middle; who follows it goes around."""
    target = {"position": (-4.0, 0.0), "motion": {"kind": "linear", "velocity": (0.2, 0.0)}}
    given = scenario(
        [(-5.0, 0.5), (2.0, -4.0)],
        [target, {"position": (1.0, -4.0)}],
        {21: (122,), 22: (123,)},
        200,
    )
    zone = Zone("z", kind, (0.0, 0.0), ((SPREAD_M**2, 0.0), (0.0, SPREAD_M**2)), 0.1, 0.1)

    def nearest(known: tuple[Zone, ...]) -> tuple[float, float]:
        """Return how near to the middle the robot came, in deviations, and its last distance."""
        paths: list[tuple[float, float]] = []

        def look(truth: Truth) -> None:
            place = np.array(truth.robots[0].position)
            gap = place - truth.targets[0].position
            paths.append((float(np.hypot(*place)) / SPREAD_M, float(np.hypot(*gap))))

        flown(given, known, look)
        return min(near for near, _ in paths), paths[-1][1]

    through, _ = nearest(())
    around, left_behind_m = nearest((zone,))
    assert through < 0.7
    assert around > 1.3
    assert left_behind_m < 0.7, "it comes out on the other side with its target"


def spells(seed: int) -> list[int]:
    """How many steps robot 21 was cut off at a time, its target leading through a hidden zone."""
    target = {
        "position": (-3.0, 0.0),
        "motion": {"kind": "waypoints", "points": [(4.0, 0.0)], "speed_m_s": 0.3},
    }
    made = scenario([(-4.0, 0.5)], [target], {21: (122,)}, steps=150)
    jamming = {"kind": "communication", "mean": (0.0, 0.0), "covariance": ((0.5, 0.0), (0.0, 0.5))}
    hidden = Scenario.model_validate(
        made.model_dump() | {"zones": [{"id": "c1", **jamming}], "discovery": "inferred"}
    )
    cut_off: list[bool] = []
    flown(hidden, (), lambda truth: cut_off.append(truth.robots[0].failures.communication), seed)
    marks = "".join("x" if each else " " for each in cut_off)
    return [len(spell) for spell in marks.split()]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_robot_finds_out_of_a_zone_that_nothing_reveals(seed: int) -> None:
    told = spells(seed)
    assert told
    assert max(told) <= 10
