"""Never late, never NaN: what stands between an engine and a robot.

The ladder: the engine's converged answer; its best feasible iterate at the end of the budget;
the last plan, one step on; brake. Before it the inputs are made sound, after it a filter keeps
the least distance, and nothing leaves that is not finite and inside its limits.
"""

import logging
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from solver.arrays import BoolArray, FloatArray, frozen
from solver.bounds import control_box, rollout
from solver.objective import cost
from solver.problem import Budget, Dynamics, Engine, EngineFailed, Problem, Rung, Solution
from solver.repair import FAR_M, control_limits, is_solvable, plannable, repaired, subset
from solver.separation import separated

_log = logging.getLogger(__name__)

_Ask = Callable[[Problem], Solution | None]
"""Asks an engine about a sound problem; None where it has no answer."""


class Planner:
    """Solves problems with one engine; the same problem always gives the same commands."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return a plan whose first controls may be flown: always, whatever the problem.

        Robots whose position (or velocity, if it matters) is not a number are left out of the
        planning and told to stand still; their predicted positions mean nothing.
        """
        return self._walked(problem, lambda sound: self._answer(sound, budget))

    def carry_on(self, problem: Problem) -> Solution:
        """Return what `solve` does where its engine has no answer: the last plan, or a brake."""
        return self._walked(problem, lambda _: None)

    def _walked(self, problem: Problem, ask: _Ask) -> Solution:
        """Walk down the ladder from what the engine says, for robots that can be planned for."""
        began = time.thread_time()
        with np.errstate(all="ignore"):
            if not is_solvable(problem):
                return self._still(problem, began)
            usable = plannable(problem)
            if usable.all():
                return self._planned(repaired(problem), ask, began)
            rest = self._still(problem, began)
            if not usable.any():
                return rest
            part = self._planned(repaired(subset(problem, usable)), ask, began)
            return replace(
                part,
                robot_ids=problem.robot_ids,
                controls=_merged(rest.controls, usable, part.controls),
                positions=_merged(rest.positions, usable, part.positions),
                velocities=_merged(rest.velocities, usable, part.velocities),
            )

    def _planned(self, problem: Problem, ask: _Ask, began: float) -> Solution:
        """Walk down the ladder for a sound problem, then filter."""
        lower, upper = control_box(problem)
        answer = ask(problem)
        if answer is not None:
            rung, controls = answer.rung, np.clip(answer.controls, lower, upper)
        elif problem.previous is not None:
            rung, controls = Rung.SHIFTED, np.clip(problem.previous, lower, upper)
        else:
            rung, controls = Rung.BRAKE, _braking(problem)
        first = controls[:, 0]
        apart = separated(problem, first, lower[:, 0], upper[:, 0])
        if apart is not first:
            controls[:, 0] = apart
        if answer is not None and np.array_equal(controls, answer.controls):
            return answer
        positions, velocities = rollout(problem, controls)
        return Solution(
            robot_ids=problem.robot_ids,
            controls=frozen(controls),
            positions=frozen(positions),
            velocities=frozen(velocities),
            objective=cost(problem, controls),
            rung=rung,
            iterations=0 if answer is None else answer.iterations,
            solve_s=time.thread_time() - began if answer is None else answer.solve_s,
            engine=self.engine.name,
        )

    def _answer(self, problem: Problem, budget: Budget) -> Solution | None:
        """Return the engine's answer if it is one."""
        try:
            answer = self.engine.solve(problem, budget)
        except EngineFailed as failure:
            _log.warning("engine %s failed: %s", self.engine.name, failure)
            return None
        except Exception:  # noqa: BLE001 (whatever an engine does, the team must be flown)
            _log.exception("engine %s broke", self.engine.name)
            return None
        shape = (len(problem.robot_ids), problem.horizon, 2)
        if answer.controls.shape != shape or not np.isfinite(answer.controls).all():
            _log.warning("engine %s answered with no numbers", self.engine.name)
            return None
        sound = np.isfinite(answer.positions).all() and np.isfinite(answer.velocities).all()
        return answer if sound and math.isfinite(answer.objective) else None

    def _still(self, problem: Problem, began: float) -> Solution:
        """Return the plan of a team that cannot be planned for: stand, or come to a stand."""
        controls = _braking(problem)
        places = np.clip(_numbers(problem.positions), -FAR_M, FAR_M)
        positions = np.repeat(places[:, None], controls.shape[1], axis=1)
        return Solution(
            robot_ids=problem.robot_ids,
            controls=frozen(controls),
            positions=frozen(positions),
            velocities=frozen(np.zeros_like(positions)),
            objective=0.0,
            rung=Rung.BRAKE if problem.robot_ids else Rung.CONVERGED,
            iterations=0,
            solve_s=time.thread_time() - began,
            engine=self.engine.name,
        )


def _numbers(values: FloatArray) -> FloatArray:
    return np.nan_to_num(values, nan=0.0)


def _braking(problem: Problem) -> FloatArray:
    """Return (M, H, 2) controls: velocity zero, or the acceleration that leads there."""
    low, high = control_limits(problem)
    controls = np.zeros((len(problem.robot_ids), max(problem.horizon, 1), 2))
    v, h = np.clip(_numbers(problem.velocities), -FAR_M, FAR_M), problem.step_s
    brakes = problem.dynamics is Dynamics.DOUBLE_INTEGRATOR and 0.0 < h < math.inf
    for k in range(controls.shape[1]):
        wanted = -v / h if brakes else np.zeros_like(low)
        controls[:, k] = np.clip(wanted, low, high)
        v = v + h * controls[:, k] if brakes else v
    return controls


def _merged(rest: FloatArray, usable: BoolArray, part: FloatArray) -> FloatArray:
    result = rest.copy()
    result[usable] = part
    return frozen(result)
