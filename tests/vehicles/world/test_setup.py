"""A world that makes no sense is refused with the item and the field."""

from dataclasses import replace

import pytest

from solver.problem import SensorModel
from solver.zones import ZoneKind
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles.world.motion import Circle, Motion, RandomWalk, Replay, Waypoints
from vehicles.world.setup import WorldTarget

NAN = float("nan")


def test_ids_are_unique() -> None:
    with pytest.raises(ValueError, match="robots: id 21 "):
        world_setup((robot(21, 0.0), robot(26, 1.0), robot(21, 2.0)))
    with pytest.raises(ValueError, match="targets: id 5 "):
        world_setup((), (WorldTarget(5, (0.0, 0.0)), WorldTarget(5, (1.0, 0.0))))
    with pytest.raises(ValueError, match="zones: id s1 "):
        world_setup((), (), (zone("s1", ZoneKind.SENSING), zone("s1", ZoneKind.COMMUNICATION)))


def test_numbers_are_finite() -> None:
    with pytest.raises(ValueError, match="robot 21: position: nan"):
        world_setup((robot(21, NAN),))
    with pytest.raises(ValueError, match="target 7: velocity: inf"):
        world_setup((), (WorldTarget(7, (0.0, 0.0), (float("inf"), 0.0)),))
    with pytest.raises(ValueError, match="zone s1: mean: nan"):
        world_setup((), (), (zone("s1", ZoneKind.SENSING, (NAN, 0.0)),))


@pytest.mark.parametrize(
    "covariance",
    [((-1.0, 0.0), (0.0, 1.0)), ((1.0, 2.0), (2.0, 1.0)), ((1.0, 0.5), (0.1, 1.0))],
)
def test_covariances_are_positive_definite(
    covariance: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    with pytest.raises(ValueError, match="zone s1: covariance"):
        world_setup((), (), (zone("s1", ZoneKind.SENSING, covariance=covariance),))


@pytest.mark.parametrize(
    ("motion", "field"),
    [
        (RandomWalk(-0.1), "deviation"),
        (Waypoints((), 1.0), "points"),
        (Waypoints(((0.0, 0.0),), 0.0), "speed_m_s"),
        (Circle((0.0, NAN), 1.0), "circle"),
        (Replay((0.0, 1.0), ((0.0, 0.0),)), "replay"),
        (Replay((1.0, 1.0), ((0.0, 0.0), (1.0, 1.0))), "replay"),
    ],
)
def test_motions_make_sense(motion: Motion, field: str) -> None:
    with pytest.raises(ValueError, match=f"target 7: {field}"):
        world_setup((), (WorldTarget(7, (0.0, 0.0), motion=motion),))


def test_the_rest_makes_sense() -> None:
    upside_down = replace(robot(21, 0.0), control_lower=(2.0, -1.0))
    with pytest.raises(ValueError, match=r"robot 21: control box: 2\.0 lies above 1\.0"):
        world_setup((upside_down,))
    with pytest.raises(ValueError, match="attack_period_s: 0"):
        world_setup((), attack_period_s=0.0)
    sound = world_setup(())
    with pytest.raises(ValueError, match="detection_range_m"):
        replace(sound, detection_range_m=-1.0)
    with pytest.raises(ValueError, match=r"sensor\.range_peak"):
        replace(sound, sensor=SensorModel(range_peak=0.0))
    shrinking = replace(zone("s1", ZoneKind.SENSING), growth_m2_s=-0.1)
    with pytest.raises(ValueError, match="zone s1: growth_m2_s"):
        world_setup((), (), (shrinking,))
