"""The oracle: IPOPT on the slack form of the problem, slow and trustworthy.

Here the soft constraints stay constraints, `g(x) + slack >= 0`, as the paper states them
(eq. 3); the fast engines minimise the reduced form, which has the same optimum. Used by tests,
benchmarks and people who want to check an answer.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from solver.arrays import FloatArray, frozen
from solver.bounds import control_box, rollout
from solver.engines.casadi_model import Shape, padded, parameters, shape_of, steps, symbols
from solver.engines.recent import Recent
from solver.objective import cost
from solver.problem import Budget, EngineFailed, Problem, Rung, Solution

_KEPT = 8
_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.mu_strategy": "adaptive",
    "print_time": False,
    "error_on_fail": False,
}


@dataclass(frozen=True, slots=True)
class _Built:
    solver: Any
    constraints: Any
    """(controls, parameters) -> values g of all soft constraints at zero slack."""

    known: Any
    """parameters -> 1 for each constraint that is in force."""

    count: int


class IpoptEngine:
    """Solves the slack form with IPOPT, from the last plan or from rest."""

    name = "ipopt"

    def __init__(self, kept: int = _KEPT) -> None:
        """Make an engine that keeps the solvers of so many shapes."""
        self._built: Recent[tuple[Shape, Budget], _Built] = Recent(kept)

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return the local optimum reached from the warm start.

        Raises:
            EngineFailed: IPOPT ended without finite controls.
        """
        shape = (len(problem.robot_ids), problem.horizon, 2)
        start = np.zeros(shape) if problem.previous is None else problem.previous
        return self.solve_from(problem, budget, start)

    def solve_from(self, problem: Problem, budget: Budget, start: FloatArray) -> Solution:
        """Return the local optimum reached from controls (M, H, 2).

        Raises:
            EngineFailed: IPOPT ended without finite controls.
        """
        began = time.thread_time()
        shape = shape_of(problem)
        built = self._built.get((shape, budget), lambda: _build(shape, budget))
        lower, upper = control_box(problem)
        bounds = [padded(b, shape.robots).ravel() for b in (lower, upper)]
        at = padded(np.clip(start, lower, upper), shape.robots).ravel()
        values = parameters(problem, shape)
        g = np.asarray(built.constraints(at, values)).ravel()
        known = np.asarray(built.known(values)).ravel() > 0.5
        slack = np.where(known, np.maximum(0.0, -g), 0.0)
        try:
            found = built.solver(
                x0=np.concatenate((at, slack)),
                p=values,
                lbx=np.concatenate((bounds[0], np.zeros(built.count))),
                ubx=np.concatenate((bounds[1], np.full(built.count, np.inf))),
                lbg=np.where(known, 0.0, -np.inf),
                ubg=np.full(built.count, np.inf),
            )
        except RuntimeError as error:
            raise EngineFailed("IPOPT: ill-posed problem") from error
        statistics = built.solver.stats()
        controls = np.asarray(found["x"]).ravel()[: shape.controls]
        if not np.isfinite(controls).all():
            raise EngineFailed(f"IPOPT: {statistics['return_status']}")
        controls = controls.reshape(shape.robots, shape.horizon, 2)[: len(lower)]
        controls = np.clip(controls, lower, upper)
        positions, velocities = rollout(problem, controls)
        return Solution(
            robot_ids=problem.robot_ids,
            controls=frozen(controls),
            positions=frozen(positions),
            velocities=frozen(velocities),
            objective=cost(problem, controls),
            rung=Rung.CONVERGED if statistics["success"] else Rung.FEASIBLE,
            iterations=int(statistics["iter_count"]),
            solve_s=time.thread_time() - began,
            engine=self.name,
        )

    def best_of_starts(self, problem: Problem, count: int, seed: int = 0) -> Solution:
        """Return the best optimum of `every_start`, with the iterations of them all.

        Raises:
            ExceptionGroup: No start led to finite controls; holds each start's `EngineFailed`.
        """
        found = self.every_start(problem, count, seed)
        best = min(found, key=lambda solution: solution.objective)
        return replace(best, iterations=sum(solution.iterations for solution in found))

    def every_start(self, problem: Problem, count: int, seed: int = 0) -> list[Solution]:
        """Return the optima from `count` starts: the last plan, rest, and random ones.

        Raises:
            ExceptionGroup: No start led to finite controls; holds each start's `EngineFailed`.
        """
        lower, upper = control_box(problem)
        dice = np.random.default_rng(seed)
        starts = [np.zeros_like(lower)]
        if problem.previous is not None:
            starts.insert(0, problem.previous)
        while len(starts) < count:
            # One direction per robot, kept over the horizon: only such starts lead far away.
            share = dice.random((len(lower), 1, 2))
            starts.append(lower + share * (upper - lower))
        found: list[Solution] = []
        failures: list[EngineFailed] = []
        for start in starts[:count]:
            try:
                found.append(self.solve_from(problem, Budget(iterations=500), start))
            except EngineFailed as failure:
                failures.append(failure)
        if not found:
            raise ExceptionGroup("no start led anywhere", failures)
        return found


def _build(shape: Shape, budget: Budget) -> _Built:
    """Return IPOPT for the slack form of one shape."""
    controls = ca.SX.sym("u", shape.controls)
    vector, data = symbols(shape)
    w = [data["weights"][0, entry] for entry in range(7)]
    objective = w[1] * ca.sumsqr(controls)
    values, known, prices = [], [], []
    pairs = [(i, m) for i in range(shape.robots) for m in range(i)]
    for step in steps(shape, controls, data):
        objective += w[0] * step.trace + w[6] * step.beyond
        for name, weight, g in (
            ("sensing", w[2], step.sensing),
            ("communication", w[3], step.communication),
        ):
            severity = ca.repmat(data[f"{name} zones"][:, 7].T, shape.robots, 1)
            values.append(ca.vec(g))
            known.append(ca.vec(data[f"{name} known"]))
            prices.append(ca.vec(weight * severity))
        present = data["present"]
        for i, m in pairs:
            values.append(step.mates[m, i] - w[5])
            known.append(present[i] * present[m])
            prices.append(w[4])
        values.append(ca.vec(step.obstacles) - w[5])
        known.append(ca.vec(ca.mtimes(present, data["blocking"].T)))
        prices.append(w[4] * ca.SX.ones(shape.robots * shape.obstacles, 1))
    g = ca.vertcat(*values)
    slack = ca.SX.sym("slack", g.rows())
    objective += ca.dot(ca.vertcat(*prices), slack * slack)
    options: dict[str, Any] = {**_OPTIONS, "ipopt.max_iter": budget.iterations}
    if budget.deadline_s is not None:
        options["ipopt.max_wall_time"] = budget.deadline_s
    nlp = {"x": ca.vertcat(controls, slack), "p": vector, "f": objective, "g": g + slack}
    return _Built(
        solver=ca.nlpsol("ipopt_slack", "ipopt", nlp, options),
        constraints=ca.Function("constraints", [controls, vector], [g]),
        known=ca.Function("known", [vector], [ca.vertcat(*known)]),
        count=int(g.rows()),
    )
