"""Our own scenario documents: what they become, and how each fault is told."""

import math
from collections.abc import Iterable
from typing import Any

import pytest

from server.mission.setup import Compat, GateMode
from server.scenarios import consistency
from server.scenarios.errors import ScenarioError
from server.scenarios.library import inline
from server.scenarios.schema import Scenario, schema
from solver.beliefs import MotionModel
from solver.directives import Pairing, Source, Weights
from solver.observations import TargetPrior
from solver.problem import Dynamics
from solver.zones import ZoneKind
from tests.server.scenarios.documents import Path, changed, document, without
from vehicles.world.motion import Circle, Ending, Linear, RandomWalk, Replay, Waypoints
from vehicles.world.setup import JammingLaw, NoiseLaw

UNITY = [[1.0, 0.0], [0.0, 1.0]]


def _refusal(data: dict[str, Any]) -> str:
    with pytest.raises(ScenarioError) as caught:
        inline(data)
    return str(caught.value)


# --------------------------------------------------------------------- what it becomes


def test_the_mission_is_told_the_team_and_the_task() -> None:
    setup = inline(document()).mission_setup()
    assert setup.robot_ids == (21, 26)
    assert setup.target_ids == (122, 124)
    assert setup.assignment == {Pairing(21, 122), Pairing(26, 124)}
    assert setup.weights == Weights(tracking=10.0, control=0.1, sensing=50.0, communication=40.0)
    assert setup.weight_lower == pytest.approx(Weights(1.0, 0.01, 5.0, 4.0))
    assert setup.weight_upper == pytest.approx(Weights(100.0, 1.0, 500.0, 400.0))
    assert setup.severity_bounds == (1.0, 5.0)
    assert (setup.field_lower, setup.field_upper) == ((-5.0, -4.0), (5.0, 4.0))
    assert (setup.tick_s, setup.live_tick_s) == (0.1, 0.1)
    assert setup.duration_s == pytest.approx(60.0)
    assert (setup.compat, setup.gate) == (Compat.NONE, GateMode.AUTO)
    assert setup.filter.model is MotionModel.CONSTANT_VELOCITY
    robot = setup.robots[1]
    assert (robot.capacity, robot.altitude_m, robot.speed_limit_m_s) == (2, 1.7, 0.5)


def test_the_first_directives_are_the_scenarios_own() -> None:
    directives = inline(document()).mission_setup().initial_directives()
    assert directives.targets_of(21) == (122,)
    assert directives.capacities == ((21, 1), (26, 2))
    assert directives.assignment_source is Source.SCENARIO


def test_targets_without_a_prior_are_unknown_at_the_start() -> None:
    prior = {"mean": [0.1, 1.1], "covariance": UNITY}
    setup = inline(changed(document(), ("targets", 0, "prior"), prior)).mission_setup()
    assert setup.targets[0].prior == TargetPrior(122, (0.1, 1.1), ((1.0, 0.0), (0.0, 1.0)))
    assert setup.targets[1].prior is None


def test_the_world_is_told_the_truth() -> None:
    world = inline(document()).world_setup()
    assert [robot.id for robot in world.robots] == [21, 26]
    assert (world.noise, world.jamming) == (NoiseLaw.SOUND, JammingLaw.LINEAR)
    sensing, communication = (zone.zone for zone in world.zones)
    assert sensing.kind is ZoneKind.SENSING
    assert (sensing.margin, sensing.risk, sensing.risk_single) == (0.1, 0.1, 0.1)
    assert communication.kind is ZoneKind.COMMUNICATION
    assert (communication.margin, communication.risk) == (0.2, 0.05)
    assert communication.covariance == ((0.4, 0.1), (0.1, 0.3))


def test_a_zone_of_its_own_risk_overrules_the_defaults() -> None:
    data = changed(document(), ("zones", 0, "risk"), 0.02)
    data["zone_defaults"] = {"sensing": {"margin": 0.3, "risk": 0.2, "risk_single": 0.25}}
    zone = inline(data).world_setup().zones[0].zone
    assert (zone.margin, zone.risk, zone.risk_single) == (0.3, 0.02, 0.25)
    defaults = inline(data).mission_setup().zone_defaults(ZoneKind.SENSING)
    assert defaults == (0.3, 0.2, 0.25)


