"""The paper authors' experiment files, unchanged, as scenarios of ours.

Their numbers are kept; `authors_format` says what they mean. What is taken over from their
program beside them, so that figures can be compared, is the filter below and what
`compat: authors` stands for; their faults are not.
"""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import ValidationError

from server.scenarios.authors_format import ExperimentFile, ProblemSection, ZonesSection, misfits
from server.scenarios.errors import ScenarioError, problems_of
from server.scenarios.parts import PlannerPart
from server.scenarios.schema import Scenario

PROCESS_NOISE_M2_PER_STEP = 0.05
PRIOR_VARIANCE_M2 = 0.2
SEPARATION_WEIGHT = 1000.0
PROGRAM_STAGES = 2
"""N of their program, whatever a file says: now and one step ahead."""

ALTITUDE_LAYER_M = 0.5
"""Between robots for which the file has no height."""

NEVER_S = 1e6
"""Their filter drops no track."""


def is_authors(data: Mapping[str, Any]) -> bool:
    """Return whether a mapping is one of the authors' files, by its two sections."""
    return "Problem" in data and "Zones" in data


def convert(data: Mapping[str, Any], origin: str, name: str) -> Scenario:
    """Return an authors' file as a scenario.

    Args:
        data: The file's mapping.
        origin: What errors call the file.
        name: The scenario's name.

    Raises:
        ScenarioError: The file breaks its format's rules, or needs what we do not support:
            three dimensions, second-order robots, first-order targets.
    """
    try:
        file = ExperimentFile.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(origin, problems_of(error, ExperimentFile)) from error
    if problems := tuple(misfits(file)):
        raise ScenarioError(origin, problems)
    try:
        return Scenario.model_validate(_document(file, name))
    except ValidationError as error:
        raise ScenarioError(origin, problems_of(error, Scenario)) from error


def _document(file: ExperimentFile, name: str) -> dict[str, Any]:
    """Return our own document for a file that fits together."""
    problem, zones = file.problem, file.zones
    (x_low, x_high), (y_low, y_high) = problem.x_bounds
    control, tracking, sensing, communication = problem.weights
    range_peak, range_shape = problem.range_sensor
    bearing_peak, bearing_shape = problem.bearing_sensor
    defaults = _zone_defaults(zones)
    return {
        "name": name,
        "description": "An experiment of the paper's authors.",
        "compat": "authors",
        "seed": zones.attack_seed,
        "tick_s": problem.dt,
        "steps": file.steps,
        "field": {"lower": (x_low, y_low), "upper": (x_high, y_high)},
        "robots": _robots(problem),
        "targets": _targets(problem),
        "zones": [*_zones("sensing", zones), *_zones("communication", zones)],
        "zone_defaults": defaults,
        "assignment": _assignment(problem),
        "weights": {
            "tracking": tracking,
            "control": control,
            "sensing": sensing,
            "communication": communication,
        },
        "planner": _planner(problem),
        "sensor": {
            "range_peak": range_peak,
            "range_shape": range_shape,
            "bearing_peak": bearing_peak,
            "bearing_shape": bearing_shape,
        },
        "filter": _filter(problem.dt),
        "attacks": {"period_s": zones.attack_dt, "recover_density": zones.attack_recover_eps},
        "loops": {"task_period_s": file.llm_outer_dur, "action_period_s": file.llm_inner_dur},
    }


def _planner(problem: ProblemSection) -> dict[str, Any]:
    """Return our own look-ahead unless the file asks for one: their program can only do `N: 2`."""
    planner: dict[str, Any] = {
        "min_dist_m": problem.min_dist,
        "separation_weight": SEPARATION_WEIGHT,
    }
    if problem.stages != PROGRAM_STAGES:
        return planner | {"horizon": problem.stages - 1, "plan_step_s": problem.dt}
    return planner | {"plan_step_s": max(PlannerPart().plan_step_s, problem.dt)}


def _filter(dt_s: float) -> dict[str, Any]:
    """Return their filter: targets believed to stand still, Q = 0.05 I per step, no gate."""
    return {
        "model": "random_walk",
        "process_noise": PROCESS_NOISE_M2_PER_STEP / dt_s,
        "gate_probability": None,
        "near_field": "mode",
        "drop_after_s": NEVER_S,
    }


def _robots(problem: ProblemSection) -> list[dict[str, Any]]:
    low, high = problem.u_bounds
    heights = list(problem.heights[: len(problem.robot_ids)])
    while len(heights) < len(problem.robot_ids):
        heights.append(max(heights, default=ALTITUDE_LAYER_M) + ALTITUDE_LAYER_M)
    return [
        {
            "id": robot_id,
            "position": position,
            "altitude_m": height,
            "capacity": problem.task_ability,
            "control_lower": (low, low),
            "control_upper": (high, high),
        }
        for robot_id, position, height in zip(
            problem.robot_ids, problem.robot_positions, heights, strict=False
        )
    ]


def _targets(problem: ProblemSection) -> list[dict[str, Any]]:
    variance = PRIOR_VARIANCE_M2
    return [
        {
            "id": target_id,
            "position": position,
            "motion": {"kind": "linear", "velocity": velocity},
            "prior": {"mean": position, "covariance": ((variance, 0.0), (0.0, variance))},
        }
        for target_id, position, velocity in zip(
            problem.target_ids, problem.target_positions, problem.target_velocities, strict=False
        )
    ]


def _assignment(problem: ProblemSection) -> dict[int, tuple[int, ...]]:
    return {
        robot_id: tuple(
            target for target, bit in zip(problem.target_ids, row, strict=True) if bit == 1
        )
        for robot_id, row in zip(problem.robot_ids, problem.assignment_matrix, strict=True)
    }


def _zones(kind: Literal["sensing", "communication"], zones: ZonesSection) -> list[dict[str, Any]]:
    if kind == "sensing":
        count, means = zones.sensing_count, zones.sensing_means
        variances, margins = zones.sensing_variances, zones.sensing_margins
    else:
        count, means = zones.communication_count, zones.communication_means
        variances, margins = zones.communication_variances, zones.communication_margins
    return [
        {
            "id": f"{kind[0]}{i}",
            "kind": kind,
            "mean": means[i],
            "covariance": ((variances[i][0], 0.0), (0.0, variances[i][1])),
            "margin": margins[i],
        }
        for i in range(count)
    ]


def _zone_defaults(zones: ZonesSection) -> dict[str, Any]:
    """Return the risks, one per kind in their files; margins only matter for drawn zones."""
    single = zones.eps2_single
    return {
        "sensing": {"margin": 0.1, "risk": zones.eps1, "risk_single": single},
        "communication": {
            "margin": 0.2,
            "risk": round(1.0 - zones.eps2, 12),
            "risk_single": single,
        },
    }
