"""Scenarios made from a size and a seed: robots among drifting targets and zones."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from server.scenarios.schema import Scenario
from solver.arrays import FloatArray

SPEED_M_S = 0.12
"""Fastest drift of a target."""

LEAST_DIST_M = 0.5
SPREAD_MARGIN_M = 0.3
"""What a communication zone's factor makes of the diagonal of the field."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Size of a scenario."""

    robots: int
    targets: int
    zones: int
    """Every second one is of the communication kind."""

    capacity: int = 3
    area_per_robot_m2: float = 50.0
    steps: int = 40
    tick_s: float = 0.5


def generated(layout: Layout, seed: int) -> Scenario:
    """Return the scenario of a layout and a seed; every target has a robot to start with.

    The field is a square of constant area per robot. Robots stand on a jittered grid, targets
    and zones anywhere, zones with a metre to spare from where robots start.

    Raises:
        ValueError: The team's capacities are too small for its targets.
    """
    if layout.robots * layout.capacity < layout.targets:
        raise ValueError(f"{layout.targets} targets are more than the team can track")
    dice = np.random.default_rng([seed, layout.robots, layout.targets, layout.zones])
    half = 0.5 * float(np.sqrt(layout.area_per_robot_m2 * layout.robots))
    robots = _jittered(layout.robots, half, dice)
    targets = dice.uniform(-0.9 * half, 0.9 * half, (layout.targets, 2))
    heading = dice.uniform(0.0, 2.0 * np.pi, layout.targets)
    speed = dice.uniform(0.2, 1.0, layout.targets) * SPEED_M_S
    drift = speed[:, None] * np.stack((np.cos(heading), np.sin(heading)), axis=1)
    margin = SPREAD_MARGIN_M / (2.0 * np.sqrt(2.0) * half)
    return Scenario.model_validate(
        {
            "name": f"generated-{layout.robots}-{layout.targets}-{layout.zones}-{seed}",
            "seed": seed,
            "tick_s": layout.tick_s,
            "steps": layout.steps,
            "field": {"lower": (-half, -half), "upper": (half, half)},
            "robots": _robots(robots, layout.capacity),
            "targets": _targets(targets, drift),
            "zones": _zones(layout.zones, half, robots, dice),
            "zone_defaults": {
                "sensing": {"margin": 0.1, "risk": 0.1, "risk_single": 0.1},
                "communication": {"margin": margin, "risk": 0.05, "risk_single": 0.05},
            },
            "assignment": nearest_assignment(robots, targets, layout.capacity),
            "planner": {"min_dist_m": LEAST_DIST_M},
        }
    )


def nearest_assignment(
    robots: FloatArray, targets: FloatArray, capacity: int
) -> dict[int, tuple[int, ...]]:
    """Return rows that give each target its nearest robot with room, and no robot nothing.

    Args:
        robots: (M, 2).
        targets: (N, 2).
        capacity: Of every robot; M times it must be at least N.
    """
    away = np.hypot(*(robots[:, None] - targets[None]).transpose(2, 0, 1))
    rows: dict[int, list[int]] = {robot: [] for robot in range(len(robots))}
    free = np.full(len(robots), capacity)
    for target in range(len(targets)):
        robot = int(np.argmin(np.where(free > 0, away[:, target], np.inf)))
        rows[robot].append(target)
        free[robot] -= 1
    for robot, row in rows.items():
        if not row:
            row.append(int(np.argmin(away[robot])))
    return {robot: tuple(row) for robot, row in rows.items()}


def _jittered(count: int, half: float, dice: np.random.Generator) -> FloatArray:
    """Return places (count, 2) on a grid, moved by less than would bring two together."""
    side = int(np.ceil(np.sqrt(count)))
    pitch = 2.0 * half / side
    cells = dice.permutation(side * side)[:count]
    centres = -half + pitch * (np.stack((cells % side, cells // side), axis=1) + 0.5)
    reach = 0.5 * max(0.0, pitch - 2.0 * LEAST_DIST_M)
    return np.asarray(centres + dice.uniform(-reach, reach, (count, 2)))


def _robots(places: FloatArray, capacity: int) -> list[dict[str, Any]]:
    return [
        {"id": i, "position": place, "altitude_m": 1.0 + 0.5 * (i % 8), "capacity": capacity}
        for i, place in enumerate(places.tolist())
    ]


def _targets(places: FloatArray, drift: FloatArray) -> list[dict[str, Any]]:
    return [
        {
            "id": j,
            "position": place,
            "motion": {"kind": "linear", "velocity": velocity},
            "prior": {"mean": place, "covariance": ((0.25, 0.0), (0.0, 0.25))},
        }
        for j, (place, velocity) in enumerate(zip(places.tolist(), drift.tolist(), strict=True))
    ]


def _zones(
    count: int, half: float, robots: FloatArray, dice: np.random.Generator
) -> list[dict[str, Any]]:
    zones = []
    for number in range(count):
        kind = ("sensing", "communication")[number % 2]
        candidates = dice.uniform(-half, half, (64, 2))
        gaps = np.hypot(*(candidates[:, None] - robots[None]).transpose(2, 0, 1)).min(axis=1)
        clear = np.flatnonzero(gaps > 1.0)
        chosen = candidates[clear[0] if len(clear) else int(np.argmax(gaps))]
        variance = float(dice.uniform(0.3, 0.8))
        zones.append(
            {
                "id": f"{kind[0]}{number // 2}",
                "kind": kind,
                "mean": chosen.tolist(),
                "covariance": ((variance, 0.0), (0.0, variance)),
            }
        )
    return zones