@pytest.mark.parametrize(
    ("motion", "expected", "velocity"),
    [
        ({"kind": "linear", "velocity": [0.1, 0.2]}, Linear(), (0.1, 0.2)),
        ({"kind": "random_walk", "deviation": 0.3}, RandomWalk(0.3), (0.0, 0.0)),
        (
            {"kind": "waypoints", "points": [[1, 2]], "speed_m_s": 0.5},
            Waypoints(((1.0, 2.0),), 0.5, Ending.LOOP),
            (0.0, 0.0),
        ),
        (
            {"kind": "circle", "centre": [1, 1], "rate_rad_s": -0.1},
            Circle((1.0, 1.0), -0.1),
            (0.0, 0.0),
        ),
        (
            {"kind": "replay", "times_s": [0, 2.5], "positions": [[0, 0], [1, 0]]},
            Replay((0.0, 2.5), ((0.0, 0.0), (1.0, 0.0))),
            (0.0, 0.0),
        ),
    ],
)
def test_every_motion(motion: dict[str, Any], expected: object, velocity: object) -> None:
    target = inline(changed(document(), ("targets", 0, "motion"), motion)).world_setup().targets[0]
    assert target.motion == expected
    assert target.velocity == velocity


def test_a_double_integrator_needs_a_speed_limit_and_keeps_it() -> None:
    data = document() | {"dynamics": "double_integrator"}
    assert "robots[0].speed_limit_m_s: is needed for a double integrator" in _refusal(data)
    for robot in data["robots"]:
        robot["speed_limit_m_s"] = 0.9
    scenario = inline(data)
    assert scenario.mission_setup().robots[0].speed_limit_m_s == 0.9
    assert scenario.world_setup().robots[0].dynamics is Dynamics.DOUBLE_INTEGRATOR


def test_an_engine_asked_for_comes_before_the_scenarios_own() -> None:
    scenario = inline(changed(document(), ("planner",), {"engine": "ipopt"}))
    assert scenario.mission_setup().planner.engine == "ipopt"
    assert scenario.mission_setup(engine="sqp").planner.engine == "sqp"


def test_weights_may_be_left_out_altogether_but_not_in_part() -> None:
    setup = inline(without(document(), ("weights",))).mission_setup()
    assert setup.weights == Weights(10.0, 0.05, 50.0, 50.0)
    assert "weights.control: is missing" in _refusal(without(document(), ("weights", "control")))


def test_what_a_failure_is_taken_to_cost_reaches_the_planner() -> None:
    asked = {"sensing_failure_s": 0.0, "communication_failure_s": 2.5}
    data = changed(document(), ("planner",), asked) | {"attacks": {"period_s": 0.8}}
    planner = inline(data).mission_setup().planner
    assert (planner.sensing_failure_s, planner.communication_failure_s) == (0.0, 2.5)
    assert planner.attack_period_s == 0.8


def test_a_variation_is_checked_like_the_original() -> None:
    varied = inline(document()).varied(seed=9, steps=12)
    assert (varied.seed, varied.steps) == (9, 12)
    assert varied.varied() == varied
    with pytest.raises(ValueError, match="steps"):
        varied.varied(steps=0)


def test_keys_of_json_are_words_and_mean_the_same() -> None:
    data = changed(document(), ("assignment",), {"21": [122], "26": [124]})
    assert inline(data) == inline(document())


# --------------------------------------------------------------------- what is refused

