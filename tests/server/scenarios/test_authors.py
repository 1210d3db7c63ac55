"""Files in the format of the paper's authors: unchanged in, their meaning out."""

from typing import Any

import pytest

from server.mission.setup import Compat, GateMode
from server.scenarios.authors import convert, is_authors
from server.scenarios.errors import ScenarioError
from server.scenarios.parts import PlannerPart
from server.scenarios.schema import Scenario
from solver.beliefs import MotionModel
from solver.directives import Pairing, Weights
from solver.observations import TargetPrior
from solver.problem import Dynamics, SensorModel
from solver.zones import ZoneKind
from tests.server.scenarios.documents import Path, changed, document, experiment, without
from vehicles.world.motion import Linear
from vehicles.world.setup import Discovery, JammingLaw, NoiseLaw


@pytest.fixture
def scenario() -> Scenario:
    return convert(experiment(), "exp.yaml", "exp")


def _refusal(data: dict[str, Any]) -> str:
    with pytest.raises(ScenarioError) as caught:
        convert(data, "exp.yaml", "exp")
    return str(caught.value)


def test_their_files_are_known_by_their_sections() -> None:
    assert is_authors(experiment())
    assert not is_authors(document())
    assert not is_authors({"Problem": {}})


def test_time_is_in_seconds(scenario: Scenario) -> None:
    setup = scenario.mission_setup()
    assert (setup.tick_s, setup.steps, setup.duration_s) == (0.25, 300, 75.0)
    assert (setup.loops.action_period_s, setup.loops.task_period_s) == (2.0, 8.0)
    assert setup.planner.min_dist_m == 0.45
    assert setup.planner.attack_period_s == scenario.attacks.period_s == 0.5


def test_ids_are_kept(scenario: Scenario) -> None:
    setup = scenario.mission_setup()
    assert setup.robot_ids == (21, 26)
    assert setup.target_ids == (122, 124, 125)
    assert setup.assignment == {Pairing(21, 122), Pairing(21, 125), Pairing(26, 124)}


def test_weights_come_in_the_papers_order(scenario: Scenario) -> None:
    weights = scenario.mission_setup().weights
    assert weights == Weights(tracking=5.0, control=0.02, sensing=60.0, communication=70.0)


def test_bounds_are_per_axis(scenario: Scenario) -> None:
    setup = scenario.mission_setup()
    assert (setup.field_lower, setup.field_upper) == ((-8.0, -3.0), (8.0, 4.0))
    robot = setup.robots[0]
    assert (robot.control_lower, robot.control_upper) == ((-0.4, -0.4), (0.6, 0.6))
    assert (robot.speed_limit_m_s, robot.capacity) == (0.6, 2)
    assert setup.dynamics is Dynamics.SINGLE_INTEGRATOR


def test_robots_without_a_height_get_layers_of_their_own() -> None:
    data = experiment()
    heights = [robot.altitude_m for robot in convert(data, "f", "f").mission_setup().robots]
    assert heights == [1.0, 1.5]
    data = changed(data, ("Problem", "robotHeights"), [1.0, 1.7, 9.0])
    assert [robot.altitude_m for robot in convert(data, "f", "f").robots] == [1.0, 1.7]
    data = without(data, ("Problem", "robotHeights"))
    heights = [robot.altitude_m for robot in convert(data, "f", "f").robots]
    assert heights == [1.0, 1.5]


def test_the_filter_is_theirs(scenario: Scenario) -> None:
    setup = scenario.mission_setup()
    assert setup.filter.model is MotionModel.RANDOM_WALK
    assert setup.filter.process_noise * setup.tick_s == pytest.approx(0.05, rel=1e-15)
    assert setup.filter.gate_probability is None
    assert setup.filter.drop_after_s > setup.duration_s
    priors = [target.prior for target in setup.targets]
    cloud = ((0.2, 0.0), (0.0, 0.2))
    assert priors[1] == TargetPrior(124, (-1.0, -0.5), cloud)
    assert setup.sensor.range_peak == 14.0
    assert setup.sensor.bearing_shape == 0.3


def test_figures_can_be_compared(scenario: Scenario) -> None:
    setup, world = scenario.mission_setup(), scenario.world_setup()
    assert (setup.compat, setup.gate, setup.seed) == (Compat.AUTHORS, GateMode.OFF, 3)
    assert (world.noise, world.jamming) == (NoiseLaw.AUTHORS, JammingLaw.AUTHORS)
    assert world.discovery is Discovery.ORACLE
    assert (world.attack_period_s, world.recover_density) == (0.5, 0.2)
    assert world.detection_range_m is None


def test_targets_keep_their_velocity(scenario: Scenario) -> None:
    target = scenario.world_setup().targets[1]
    assert (target.id, target.position, target.velocity) == (124, (-1.0, -0.5), (0.12, 0.01))
    assert target.motion == Linear()


def test_surplus_zones_are_left_out_and_risks_are_told_apart(scenario: Scenario) -> None:
    sensing, communication = (zone.zone for zone in scenario.world_setup().zones)
    assert (sensing.id, sensing.kind) == ("s0", ZoneKind.SENSING)
    assert sensing.covariance == ((0.3, 0.0), (0.0, 0.5))
    assert (sensing.margin, sensing.risk) == (0.15, 0.1)
    assert (communication.id, communication.kind) == ("c0", ZoneKind.COMMUNICATION)
    assert communication.mean == (3.0, -1.0)
    assert (communication.margin, communication.risk) == (0.25, 0.05)
    assert communication.risk_single == 0.05


