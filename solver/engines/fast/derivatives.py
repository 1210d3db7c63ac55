"""One robot's own problem, or the team's, as the kernels see it: for tests and for tuning."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types

from solver.arrays import FloatArray
from solver.engines.fast.compiled import compile_cached, unchecked
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.newton import GROUP, differentiate, evaluate, own_controls
from solver.engines.fast.packing import packed
from solver.engines.fast.request import (
    Hazards,
    Movement,
    Safety,
    Start,
    Targets,
    request_types,
)
from solver.engines.fast.robot import gather
from solver.engines.fast.routine import begin
from solver.engines.fast.tables import assemble
from solver.problem import Budget, Problem

Derivatives = tuple[float, float, FloatArray, FloatArray]
"""Cost by the search's kernel, cost by the expansion's, gradient, Hessian."""


def local_derivatives(problem: Problem, controls: FloatArray, robot: int) -> Derivatives:
    """Return what the kernels compute for one robot with the others' controls fixed.

    Args:
        problem: The problem.
        controls: (M, H, 2) inside the hard box; others are moved into it.
        robot: Index of the robot.

    Returns:
        Gradient (2H,) and Hessian (2H, 2H).
    """
    result: Derivatives = _compiled()(*packed(problem, controls, Budget()), robot)
    return result


def joint_derivatives(problem: Problem, controls: FloatArray) -> Derivatives:
    """Return the same for all controls together: (2HM,) and (2HM, 2HM), robot by robot.

    The team must be small enough to be improved as a whole (`tables.fits_jointly`).
    """
    result: Derivatives = _compiled()(*packed(problem, controls, Budget()), GROUP)
    return result


@cache
def _compiled() -> Callable[..., Any]:
    number = types.float64
    answer = types.Tuple((number, number, types.Array(number, 1, "C"), types.Array(number, 2, "C")))
    return unchecked(compile_cached(local, answer(*request_types(), types.int64)))


def local(
    movement: Movement,
    targets: Targets,
    sensing: Hazards,
    communication: Hazards,
    safety: Safety,
    start: Start,
    robot: int,
) -> Derivatives:
    """Expand one robot's problem, or the team's, at the given plans."""
    team = assemble(movement, targets, sensing, communication, safety, start)
    begin(team, start.previous)
    size = own_controls(team, robot)
    rows = gather(team, robot) if robot != GROUP else 0
    u = np.empty(size)
    _copy_plans(team, robot, u)
    searched = evaluate(team, robot, rows, u)
    value = differentiate(team, robot, rows, u)
    gradient, hessian = np.empty(size), np.empty((size, size))
    _copy_out(team, robot, gradient, hessian)
    return searched, value, gradient, hessian


@kernel
def _copy_plans(team: Team, robot: int, u: FloatArray) -> None:
    size = 2 * team.setting[0].steps
    first = 0 if robot == GROUP else robot
    for at in range(u.shape[0]):
        u[at] = team.robots[first + at // size].plan[at % size]


@kernel
def _copy_out(team: Team, robot: int, gradient: FloatArray, hessian: FloatArray) -> None:
    work = team.work[1 if robot == GROUP else 0]
    for row in range(gradient.shape[0]):
        gradient[row] = work.gradient[row]
        for column in range(gradient.shape[0]):
            hessian[row, column] = work.bend[row, column]