FIELD_FAULTS: list[tuple[Path, object, str]] = [
    (("robot",), [], 'robot: unknown key, did you mean "robots"?'),
    (("robots", 0, "captivity"), 1, 'robots[0].captivity: unknown key, did you mean "capacity"?'),
    (("targets", 0, "motion"), {"kind": "linear", "speed": 1}, "targets[0].motion.speed: unknown"),
    (("zones", 1, "risk"), 0.7, "zones[1].risk: must be above 0 and at most 0.5, got 0.7"),
    (("zones", 1, "risk"), 0, "zones[1].risk: must be above 0 and at most 0.5, got 0"),
    (("zones", 1, "kind"), "radar", "zones[1].kind: must be sensing or communication, got 'radar'"),
    (("robots", 0, "position"), [math.nan, 0.0], "robots[0].position[0]: must be a finite number"),
    (("robots", 1, "position"), [0.0, math.inf], "robots[1].position[1]: must be a finite number"),
    (("robots", 0, "position"), [0.0], "robots[0].position[1]: is missing"),
    (("robots", 0, "position"), [0.0, 1.0, 2.0], "robots[0].position: "),
    (("robots", 0, "position"), "here", "robots[0].position: "),
    (("robots", 0, "capacity"), -1, "robots[0].capacity: must be at least 0 and at most 1000"),
    (("robots", 0, "capacity"), True, "robots[0].capacity: must be a whole number"),
    (("robots", 0, "capacity"), 1.5, "robots[0].capacity: must be a"),
    (("robots", 0, "id"), "21", "robots[0].id: must be a"),
    (("weights", "tracking"), 0.0, "weights.tracking: must be at least 1e-06 and at most 1e+06"),
    (("weights", "control"), "lots", "weights.control: must be a number (allowed: at least 1e-06"),
    (("steps",), 0, "steps: must be at least 1 and at most 1e+06, got 0"),
    (("tick_s",), -0.1, "tick_s: must be at least 0.01 and at most 3600, got -0.1"),
    (("robots",), [], "robots: "),
    (("assignment",), {"x": [122]}, "assignment.x: "),
    (("planner",), {"engine": "quick"}, "planner.engine: must be fast, sqp or ipopt, got 'quick'"),
    (
        ("targets", 0, "motion"),
        {"kind": "jump"},
        "motion: is of no known kind (allowed: circle, linear, random_walk, replay or waypoints)",
    ),
    (("targets", 0, "motion"), {"velocity": [0, 0]}, "targets[0].motion: needs a kind (allowed: c"),
    (("targets", 0, "motion"), {"kind": "circle", "centre": [0, 0]}, "motion.rate_rad_s: is miss"),
    (("team",), "a/b", "team: "),
]


@pytest.mark.parametrize(("path", "value", "words"), FIELD_FAULTS)
def test_a_wrong_field_is_named_with_what_is_allowed(path: Path, value: object, words: str) -> None:
    message = _refusal(changed(document(), path, value))
    assert words in message
    assert message.startswith("scenario: ")


def test_a_missing_field_is_named() -> None:
    message = _refusal(without(document(), ("robots", 1, "altitude_m")))
    assert "robots[1].altitude_m: is missing (allowed: at least 0 and at most 1000)" in message


RULES: list[tuple[Path, object, str]] = [
    (("robots", 1, "id"), 21, "robots[1].id: 21 is taken already"),
    (("targets", 1, "id"), 122, "targets[1].id: 122 is taken already"),
    (("zones", 1, "id"), "s1", "zones[1].id: s1 is taken already"),
    (("field", "upper"), [-6.0, 4.0], "field.upper[0]: must be above the lower bound -5"),
    (("robots", 0, "position"), [-2.0, 4.5], "position[1]: lies outside the field (allowed: -4 to"),
    (("robots", 0, "position"), [-2.0, -0.8], "is 0.20 m from robots[0]; planner.min_dist_m"),
    (("planner",), {"plan_step_s": 0.05}, "planner.plan_step_s: must be at least tick_s, 0.1 s"),
    (("robots", 0, "control_lower"), [0.1, -1.0], "control_lower[0]: the control box must contain"),
    (("robots", 0, "control_lower"), [0.5, -1.0], "control_upper[0]: must be above"),
    (("weight_bounds",), {"tracking": [20.0, 30.0]}, "weight_bounds.tracking: must contain the"),
    (("assignment", 27), [122], "assignment.27: there is no such robot"),
    (("assignment", 26), [124, 142], "assignment.26[1]: there is no target 142, did you mean"),
    (("assignment", 26), [124, 124], "assignment.26[1]: target 124 stands here already"),
    (("assignment", 21), [122, 124], "gets 2 targets, but robots[0].capacity is 1 (allowed: 1 or"),
    (("robots", 0, "capacity"), 0, "robot 21 gets 1 targets, but robots[0].capacity is 0"),
    (("assignment", 26), [], "assignment: leaves 1 of 2 targets to nobody (124)"),
    (
        ("targets", 0, "motion"),
        {"kind": "circle", "centre": [0.0, 1.0], "rate_rad_s": 0.1},
        "targets[0].motion.centre: is where the target starts",
    ),
    (
        ("targets", 0, "motion"),
        {"kind": "replay", "times_s": [0, 1], "positions": [[0, 0]]},
        "targets[0].motion.positions: has 1 entries for 2 times",
    ),
    (
        ("targets", 0, "motion"),
        {"kind": "replay", "times_s": [1, 1], "positions": [[0, 0], [1, 1]]},
        "targets[0].motion.times_s: must increase",
    ),
]


