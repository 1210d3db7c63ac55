"""Small documents for tests, in both formats, and how to spoil them."""

import copy
from typing import Any

Path = tuple[str | int, ...]


def document() -> dict[str, Any]:
    """Return a valid scenario of ours: two robots, two targets, one zone of each kind."""
    return {
        "name": "small",
        "field": {"lower": [-5.0, -4.0], "upper": [5.0, 4.0]},
        "robots": [
            {"id": 21, "position": [-2.0, 1.0], "altitude_m": 1.2, "capacity": 1},
            {"id": 26, "position": [-2.0, -1.0], "altitude_m": 1.7, "capacity": 2},
        ],
        "targets": [
            {"id": 122, "position": [0.0, 1.0]},
            {"id": 124, "position": [0.0, -1.0], "motion": {"kind": "linear"}},
        ],
        "zones": [
            {"id": "s1", "kind": "sensing", "mean": [2, 1], "covariance": [[0.4, 0], [0, 0.4]]},
            {
                "id": "c1",
                "kind": "communication",
                "mean": [2.0, -1.0],
                "covariance": [[0.4, 0.1], [0.1, 0.3]],
            },
        ],
        "assignment": {21: [122], 26: [124]},
        "weights": {"tracking": 10.0, "control": 0.1, "sensing": 50.0, "communication": 40.0},
    }


def experiment() -> dict[str, Any]:
    """Return a valid document in the format of the paper's authors: 2 robots, 3 targets."""
    return {
        "steps": 300,
        "llm_inner_dur": 2,
        "llm_outer_dur": 8,
        "Problem": {
            "robotID": [21, 26],
            "targetID": [122, 124, 125],
            "targetStartPos": [[-1, 0.5], [-1, -0.5], [-2.0, 0]],
            "targetStartVel": [[0.1, 0], [0.12, 0.01], [0.1, 0]],
            "robotStartPos": [[-3.0, 0.5], [-3.0, -0.5]],
            "robotStartVel": [[0, 0], [0, 0], [0, 0]],
            "target_dyn_type": "second_order_dynamics",
            "robot_dyn_type": "first_order_dynamics",
            "assignment_matrix": [[1, 0, 1], [0, 1, 0]],
            "task_ability": 2,
            "robotHeights": [1.0],
            "N": 2,
            "dt": 0.25,
            "dim": 2,
            "u_bounds": [-0.4, 0.6],
            "x_bounds": [[-8, 8], [-3, 4]],
            "weights": [0.02, 5.0, 60.0, 70.0],
            "range_sensor": [14.0, 0.1],
            "bearing_sensor": [13.0, 0.3],
            "min_dist": 0.45,
        },
        "Zones": {
            "nTypeI": 1,
            "nTypeII": 1,
            "typeI_mu": [[1.0, 0.4]],
            "typeI_cov": [[0.3, 0.5]],
            "typeI_delta": [0.15, 0.9, 0.9],
            "typeII_mu": [[3.0, -1.0], [5.6, -0.2]],
            "typeII_cov": [[0.6, 0.7], [0.15, 0.15]],
            "typeII_delta": [0.25, 0.9],
            "eps1": 0.1,
            "eps2": 0.95,
            "eps2_single": 0.05,
            "attack_recover_eps": 0.2,
            "attack_dt": 0.5,
            "attack_seed": 3,
        },
    }


def changed(data: dict[str, Any], path: Path, value: object) -> dict[str, Any]:
    """Return a copy with one value replaced or added."""
    copied = copy.deepcopy(data)
    place: Any = copied
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return copied


def without(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return a copy with one value taken out."""
    copied = copy.deepcopy(data)
    place: Any = copied
    for step in path[:-1]:
        place = place[step]
    del place[path[-1]]
    return copied
