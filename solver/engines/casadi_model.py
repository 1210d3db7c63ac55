"""The planning problem as CasADi expressions, one set per shape.

A shape is the numbers of robots, targets, zones and obstacles (rounded up to powers of two,
the surplus masked), the horizon and the dynamics. Everything else (positions, who sees whom,
which zones are known, weights, limits) is a parameter, so that an expression is built once and
serves every tick of that shape.

Scalar expressions (SX) throughout: up to five times faster to evaluate than MX here.
"""

from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca
import numpy as np

from solver import matrices
from solver.arrays import FloatArray
from solver.objective import MATE_SMOOTHING_M, PRIOR_GREATEST, PRIOR_LEAST, ZONE_SMOOTHING_M
from solver.problem import Dynamics, Problem, ZoneTable
from solver.sensing import TARGET_FLOOR_M

Expression: TypeAlias = ca.SX
Symbols: TypeAlias = dict[str, ca.SX]


@dataclass(frozen=True, slots=True)
class Shape:
    """What an expression is built for."""

    robots: int
    targets: int
    sensing: int
    communication: int
    obstacles: int
    horizon: int
    dynamics: Dynamics

    @property
    def controls(self) -> int:
        """Return the number of control variables."""
        return 2 * self.robots * self.horizon


def shape_of(problem: Problem) -> Shape:
    """Return the shape whose expressions serve a problem."""
    return Shape(
        robots=_rounded(len(problem.robot_ids)),
        targets=_rounded(len(problem.target_priors)),
        sensing=_rounded(len(problem.sensing.centres)),
        communication=_rounded(len(problem.communication.centres)),
        obstacles=_rounded(len(problem.obstacles)),
        horizon=problem.horizon,
        dynamics=problem.dynamics,
    )


def padded(values: FloatArray, rows: int) -> FloatArray:
    """Return an array with zero rows added up to `rows`."""
    result = np.zeros((rows, *values.shape[1:]))
    result[: len(values)] = values
    return result


def parameters(problem: Problem, shape: Shape) -> FloatArray:
    """Return the problem's data as one vector in the order `symbols` gives them."""
    centre = 0.5 * (problem.field_lower + problem.field_upper)
    count = len(problem.robot_ids)
    positions = np.tile(centre, (shape.robots, 1))
    positions[:count] = problem.positions
    velocities = np.zeros((shape.robots, 2))
    if problem.dynamics is Dynamics.DOUBLE_INTEGRATOR:
        velocities[:count] = problem.velocities
    sees = np.zeros((shape.robots, shape.targets))
    sees[:count, : problem.sees.shape[1]] = problem.sees
    priors = np.tile(np.eye(2), (shape.targets, 1, 1))
    targets = len(problem.target_priors)
    priors[:targets] = matrices.clamped(problem.target_priors, PRIOR_LEAST, PRIOR_GREATEST)
    means = np.moveaxis(problem.target_means, 0, 1).reshape(targets, 2 * shape.horizon)
    growth = np.moveaxis(_three(problem.target_growth), 0, 1).reshape(targets, 3 * shape.horizon)
    sensor, weights = problem.sensor, problem.weights
    values = {
        "step": np.array([[problem.step_s]]),
        "present": padded(np.ones((count, 1)), shape.robots),
        "positions": positions,
        "velocities": velocities,
        "speed": padded(problem.speed_limit[:, None], shape.robots),
        "field": np.stack((problem.field_lower, problem.field_upper)),
        "sees": sees,
        "tracked": padded(np.ones((targets, 1)), shape.targets),
        "means": padded(means, shape.targets),
        "priors": _three(priors),
        "growth": padded(growth, shape.targets),
        "sensor": np.array(
            [
                [
                    sensor.range_peak,
                    sensor.range_shape,
                    sensor.bearing_peak,
                    sensor.bearing_shape,
                ]
            ]
        ),
        "obstacles": padded(problem.obstacles.reshape(-1, 2), shape.obstacles),
        "blocking": padded(np.ones((len(problem.obstacles), 1)), shape.obstacles),
        "weights": np.array(
            [[*weights, problem.separation_weight, problem.min_dist_m, problem.field_weight]]
        ),
    }
    for name, table, zones in (
        ("sensing", problem.sensing, shape.sensing),
        ("communication", problem.communication, shape.communication),
    ):
        values[f"{name} zones"], values[f"{name} known"] = _zones(table, shape.robots, zones)
    return np.concatenate([values[name].ravel("F") for name in _sizes(shape)])


