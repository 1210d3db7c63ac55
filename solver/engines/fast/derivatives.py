"""One robot's own problem as the kernels see it, for tests and for people who tune."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types

from solver.arrays import FloatArray
from solver.engines.fast.compiled import compile_cached
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.packing import packed
from solver.engines.fast.request import (
    Hazards,
    Movement,
    Safety,
    Start,
    Targets,
    request_types,
)
from solver.engines.fast.robot import cost, expand, gather
from solver.engines.fast.routine import begin
from solver.engines.fast.tables import assemble
from solver.problem import Budget, Problem


def local_derivatives(
    problem: Problem, controls: FloatArray, robot: int
) -> tuple[float, float, FloatArray, FloatArray]:
    """Return what the kernels compute for one robot with the others' controls fixed.

    Args:
        problem: The problem.
        controls: (M, H, 2) inside the hard box; others are moved into it.
        robot: Index of the robot.

    Returns:
        Cost by the search's kernel, cost by the expansion's, gradient (2H,), Hessian (2H, 2H).
    """
    result: tuple[float, float, FloatArray, FloatArray] = _compiled()(
        *packed(problem, controls, Budget()), robot
    )
    return result


@cache
def _compiled() -> Callable[..., Any]:
    number = types.float64
    answer = types.Tuple((number, number, types.Array(number, 1, "C"), types.Array(number, 2, "C")))
    return compile_cached(local, answer(*request_types(), types.int64))


def local(
    movement: Movement,
    targets: Targets,
    sensing: Hazards,
    communication: Hazards,
    safety: Safety,
    start: Start,
    robot: int,
) -> tuple[float, float, FloatArray, FloatArray]:
    """Expand one robot's problem at the given plans."""
    team = assemble(movement, targets, sensing, communication, safety, start)
    begin(team, start.previous)
    size = 2 * team.setting[0].steps
    rows = gather(team, robot)
    searched = cost(team, robot, rows, team.robots[robot].plan)
    value = expand(team, robot, rows, team.robots[robot].plan)
    gradient, hessian = np.empty(size), np.empty((size, size))
    _copy_out(team, gradient, hessian)
    return searched, value, gradient, hessian


@kernel
def _copy_out(team: Team, gradient: FloatArray, hessian: FloatArray) -> None:
    work = team.work[0]
    for row in range(gradient.shape[0]):
        gradient[row] = work.gradient[row]
        for column in range(gradient.shape[0]):
            hessian[row, column] = work.bend[row, column]