def test_no_zone_of_a_kind_needs_no_lists() -> None:
    data = changed(experiment(), ("Zones", "nTypeII"), 0)
    for key in ("typeII_mu", "typeII_cov", "typeII_delta"):
        data = without(data, ("Zones", key))
    assert [zone.id for zone in convert(data, "f", "f").zones] == ["s0"]


def test_robots_may_start_closer_than_the_least_distance() -> None:
    data = changed(experiment(), ("Problem", "robotStartPos"), [[0.0, 0.2], [0.0, -0.2]])
    assert convert(data, "f", "f").planner.min_dist_m == 0.45


def test_more_stages_are_more_steps_ahead() -> None:
    data = changed(experiment(), ("Problem", "N"), 6)
    planner = convert(data, "f", "f").planner
    assert (planner.horizon, planner.plan_step_s) == (5, 0.25)


def test_no_look_ahead_is_shorter_than_a_time_step() -> None:
    assert (
        convert(changed(experiment(), ("Problem", "dt"), 0.8), "f", "f").planner.plan_step_s == 0.8
    )


def test_their_only_number_of_stages_leaves_the_look_ahead_to_our_defaults() -> None:
    ours, planner = PlannerPart(), convert(experiment(), "f", "f").planner
    assert (planner.horizon, planner.plan_step_s) == (ours.horizon, ours.plan_step_s)
    assert planner.sensing_failure_s == ours.sensing_failure_s > 0.0
    assert planner.communication_failure_s == ours.communication_failure_s > 0.0


REFUSED: list[tuple[Path, object, str]] = [
    (("Problem", "dim"), 3, "Problem.dim: must be 2, got 3"),
    (
        ("Problem", "robot_dyn_type"),
        "second_order_dynamics",
        "Problem.robot_dyn_type: must be first_order_dynamics, got 'second_order_dynamics'",
    ),
    (("Problem", "target_dyn_type"), "other", "target_dyn_type: must be second_order_dynamics"),
    (("Problem", "robotStartPos"), [[0, 0, 1], [1, 1, 1]], "robotStartPos[0]: has 3 entries, exac"),
    (("Problem", "robotStartPos"), [[0, 0]], "robotStartPos: has 1 entries, 2 or more are needed"),
    (("Problem", "targetStartVel"), [[0, 0]], "Problem.targetStartVel: has 1 entries, 3 or more"),
    (("Problem", "robotID"), [21, 21], "Problem.robotID: 21 stands here twice; ids are unique"),
    (("Problem", "targetID"), [1, 2, 2], "Problem.targetID: 2 stands here twice"),
    (("Problem", "assignment_matrix"), [[1, 1, 1]], "has 1 rows, one per robot is needed (2)"),
    (("Problem", "assignment_matrix", 1), [0, 1], "[1]: has 2 entries, one per target is needed"),
    (("Problem", "assignment_matrix", 0), [1, 1, 1], "task_ability is 2 (allowed: 2 or fewer)"),
    (("Problem", "assignment_matrix", 0), [2, 0, 0], "assignment_matrix[0][0]: must be 0 or 1"),
    (("Problem", "assignment_matrix", 0), [0, 0, 1], "leaves 1 of 3 targets to nobody (122)"),
    (("Problem", "task_ability"), 0, "Problem.assignment_matrix[0]: gives the robot 2 targets"),
    (("Problem", "weights"), [0.1, 10.0, -5.0, 1.0], "Problem.weights[2]: must be at least 1e-06"),
    (("Problem", "weights"), [0.1, 10.0, 5.0], "Problem.weights[3]: is missing"),
    (("Problem", "dt"), 0, "Problem.dt: must be at least 0.01 and at most 3600, got 0"),
    (("Problem", "robotStartPos", 1), [float("nan"), 0], "robotStartPos[1][0]: must be a finite"),
    (("Problem", "robotStartPos", 1), [9.0, 0], "lies outside the field (allowed: -8 to 8)"),
    (("Zones", "typeI_cov"), [[-0.3, 0.3]], "Zones.typeI_cov[0][0]: must be at least 1e-06 and"),
    (("Zones", "typeI_delta"), [], "Zones.typeI_delta: has 0 entries, 1 or more are needed"),
    (("Zones", "nTypeII"), 3, "Zones.typeII_mu: has 2 entries, 3 or more are needed"),
    (("Zones", "typeII_mu", 0), [3.0], "Zones.typeII_mu[0]: has 1 entries, exactly 2 are needed"),
    (("Zones", "eps2"), 0.2, "Zones.eps2: must be at least 0.5 and below 1, got 0.2"),
    (("steps",), 0, "steps: must be at least 1"),
]


@pytest.mark.parametrize(("path", "value", "words"), REFUSED)
def test_what_does_not_fit_is_named_as_in_the_file(path: Path, value: object, words: str) -> None:
    message = _refusal(changed(experiment(), path, value))
    assert words in message
    assert message.startswith("exp.yaml: ")


@pytest.mark.parametrize("path", [("Problem", "robotID"), ("Zones", "eps1"), ("llm_inner_dur",)])
def test_a_missing_key_is_named_as_in_the_file(path: Path) -> None:
    assert f"exp.yaml: {'.'.join(map(str, path))}: is missing" in _refusal(
        without(experiment(), path)
    )


def test_the_sensor_is_read_as_peak_and_shape(scenario: Scenario) -> None:
    sensor = scenario.sensor_model()
    assert isinstance(sensor, SensorModel)
    assert (sensor.range_peak, sensor.range_shape) == (14.0, 0.1)
    assert (sensor.bearing_peak, sensor.bearing_shape) == (13.0, 0.3)