def symbols(shape: Shape) -> tuple[Expression, Symbols]:
    """Return the parameter vector and its blocks by name."""
    vector = ca.SX.sym("p", sum(rows * columns for rows, columns in _sizes(shape).values()))
    blocks, at = {}, 0
    for name, (rows, columns) in _sizes(shape).items():
        blocks[name] = ca.reshape(vector[at : at + rows * columns], rows, columns)
        at += rows * columns
    return vector, blocks


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the horizon: what is penalised, before any hinge."""

    trace: Expression
    """Sum of the predicted traces, scalar."""

    sensing: Expression
    communication: Expression
    """(M, K) values g of the constraints g >= 0; a zone not known has no meaning here."""

    mates: Expression
    """(M, M) smoothed distances; those above the diagonal count."""

    obstacles: Expression
    """(M, O) smoothed distances."""

    beyond: Expression
    """Squared excess over field and speed limit, scalar."""


def steps(shape: Shape, controls: Expression, data: Symbols) -> list[Step]:
    """Return the steps 1..H for controls given as one vector in (M, H, 2) order."""
    # Column-major: one column per robot, its entries ordered (step, axis).
    U = ca.reshape(controls, 2 * shape.horizon, shape.robots)
    h, X, V = data["step"], data["positions"], data["velocities"]
    a, b, c = (data["priors"][:, entry] for entry in range(3))
    result = []
    for k in range(shape.horizon):
        u = U[2 * k : 2 * k + 2, :].T
        if shape.dynamics is Dynamics.SINGLE_INTEGRATOR:
            X = X + h * u
        else:
            X, V = X + h * V + 0.5 * h * h * u, V + h * u
        if k:
            growth = data["growth"][:, 3 * k : 3 * k + 3]
            a, b, c = a + growth[:, 0], b + growth[:, 1], c + growth[:, 2]
        a, b, c = _posterior(X, data["means"][:, 2 * k : 2 * k + 2], (a, b, c), data)
        mates = _distances(X, X)
        beyond = ca.SX(0)
        if k:
            beyond = _beyond(X, data["field"][0, :], data["field"][1, :])
            if shape.dynamics is Dynamics.DOUBLE_INTEGRATOR:
                limit = ca.repmat(data["speed"], 1, 2)
                beyond += ca.sumsqr(ca.fmax(0, ca.fabs(V) - limit))
        sensing = _zone_values(X, data["sensing zones"], ca.SX.ones(shape.robots, 1))
        spread = _spread(mates, data["present"])
        communication = _zone_values(X, data["communication zones"], spread)
        result.append(
            Step(
                trace=ca.dot(a + c, data["tracked"]),
                sensing=sensing,
                communication=communication,
                mates=mates,
                obstacles=_distances(X, data["obstacles"]),
                beyond=beyond,
            )
        )
    return result


def reduced(shape: Shape) -> tuple[Expression, Expression, Expression]:
    """Return controls, parameters and the reduced objective."""
    controls = ca.SX.sym("u", shape.controls)
    vector, data = symbols(shape)
    w = [data["weights"][0, entry] for entry in range(7)]
    total = w[1] * ca.sumsqr(controls)
    for step in steps(shape, controls, data):
        total += w[0] * step.trace + w[6] * step.beyond
        for name, weight, values in (
            ("sensing", w[2], step.sensing),
            ("communication", w[3], step.communication),
        ):
            severity = data[f"{name} zones"][:, 7]
            hinge = data[f"{name} known"] * ca.fmax(0, -values) ** 2
            total += weight * ca.sum1(ca.mtimes(hinge, severity))
        pairs = ca.mtimes(data["present"], data["present"].T)
        # Every pair stands twice in the matrix; the diagonal is a robot's distance to itself.
        pairs -= ca.diag(ca.diag(pairs))
        crowding = 0.5 * ca.sum1(ca.sum2(pairs * ca.fmax(0, w[5] - step.mates) ** 2))
        blocked = ca.mtimes(data["present"], data["blocking"].T)
        crowding += ca.sum1(ca.sum2(blocked * ca.fmax(0, w[5] - step.obstacles) ** 2))
        total += w[4] * crowding
    return controls, vector, total


def _rounded(count: int) -> int:
    return 1 << (count - 1).bit_length() if count else 0


def _three(stack: FloatArray) -> FloatArray:
    """Return the upper triangles (..., 3) of symmetric 2x2 matrices."""
    return np.stack((stack[..., 0, 0], stack[..., 0, 1], stack[..., 1, 1]), axis=-1)


def _zones(table: ZoneTable, robots: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Return zone rows (x, y, Sxx, Sxy, Syy, margin, quantile, severity), and who knows them."""
    rows = np.zeros((count, 8))
    # A masked zone must still have a spread: 0 would divide by zero.
    rows[:, 2] = rows[:, 4] = 1.0
    given = len(table.centres)
    rows[:given, :2] = table.centres
    rows[:given, 2:5] = _three(table.covariances)
    rows[:given, 5] = table.margins
    rows[:given, 6] = table.quantiles
    rows[:given, 7] = table.severities
    known = np.zeros((robots, count))
    known[: len(table.known), :given] = table.known
    return rows, known


