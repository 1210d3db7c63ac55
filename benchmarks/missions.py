"""Closed-loop planning problems of any size, for timing engines on ticks as they come.

A square field of constant density, targets that drift, robots that see the nearest of them,
zones that robots know once they have been near. Every problem is made from the state the last
plan led to, so that warm starts, contacts and bounds are those of a mission. Deterministic.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool
from solver.directives import Weights
from solver.problem import Dynamics, Problem, SensorModel, Solution, ZoneTable

_AREA_PER_ROBOT = 50.0
_ROBOTS_PER_ZONE = 4
_KNOWN_WITHIN_M = 12.0
_CAPACITY = 3
_TARGET_SPEED = 0.15
_NOISE = 0.01
_SPREAD_M = 1.5
"""Communication margins are factors on the spread; they are chosen to make this of it."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Size and kind of a mission."""

    robots: int
    targets: int
    horizon: int
    dynamics: Dynamics = Dynamics.SINGLE_INTEGRATOR
    seed: int = 0
    step_s: float = 0.5
    weights: Weights = field(default=Weights(10.0, 0.05, 50.0, 50.0))

    @property
    def side(self) -> float:
        """Return the side of the field, metres."""
        return float(np.sqrt(_AREA_PER_ROBOT * self.robots))


class Mission:
    """Makes the problem of each tick, given the plan of the last one."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._dice = np.random.default_rng(layout.seed)
        half = 0.5 * layout.side
        self.robots = self._dice.uniform(-half, half, (layout.robots, 2))
        self.velocities = np.zeros((layout.robots, 2))
        self.targets = self._dice.uniform(-half, half, (layout.targets, 2))
        heading = self._dice.uniform(0.0, 2.0 * np.pi, layout.targets)
        self.drift = _TARGET_SPEED * np.stack((np.cos(heading), np.sin(heading)), axis=1)
        self.posteriors = np.tile(0.2 * np.eye(2), (layout.targets, 1, 1))
        self.sensing = self._zones(margin=0.1)
        self.communication = self._zones(margin=_SPREAD_M / (1.4 * layout.side))
        self.previous: FloatArray | None = None

    def _zones(self, margin: float) -> ZoneTable:
        count = max(1, self.layout.robots // _ROBOTS_PER_ZONE)
        half = 0.5 * self.layout.side
        angle = self._dice.uniform(0.0, np.pi, count)
        axes = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        covariances = 0.3 * np.eye(2) + 0.5 * axes[:, :, None] * axes[:, None, :]
        return ZoneTable(
            centres=frozen(self._dice.uniform(-half, half, (count, 2))),
            covariances=frozen(covariances),
            margins=frozen(np.full(count, margin)),
            quantiles=frozen(np.full(count, 1.3)),
            severities=frozen(np.ones(count)),
            known=frozen_bool(np.zeros((self.layout.robots, count))),
        )

    def _met(self, table: ZoneTable) -> ZoneTable:
        gap = np.linalg.norm(self.robots[:, None] - table.centres[None], axis=-1)
        known = frozen_bool(table.known | (gap < _KNOWN_WITHIN_M))
        return ZoneTable(
            table.centres,
            table.covariances,
            table.margins,
            table.quantiles,
            table.severities,
            known,
        )

    def _assigned(self) -> BoolArray:
        """Give each robot its nearest targets, and each target a robot while there are any."""
        gap = np.linalg.norm(self.robots[:, None] - self.targets[None], axis=-1)
        sees = np.zeros(gap.shape, np.bool_)
        for j in np.argsort(gap.min(axis=0)):
            order = np.argsort(gap[:, j])
            free = order[sees[order].sum(axis=1) < _CAPACITY]
            sees[free[:1], j] = True
        for i in np.flatnonzero(sees.sum(axis=1) < _CAPACITY - 1):
            sees[i, np.argmin(np.where(sees[i], np.inf, gap[i]))] = True
        return sees

    def problem(self) -> Problem:
        """Return the problem of this tick."""
        layout = self.layout
        self.sensing, self.communication = self._met(self.sensing), self._met(self.communication)
        ahead = layout.step_s * np.arange(1, layout.horizon + 1)
        growth = np.broadcast_to(_NOISE * np.eye(2), (layout.horizon, layout.targets, 2, 2))
        half, robots = 0.5 * layout.side, layout.robots
        limit = np.full((robots, 2), 0.5)
        return Problem(
            robot_ids=tuple(range(robots)),
            step_s=layout.step_s,
            horizon=layout.horizon,
            dynamics=layout.dynamics,
            positions=frozen(self.robots),
            velocities=frozen(self.velocities),
            control_lower=frozen(-limit),
            control_upper=frozen(limit),
            speed_limit=frozen(np.full(robots, 0.5)),
            field_lower=frozen(np.full(2, -half)),
            field_upper=frozen(np.full(2, half)),
            sees=frozen_bool(self._assigned()),
            target_means=frozen(self.targets + ahead[:, None, None] * self.drift),
            target_priors=frozen(self.posteriors + _NOISE * np.eye(2)),
            target_growth=frozen(growth),
            sensor=SensorModel(),
            sensing=self.sensing,
            communication=self.communication,
            weights=layout.weights,
            separation_weight=200.0,
            min_dist_m=0.4,
            obstacles=frozen(np.zeros((0, 2))),
            previous=None if self.previous is None else frozen(self.previous),
            replan=frozen_bool(np.zeros(robots)),
        )

    def fly(self, problem: Problem, solution: Solution) -> None:
        """Move the world by the first step of a plan."""
        self.robots = np.array(solution.positions[:, 0])
        self.velocities = np.array(solution.velocities[:, 0])
        half = 0.5 * self.layout.side
        self.targets = self.targets + self.layout.step_s * self.drift
        outside = np.abs(self.targets) > half
        self.drift = np.where(outside, -np.sign(self.targets) * np.abs(self.drift), self.drift)
        self.posteriors = _posteriors(problem, self.robots)
        self.previous = np.concatenate((solution.controls[:, 1:], solution.controls[:, -1:]), 1)


def ticks(
    layout: Layout, count: int, solve: Callable[[Problem], Solution]
) -> Iterator[tuple[Problem, Solution]]:
    """Fly a mission with one engine; yield each tick's problem and plan."""
    mission = Mission(layout)
    for _ in range(count):
        problem = mission.problem()
        solution = solve(problem)
        yield problem, solution
        mission.fly(problem, solution)


def _posteriors(problem: Problem, robots: FloatArray) -> FloatArray:
    """Return the covariances (N, 2, 2) after everybody has measured from where it is now."""
    p = robots[:, None] - problem.target_means[0][None]
    squared = (p * p).sum(axis=-1) + 0.01
    sensor, length = problem.sensor, np.sqrt(squared)
    along = sensor.range_peak * np.exp(-sensor.range_shape * length) / squared
    across = sensor.bearing_peak * np.exp(-sensor.bearing_shape * length) / squared**2
    turned = np.stack((-p[..., 1], p[..., 0]), axis=-1)
    told = (along * problem.sees)[..., None, None] * p[..., :, None] * p[..., None, :]
    told += (across * problem.sees)[..., None, None] * turned[..., :, None] * turned[..., None, :]
    return np.asarray(np.linalg.inv(np.linalg.inv(problem.target_priors) + told.sum(axis=0)))
