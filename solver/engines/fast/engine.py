"""The fast engine: packs a problem, runs the compiled routine, unpacks the answer."""

from math import isfinite
from time import thread_time

from solver.engines.fast.compiled import entry
from solver.engines.fast.layout import MAX_STEPS
from solver.engines.fast.packing import packed
from solver.problem import Budget, EngineFailed, Problem, Rung, Solution


class FastEngine:
    """Projected Newton sweeps in machine code. Satisfies `solver.problem.Engine`."""

    name = "fast"

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return the optimum (rung converged) or the best iterate in the budget (feasible).

        The budget's iterations are Newton steps per robot. The first call of a process loads
        the compiled routine, or compiles it where no cache is found.

        Raises:
            EngineFailed: The horizon is too long, or the objective is not finite.
        """
        if not 1 <= problem.horizon <= MAX_STEPS:
            raise EngineFailed(f"horizon {problem.horizon} is not within 1 to {MAX_STEPS}")
        run = entry()
        began = thread_time()
        plans, objective, steps, converged = run(*packed(problem, problem.previous, budget))
        if not isfinite(objective):
            raise EngineFailed(f"the objective is {objective}")
        plans.setflags(write=False)
        controls, positions, velocities = plans
        return Solution(
            robot_ids=problem.robot_ids,
            controls=controls,
            positions=positions,
            velocities=velocities,
            objective=objective,
            rung=Rung.CONVERGED if converged else Rung.FEASIBLE,
            iterations=steps,
            solve_s=thread_time() - began,
            engine=self.name,
        )