def _sizes(shape: Shape) -> dict[str, tuple[int, int]]:
    """Return the blocks of the parameter vector: rows and columns by name, in order."""
    M, N, H = shape.robots, shape.targets, shape.horizon
    return {
        "step": (1, 1),
        "present": (M, 1),
        "positions": (M, 2),
        "velocities": (M, 2),
        "speed": (M, 1),
        "field": (2, 2),
        "sees": (M, N),
        "tracked": (N, 1),
        "means": (N, 2 * H),
        "priors": (N, 3),
        "growth": (N, 3 * H),
        "sensor": (1, 4),
        "obstacles": (shape.obstacles, 2),
        "blocking": (shape.obstacles, 1),
        "weights": (1, 7),
        "sensing zones": (shape.sensing, 8),
        "sensing known": (M, shape.sensing),
        "communication zones": (shape.communication, 8),
        "communication known": (M, shape.communication),
    }


def _between(X: Expression, Y: Expression) -> tuple[Expression, Expression]:
    """Return the offsets X_i - Y_j as two matrices."""
    dx, dy = (
        ca.repmat(X[:, axis], 1, Y.rows()) - ca.repmat(Y[:, axis].T, X.rows(), 1)
        for axis in range(2)
    )
    return dx, dy


def _distances(X: Expression, Y: Expression) -> Expression:
    dx, dy = _between(X, Y)
    return ca.sqrt(dx * dx + dy * dy + ZONE_SMOOTHING_M**2) - ZONE_SMOOTHING_M


def _posterior(
    X: Expression,
    means: Expression,
    prior: tuple[Expression, Expression, Expression],
    data: Symbols,
) -> tuple[Expression, Expression, Expression]:
    """Return the entries of the posterior covariances, each (N, 1)."""
    a, b, c = prior
    dx, dy = _between(X, means)
    squared = dx * dx + dy * dy + TARGET_FLOOR_M**2
    rho = ca.sqrt(squared)
    peak_r, shape_r, peak_b, shape_b = (data["sensor"][0, entry] for entry in range(4))
    along = data["sees"] * peak_r * ca.exp(-shape_r * rho) / squared
    across = data["sees"] * peak_b * ca.exp(-shape_b * rho) / (squared * squared)
    scale = 1 / (a * c - b * b)
    y11 = c * scale + ca.sum1(along * dx * dx + across * dy * dy).T
    y22 = a * scale + ca.sum1(along * dy * dy + across * dx * dx).T
    y12 = -b * scale + ca.sum1((along - across) * dx * dy).T
    scale = 1 / (y11 * y22 - y12 * y12)
    return y22 * scale, -y12 * scale, y11 * scale


def _zone_values(X: Expression, zones: Expression, factor: Expression) -> Expression:
    """Return g for all robots and zones, (M, K); the margin is multiplied by `factor` (M, 1)."""
    e2 = ZONE_SMOOTHING_M**2
    dx, dy = _between(X, zones[:, :2])
    squared = dx * dx + dy * dy + e2

    def row(entry: int) -> Expression:
        return ca.repmat(zones[:, entry].T, X.rows(), 1)

    spread = row(2) * dx * dx + 2 * row(3) * dx * dy + row(4) * dy * dy
    spread += 0.5 * e2 * (row(2) + row(4))
    margins = ca.mtimes(factor, zones[:, 5].T)
    return ca.sqrt(squared) - ZONE_SMOOTHING_M - row(6) * ca.sqrt(spread / squared) - margins


def _spread(mates: Expression, present: Expression) -> Expression:
    """Return the soft maximum (M, 1) of each robot's distances to the other ones present."""
    tau = MATE_SMOOTHING_M
    rows = []
    for i in range(present.rows()):
        others = [m for m in range(present.rows()) if m != i]
        if not others:
            return ca.SX.zeros(1, 1)
        mask = ca.vertcat(*(present[m] for m in others))
        distances = mask * ca.vertcat(*(mates[i, m] for m in others))
        farthest = ca.mmax(distances)
        total = ca.sum1(mask * ca.exp((distances - farthest) / tau))
        # With nobody else present the sum is 0: no spread, and no logarithm of it.
        anybody = ca.mmax(mask)
        rows.append(anybody * (farthest + tau * ca.log(total + 1 - anybody)))
    return ca.vertcat(*rows)


def _beyond(X: Expression, low: Expression, high: Expression) -> Expression:
    low, high = ca.repmat(low, X.rows(), 1), ca.repmat(high, X.rows(), 1)
    return ca.sumsqr(ca.fmax(0, low - X)) + ca.sumsqr(ca.fmax(0, X - high))
