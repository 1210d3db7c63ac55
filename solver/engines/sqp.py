"""Sequential quadratic programming on the reduced form: the engine without Numba.

CasADi's `sqpmethod` with a limited-memory Hessian and the dense active-set solver `daqp`. The
exact Hessian costs more than it saves here: it is indefinite inside zones and near targets.
"""

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from solver.arrays import FloatArray, frozen
from solver.bounds import control_box, rollout
from solver.engines.casadi_model import Shape, padded, parameters, reduced, shape_of
from solver.engines.probes import HYSTERESIS, probe_start, stuck
from solver.engines.recent import Recent
from solver.engines.watch import Watch
from solver.problem import Budget, EngineFailed, Problem, Rung, Solution

_KEPT = 8
_STATIONARY = 1e-6
"""At an optimum a projected gradient step promises less than this share of 1 + cost."""

_OPTIONS: dict[str, Any] = {
    "qpsol": "daqp",
    "qpsol_options": {"error_on_fail": False},
    "hessian_approximation": "limited-memory",
    "lbfgs_memory": 20,
    "max_iter_ls": 10,
    "tol_du": 1e-3,
    "print_time": False,
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "error_on_fail": False,
}


@dataclass(frozen=True, slots=True)
class _Built:
    solver: Any
    slope: Any
    """(controls, parameters) -> objective, gradient."""

    objective: Any
    """(controls, parameters) -> objective; several columns of controls at once."""

    watch: Watch | None
    """Stops the solver at the deadline, None where iterations alone are counted."""


class SqpEngine:
    """Solves the reduced form from the last plan, and from one probe start where stuck."""

    name = "sqp"

    def __init__(self) -> None:
        self._built: Recent[tuple[Shape, int, bool], _Built] = Recent(_KEPT)

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return the local optimum, or the best iterate when the budget ran out.

        Every iterate is feasible: what is hard is a box. The deadline is looked at between
        iterations and does not count the building of a shape met for the first time.

        Raises:
            EngineFailed: The objective is not finite at the start nor at any iterate.
        """
        began = time.thread_time()
        shape, live = shape_of(problem), budget.deadline_s is not None
        key = (shape, budget.iterations, live)
        built = self._built.get(key, lambda: _build(*key))
        run = _Run(problem, shape, built, budget)
        best = run.best_from(run.start())
        # One step ahead, or without a plan to go on from, any robot may be in the wrong valley.
        everyone = np.arange(len(problem.robot_ids))
        rows = everyone if problem.horizon == 1 or problem.previous is None else stuck(problem)
        if len(rows) and not run.late():
            plan = run.plan(best.controls)
            other = run.best_from(probe_start(plan, run.lower, run.upper, rows, run.costs))
            if other.objective < best.objective - HYSTERESIS * (1.0 + abs(best.objective)):
                best = other
        if not np.isfinite(best.objective):
            raise EngineFailed("sqp: no iterate with a finite objective")
        controls = run.plan(best.controls)
        positions, velocities = rollout(problem, controls)
        return Solution(
            robot_ids=problem.robot_ids,
            controls=frozen(controls),
            positions=frozen(positions),
            velocities=frozen(velocities),
            objective=best.objective,
            rung=Rung.CONVERGED if best.converged else Rung.FEASIBLE,
            iterations=run.iterations,
            solve_s=time.thread_time() - began,
            engine=self.name,
        )


@dataclass(frozen=True, slots=True)
class _Found:
    controls: FloatArray
    """Flat, padded."""

    objective: float
    converged: bool


class _Run:
    """One problem on its way through a built solver."""

    def __init__(self, problem: Problem, shape: Shape, built: _Built, budget: Budget) -> None:
        self.problem, self.shape, self.built = problem, shape, built
        self.lower, self.upper = control_box(problem)
        self.low = padded(self.lower, shape.robots).ravel()
        self.high = padded(self.upper, shape.robots).ravel()
        self.values = ca.DM(parameters(problem, shape))
        self.deadline = None if budget.deadline_s is None else time.monotonic() + budget.deadline_s
        self.iterations = 0

    def start(self) -> FloatArray:
        previous = self.problem.previous
        plan = np.zeros_like(self.lower) if previous is None else previous
        return np.clip(plan, self.lower, self.upper)

    def plan(self, flat: FloatArray) -> FloatArray:
        """Return (M, H, 2) controls inside the bounds."""
        shaped = flat.reshape(self.shape.robots, self.shape.horizon, 2)[: len(self.lower)]
        return np.clip(shaped, self.lower, self.upper)

    def late(self) -> bool:
        return self.deadline is not None and time.monotonic() >= self.deadline

    def costs(self, plans: FloatArray) -> FloatArray:
        columns = np.stack([padded(plan, self.shape.robots).ravel() for plan in plans], axis=1)
        return np.asarray(self.built.objective(columns, self.values)).ravel()

    def best_from(self, plan: FloatArray) -> _Found:
        """Return the best of the start and what the solver makes of it."""
        start = padded(plan, self.shape.robots).ravel()
        watch = self.built.watch
        if watch is not None:
            watch.begin(self.deadline)
        try:
            answer = self.built.solver(x0=start, p=self.values, lbx=self.low, ubx=self.high)
        except RuntimeError as error:
            raise EngineFailed("sqp: ill-posed problem") from error
        self.iterations += int(self.built.solver.stats()["iter_count"])
        found = self._judged(np.asarray(answer["x"]).ravel())
        if found.converged:
            return found
        # Stopped on the way, the last iterate need not be the best one.
        others = [start] if watch is None or watch.best is None else [start, watch.best]
        candidates = [found, *(self._judged(flat) for flat in others)]
        return min(candidates, key=lambda each: each.objective)

    def _judged(self, flat: FloatArray) -> _Found:
        """Return a point with its objective and whether it is stationary on the box."""
        flat = np.clip(flat, self.low, self.high)
        objective, slope = self.built.slope(flat, self.values)
        value, descent = float(objective), np.asarray(slope).ravel()
        if not np.isfinite(value):
            return _Found(flat, np.inf, converged=False)
        step = np.clip(flat - descent, self.low, self.high) - flat
        gain = float(np.abs(step * descent).sum())
        return _Found(flat, value, converged=gain <= _STATIONARY * (1.0 + abs(value)))


def _build(shape: Shape, iterations: int, live: bool) -> _Built:  # noqa: FBT001 (a cache key)
    controls, vector, objective = reduced(shape)
    watch = Watch(shape.controls, int(vector.rows())) if live else None
    options: dict[str, Any] = {**_OPTIONS, "max_iter": iterations}
    if watch is not None:
        options["iteration_callback"] = watch
    nlp = {"x": controls, "p": vector, "f": objective}
    slope = ca.gradient(objective, controls)
    return _Built(
        solver=ca.nlpsol("sqp_reduced", "sqpmethod", nlp, options),
        slope=ca.Function("slope", [controls, vector], [objective, slope]),
        objective=ca.Function("objective", [controls, vector], [objective]),
        watch=watch,
    )
