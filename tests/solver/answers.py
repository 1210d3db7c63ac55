"""What must hold of every answer of a planner."""

import numpy as np

from solver.problem import Problem, Solution


def check(problem: Problem, solution: Solution) -> None:
    """What must hold of every answer, whatever the question."""
    count, horizon = len(problem.robot_ids), max(problem.horizon, 1)
    assert solution.robot_ids == problem.robot_ids
    for array in (solution.controls, solution.positions, solution.velocities):
        assert array.shape == (count, horizon, 2)
        assert np.isfinite(array).all()
    assert np.isfinite(solution.objective)
    bounds = np.stack((problem.control_lower, problem.control_upper))
    bounds[~(np.abs(bounds) <= 1e6)] = 0.0
    low, high = bounds.min(axis=0), bounds.max(axis=0)
    assert (solution.controls >= low[:, None] - 1e-9).all()
    assert (solution.controls <= high[:, None] + 1e-9).all()
