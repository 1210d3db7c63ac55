"""The last plan of each robot, shifted in time to start the next solve."""

import numpy as np

from server.mission.setup import MissionSetup
from solver.arrays import FloatArray, frozen
from solver.plans import shifted
from solver.problem import Solution


class PlanBook:
    """Owner of the last controls per robot, (H, 2) each."""

    def __init__(self, setup: MissionSetup) -> None:
        self._horizon = setup.planner.horizon
        self._step_s = setup.planner.plan_step_s
        self._controls: dict[int, FloatArray] = {}

    def keep(self, solution: Solution) -> None:
        """Remember a tick's plan."""
        for row, robot_id in enumerate(solution.robot_ids):
            self._controls[robot_id] = solution.controls[row]

    def forget(self, robot_id: int) -> None:
        """Drop a robot's plan: it flies elsewhere, or not at all."""
        self._controls.pop(robot_id, None)

    def clear(self) -> None:
        """Drop all plans."""
        self._controls.clear()

    def shifted(self, robot_ids: tuple[int, ...], elapsed_s: float) -> FloatArray | None:
        """Return the plans `elapsed_s` later, (M, H, 2), zero for a robot without one.

        None when no robot has one.
        """
        if not any(robot_id in self._controls for robot_id in robot_ids):
            return None
        blank = np.zeros((self._horizon, 2))
        plans = np.stack([self._controls.get(robot_id, blank) for robot_id in robot_ids])
        return frozen(shifted(plans, elapsed_s, self._step_s))
