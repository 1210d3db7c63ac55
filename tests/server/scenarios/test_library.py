"""Finding scenarios by name, by path and inline; and the ones that come with Falconer."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from llm.verification import Limits
from server.mission.setup import MissionSetup
from server.scenarios.errors import ScenarioError
from server.scenarios.library import inline, load, named, names
from server.scenarios.schema import Scenario
from solver.zones import ZoneKind
from tests.server.scenarios.documents import document, experiment
from vehicles.world.motion import Linear, RandomWalk, at_time
from vehicles.world.setup import WorldSetup

EXPERIMENT = Path(__file__).parent / "experiment.yaml"


def test_the_scenarios_that_come_with_falconer_are_found() -> None:
    assert names() == ("ablation", "demo", "four-by-eight", "hardware", "mixed", "unseen")
    for name in names():
        assert load(name) == named(name)
        assert named(name).name == name


def test_a_misspelt_name_gets_a_suggestion() -> None:
    with pytest.raises(ScenarioError, match=r'of that name, did you mean "demo"\?'):
        load("dmo")
    with pytest.raises(
        ScenarioError, match="there are: ablation, demo, four-by-eight, hardware, mixed, unseen"
    ):
        load("zzzzz")


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "demo.yaml", "scenarios/demo", ""])
def test_a_name_never_reads_a_file(name: str) -> None:
    with pytest.raises(ScenarioError, match="there is no scenario of that name"):
        named(name)


def test_a_file_of_ours_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document()))
    assert load(str(path)) == inline(document())


def test_a_file_of_the_authors_is_known_by_its_keys_and_named_after_the_file(
    tmp_path: Path,
) -> None:
    path = tmp_path / "exp 9.yml"
    path.write_text(yaml.safe_dump(experiment()))
    scenario = load(str(path))
    assert scenario.name == "exp-9"
    assert scenario.mission_setup().robot_ids == (21, 26)


def test_a_file_that_breaks_the_rules_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(document() | {"colour": "red"}))
    with pytest.raises(ScenarioError) as caught:
        load(str(path))
    assert str(caught.value) == f"{path}: colour: unknown key"
    with pytest.raises(ScenarioError, match=r"missing\.yaml: cannot be read: No such file"):
        load(str(tmp_path / "missing.yaml"))


def test_the_ablation_has_the_numbers_of_the_experiment() -> None:
    """Same numbers in the authors' format and in ours: the same mission in the same world."""
    ours, theirs = named("ablation"), load(str(EXPERIMENT))
    ignored = {"name", "description", "zones"}
    assert ours.model_dump(exclude=ignored) == theirs.model_dump(exclude=ignored)
    assert ours.world_setup().zones == theirs.world_setup().zones


# ------------------------------------------------------- what a good scenario is like


@pytest.fixture(params=names())
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return named(request.param)


@pytest.fixture
def mission(scenario: Scenario) -> MissionSetup:
    return scenario.mission_setup()


@pytest.fixture
def world(scenario: Scenario) -> WorldSetup:
    return scenario.world_setup()


def test_every_one_explains_itself(scenario: Scenario) -> None:
    assert scenario.description


def test_its_weights_are_allowed(mission: MissionSetup) -> None:
    limits = Limits(mission.weight_lower, mission.weight_upper)
    for low, value, high in zip(
        limits.weights_lower, mission.weights, limits.weights_upper, strict=True
    ):
        assert low < value < high


def test_robots_start_outside_every_zone(world: WorldSetup) -> None:
    starts = np.array([robot.position for robot in world.robots])
    for zone in world.zones:
        assert (zone.zone.density(starts) < world.recover_density / 4).all()


def test_a_robot_at_the_rim_of_a_known_zone_recovers(world: WorldSetup) -> None:
    """Else a blinded robot that keeps out as it should would stay blind for ever."""
    angles = np.linspace(0.0, 2.0 * np.pi, 90)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for zone in (entry.zone for entry in world.zones):
        spread = np.einsum("ij,jk,ik->i", directions, np.array(zone.covariance), directions)
        margin = zone.margin if zone.kind is ZoneKind.SENSING else 0.0
        radius = zone.quantile() * np.sqrt(spread) + margin - 0.05
        rim = np.array(zone.mean) + directions * radius[:, None]
        assert (zone.density(rim) < world.recover_density).all()


def test_zones_matter(scenario: Scenario, world: WorldSetup) -> None:
    """Every zone lies on some target's way."""
    times = np.arange(0.0, scenario.steps * scenario.tick_s, 0.5)
    ways = []
    for target in world.targets:
        assert not isinstance(target.motion, RandomWalk)
        if isinstance(target.motion, Linear):
            way = np.array(target.position) + times[:, None] * np.array(target.velocity)
        else:
            places = [at_time(target.motion, target.position, t, 0.1).position for t in times]
            way = np.array(places)
        ways.append(way)
    for zone in world.zones:
        nearest = min(np.linalg.norm(way - np.array(zone.zone.mean), axis=1).min() for way in ways)
        assert nearest < 1.0


def test_targets_of_our_own_stay_in_the_field(world: WorldSetup, mission: MissionSetup) -> None:
    for target in world.targets:
        if isinstance(target.motion, Linear | RandomWalk):
            assert mission.name == "ablation"  # as the paper has it
            continue
        for time_s in np.arange(0.0, mission.duration_s, 1.0):
            x, y = at_time(target.motion, target.position, time_s, 0.1).position
            assert mission.field_lower[0] < x < mission.field_upper[0]
            assert mission.field_lower[1] < y < mission.field_upper[1]


def test_robots_are_faster_than_targets(world: WorldSetup) -> None:
    slowest = min(min(robot.control_upper) for robot in world.robots)
    for target in world.targets:
        if isinstance(target.motion, Linear | RandomWalk):
            speed = np.hypot(*target.velocity)
        else:
            speed = np.hypot(*at_time(target.motion, target.position, 30.0, 0.1).velocity)
        assert speed < 0.6 * slowest


def test_the_demo_lasts_and_leaves_something_to_say() -> None:
    mission = named("demo").mission_setup()
    assert mission.duration_s >= 600.0
    assert len(mission.robots) == 4
    assert len(mission.targets) == 6
    assert 1 not in mission.initial_directives().targets_of(0)


def test_the_hardware_case_is_the_papers() -> None:
    scenario = named("hardware")
    mission, world = scenario.mission_setup(), scenario.world_setup()
    assert (mission.robot_ids, mission.target_ids) == ((21, 26), (122, 124))
    kinds = [zone.zone.kind for zone in world.zones]
    assert (kinds.count(ZoneKind.SENSING), kinds.count(ZoneKind.COMMUNICATION)) == (2, 1)
    assert mission.initial_directives().targets_of(21) == (122, 124)
    assert mission.initial_directives().targets_of(26) == (122, 124)


def test_four_by_eight_is_nearly_full() -> None:
    mission = named("four-by-eight").mission_setup()
    assert (len(mission.robots), len(mission.targets)) == (4, 8)
    assert len(named("four-by-eight").zones) == 8
    assert sum(robot.capacity for robot in mission.robots) == 9
