"""Random planning problems for the tests: plain ones, and ones meant to break things."""

from dataclasses import replace

import numpy as np

from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool
from solver.directives import Weights
from solver.problem import Dynamics, Problem, SensorModel, ZoneTable
from solver.zones import Zone, ZoneKind

DYNAMICS = tuple(Dynamics)


def zone_table(zones: list[Zone], known: BoolArray) -> ZoneTable:
    """Return zones as a table at severity 1; known has shape (M, K)."""
    return ZoneTable(
        centres=frozen(np.array([z.mean for z in zones]).reshape(-1, 2)),
        covariances=frozen(np.array([z.covariance for z in zones]).reshape(-1, 2, 2)),
        margins=frozen([z.margin for z in zones]),
        quantiles=frozen([z.quantile() for z in zones]),
        severities=frozen(np.ones(len(zones))),
        known=frozen_bool(known),
    )


def random_covariances(rng: np.random.Generator, count: int, scale: float) -> FloatArray:
    factors = rng.normal(size=(count, 2, 2)) * np.sqrt(scale)
    return np.asarray(factors @ np.swapaxes(factors, 1, 2) + 0.02 * scale * np.eye(2))


def random_zones(rng: np.random.Generator, count: int, kind: ZoneKind, room: float) -> list[Zone]:
    zones = []
    for k in range(count):
        (a, b), (_, c) = random_covariances(rng, 1, 0.6)[0].tolist()
        x, y = rng.uniform(-room, room, size=2).tolist()
        margin = rng.uniform(0.05, 0.4)
        zones.append(Zone(f"{kind[0]}{k}", kind, (x, y), ((a, b), (b, c)), margin, 0.1))
    return zones


def random_problem(
    seed: int,
    robots: int = 3,
    targets: int = 5,
    zones: int = 2,
    horizon: int = 1,
    dynamics: Dynamics = Dynamics.SINGLE_INTEGRATOR,
    obstacles: int = 1,
    room: float = 3.0,
) -> Problem:
    """Return a crowded problem in which every term is at work."""
    rng = np.random.default_rng(seed)
    sees = np.zeros((robots, targets), dtype=np.bool_)
    if robots:
        sees[rng.integers(0, robots, size=targets), np.arange(targets)] = True
        sees |= rng.random((robots, targets)) < 0.2
    starts = rng.uniform(-room, room, size=(targets, 2))
    speeds = rng.normal(size=(targets, 2)) * 0.2
    steps = 0.5 * np.arange(1, horizon + 1)
    sensing = random_zones(rng, zones, ZoneKind.SENSING, room)
    communication = random_zones(rng, zones, ZoneKind.COMMUNICATION, room)
    growth = random_covariances(rng, horizon * targets, 0.05).reshape(horizon, targets, 2, 2)
    limit = np.full((robots, 2), 0.5)
    return Problem(
        robot_ids=tuple(range(21, 21 + robots)),
        step_s=0.5,
        horizon=horizon,
        dynamics=dynamics,
        positions=frozen(rng.uniform(-room, room, size=(robots, 2))),
        velocities=frozen(rng.uniform(-0.4, 0.4, size=(robots, 2))),
        control_lower=frozen(-limit),
        control_upper=frozen(limit),
        speed_limit=frozen(np.full(robots, 0.6)),
        field_lower=frozen([-room - 0.2, -room - 0.2]),
        field_upper=frozen([room + 0.2, room + 0.2]),
        sees=frozen_bool(sees),
        target_means=frozen(starts + steps[:, None, None] * speeds),
        target_priors=frozen(random_covariances(rng, targets, 0.3)),
        target_growth=frozen(growth),
        sensor=SensorModel(),
        sensing=zone_table(sensing, rng.random((robots, zones)) < 0.8),
        communication=zone_table(communication, rng.random((robots, zones)) < 0.8),
        weights=Weights(10.0, 0.05, 50.0, 50.0),
        separation_weight=1000.0,
        min_dist_m=0.4,
        obstacles=frozen(rng.uniform(-room, room, size=(obstacles, 2))),
        previous=None,
        replan=frozen_bool(np.zeros(robots)),
    )


def random_controls(seed: int, problem: Problem, scale: float = 0.5) -> FloatArray:
    shape = (len(problem.robot_ids), problem.horizon, 2)
    return np.random.default_rng(seed).uniform(-scale, scale, size=shape)


def coincident(problem: Problem) -> Problem:
    """Return the problem with all robots on one target, which stands on a zone's centre."""
    spot = problem.sensing.centres[0]
    means = problem.target_means.copy()
    means[:, 0] = spot
    return replace(
        problem,
        positions=frozen(np.tile(spot, (len(problem.robot_ids), 1))),
        target_means=frozen(means),
    )