@pytest.mark.parametrize(("path", "value", "words"), RULES)
def test_fields_that_do_not_fit_together_are_named(path: Path, value: object, words: str) -> None:
    assert words in _refusal(changed(document(), path, value))


@pytest.mark.parametrize(
    ("covariance", "words"),
    [
        ([[-0.4, 0.0], [0.0, 0.4]], "must be positive definite, but its eigenvalues are -0.4 and"),
        ([[0.4, 0.5], [0.5, 0.4]], "must be positive definite, but its eigenvalues are -0.1 and"),
        ([[0.0, 0.0], [0.0, 0.4]], "must be positive definite"),
        ([[0.4, 0.1], [0.2, 0.4]], "must be symmetric, but 0.1 stands against 0.2"),
        ([[1e4, 1.0], [1.0, 1e4]], "eigenvalues 1e-06 to 10000 m^2"),
        ([[math.nan, 0.0], [0.0, 1.0]], "covariance[0][0]: must be a finite number"),
        ([0.4, 0.4], "zones[0].covariance[0]: "),
    ],
)
def test_a_covariance_must_be_one(covariance: object, words: str) -> None:
    message = _refusal(changed(document(), ("zones", 0, "covariance"), covariance))
    assert "zones[0].covariance" in message
    assert words in message


def test_a_team_that_can_track_nothing_is_refused() -> None:
    data = changed(document(), ("assignment",), {})
    for robot in data["robots"]:
        robot["capacity"] = 0
    assert "all capacities are 0, but there are 2 targets to track" in _refusal(data)


def test_more_targets_than_places_may_stay_uncovered() -> None:
    data = changed(document(), ("robots", 1, "capacity"), 0)
    data["assignment"] = {21: [122]}
    assert inline(data).mission_setup().assignment == {Pairing(21, 122)}


def test_every_problem_is_told_at_once_one_a_line() -> None:
    data = changed(document(), ("robots", 0, "capacity"), -1)
    data["weights"]["tracking"] = -1.0
    data["colour"] = "red"
    assert len(_refusal(data).splitlines()) == 3
    data = changed(document(), ("assignment",), {1: [2], 3: [4]})
    assert len(_refusal(data).splitlines()) == 5  # two robots, two targets, nobody covered


def test_a_flood_of_problems_is_cut_short() -> None:
    data = document() | {f"key{i}": i for i in range(50)}
    lines = _refusal(data).splitlines()
    assert len(lines) == 21
    assert lines[-1] == "scenario: and 30 more problems"


def test_what_was_given_is_shown_in_part_only() -> None:
    assert len(_refusal(document() | {"name": "x" * 100_000})) < 300


# --------------------------------------------------------------------- the JSON schema


def test_the_schema_describes_the_document() -> None:
    found = schema()
    assert found["$schema"].startswith("https://json-schema.org/")
    assert set(found["required"]) <= set(document())
    assert set(document()) <= set(found["properties"])
    assert found["additionalProperties"] is False


def test_a_scenario_survives_its_own_json() -> None:
    scenario = inline(document())
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


def test_no_more_is_guessed_at_than_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A guess compares with every id there is: thousands of them would take minutes."""
    guessed: list[str] = []

    def closest(word: str, known: Iterable[str]) -> str:
        guessed.append(word)
        return ""

    monkeypatch.setattr(consistency, "closest", closest)
    lines = _refusal(changed(document(), ("assignment", 26), list(range(1000, 3000)))).splitlines()
    assert "there is no target 1000" in lines[0]
    assert len(guessed) == 20


def test_a_scenario_that_is_not_varied_is_itself() -> None:
    scenario = inline(document())
    assert scenario.varied() is scenario
    assert scenario.varied(seed=7).seed == 7
