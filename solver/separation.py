"""The last filter before a command leaves: nobody comes nearer than the least distance.

Buffered Voronoi cells (Zhou, Wang, Bandyopadhyay and Schwager, 2017): two robots a distance d
apart with `n` from one to the other may each use up half of what is left over,
`n'(x+ - x) <= (d - d_min) / 2`, and nothing where they are too near already. If both obey, their
distance stays above `d_min` all along the step, or does not shrink. A double integrator counts
the way it needs to brake as well. Each command is replaced by the nearest one that obeys.
"""

import math

import numpy as np

from solver.arrays import FloatArray, IntArray
from solver.pairs import near_pairs
from solver.problem import Dynamics, Problem

_TOLERANCE = 1e-9
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def separated(
    problem: Problem, controls: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return first controls that keep the team apart, the nearest to those given.

    Args:
        problem: Positions, velocities, dynamics, min_dist; obstacles count like team mates.
        controls: (M, 2) wanted at the first step.
        lower: (M, 2) box of the first control, field included.
        upper: (M, 2) likewise.

    Returns:
        (M, 2) inside the box; where no control of it obeys, inside the control limits (the
        field gives way first), and where not even there, the least violation. The same array
        when nothing had to change.
    """
    robots, normals, rooms = _neighbours(problem)
    if not len(robots):
        return controls
    limits = _limits(problem, robots, normals, rooms)
    broken = (normals * controls[robots]).sum(axis=1) > limits + _TOLERANCE
    if not broken.any():
        return controls
    result = controls.copy()
    for row in np.unique(robots[broken]).tolist():
        own = robots == row
        A, b = normals[own], limits[own]
        nearest = _nearest(controls[row], A, b, lower[row], upper[row])
        if nearest is None:
            low, high = problem.control_lower[row], problem.control_upper[row]
            nearest = _nearest(controls[row], A, b, low, high)
            if nearest is None:
                nearest = _least_violation(A, b, low, high)
        result[row] = nearest
    return result


def _neighbours(problem: Problem) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return (E,) robots, (E, 2) unit normals to what is near, (E,) how far they may go."""
    x, least = problem.positions, problem.min_dist_m
    reach = least + 2.0 * _reach(problem)
    first, second = near_pairs(x, reach)
    apart = x[second] - x[first]
    distances = np.hypot(apart[:, 0], apart[:, 1])
    near = distances < reach
    robots, offsets = np.empty(0, dtype=np.int64), np.empty((0, 2))
    if near.any():
        robots = np.concatenate((first[near], second[near]))
        offsets = np.concatenate((apart[near], -apart[near]))
    mates = len(robots) // 2
    if len(problem.obstacles):
        to_obstacles = problem.obstacles[None] - x[:, None]
        at, obstacle = np.nonzero(np.hypot(to_obstacles[..., 0], to_obstacles[..., 1]) < reach)
        robots = np.concatenate((robots, at))
        offsets = np.concatenate((offsets, to_obstacles[at, obstacle]))
    distances = np.hypot(offsets[:, 0], offsets[:, 1])
    # Two robots on one spot have no direction between them: one is made up, the same for both.
    merged = distances < _TOLERANCE
    if merged.any():
        angles = _GOLDEN_ANGLE * np.arange(len(offsets))
        angles[mates : 2 * mates] = angles[:mates] + math.pi
        made_up = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        offsets = np.where(merged[:, None], made_up, offsets)
        distances = np.where(merged, 0.0, distances)
    normals = offsets / np.where(merged, 1.0, distances)[:, None]
    return robots, normals, np.maximum(0.0, 0.5 * (distances - least))


def _reach(problem: Problem) -> float:
    """Return how far any robot can get in one step, braking included, m."""
    h = problem.step_s
    bounds = np.maximum(np.abs(problem.control_lower), np.abs(problem.control_upper))
    strongest = float(np.hypot(bounds[:, 0], bounds[:, 1]).max(initial=0.0))
    if problem.dynamics is Dynamics.SINGLE_INTEGRATOR:
        return h * strongest
    speed = float(np.hypot(problem.velocities[:, 0], problem.velocities[:, 1]).max(initial=0.0))
    after = speed + h * strongest
    braking = float(_braking(problem).min(initial=math.inf))
    return h * after + after * after / (2.0 * braking) + 0.5 * h * after


def _braking(problem: Problem) -> FloatArray:
    """Return the deceleration each robot has in every direction, (M,), m/s^2."""
    weakest = np.minimum(-problem.control_lower, problem.control_upper).min(axis=1)
    return np.asarray(np.maximum(weakest, 1e-6))


def _limits(
    problem: Problem, robots: IntArray, normals: FloatArray, rooms: FloatArray
) -> FloatArray:
    """Return the greatest n'u allowed to each robot towards each neighbour, (E,).

    For a double integrator with speed v towards the neighbour now and w after the step, the
    way gone is h (v + w) / 2 and the way to brake in whole steps at most w^2 / 2a + w h / 2.
    """
    h = problem.step_s
    if problem.dynamics is Dynamics.SINGLE_INTEGRATOR:
        return rooms / h
    a = _braking(problem)[robots]
    v = (normals * problem.velocities[robots]).sum(axis=1)
    spare = rooms - 0.5 * h * v
    approaching = a * (np.sqrt(h * h + 2.0 * np.maximum(spare, 0.0) / a) - h)
    w = np.where(spare >= 0.0, approaching, 2.0 * spare / h)
    return np.asarray((w - v) / h)


def _nearest(
    wanted: FloatArray, A: FloatArray, b: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray | None:
    """Return the point of {A u <= b, lower <= u <= upper} nearest to the one wanted, or None.

    In the plane the nearest point is the wanted one, its projection on one edge, or a vertex:
    all of them are tried.
    """
    sides = np.concatenate((A, np.eye(2), -np.eye(2)))
    ends = np.concatenate((b, upper, -lower))
    excess = sides @ wanted - ends
    projections = wanted - excess[:, None] * sides
    candidates = np.concatenate((wanted[None], projections, _vertices(sides, ends)))
    allowed = (candidates @ sides.T <= ends + _TOLERANCE).all(axis=1)
    if not allowed.any():
        return None
    candidates = candidates[allowed]
    distance = ((candidates - wanted) ** 2).sum(axis=1)
    return np.asarray(np.clip(candidates[int(np.argmin(distance))], lower, upper))


def _vertices(sides: FloatArray, ends: FloatArray) -> FloatArray:
    """Return where the lines {sides u = ends} cross, (V, 2)."""
    first, second = np.triu_indices(len(sides), 1)
    p, q = sides[first], sides[second]
    determinant = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    crossing = np.abs(determinant) > 1e-12
    p, q, determinant = p[crossing], q[crossing], determinant[crossing]
    s, t = ends[first[crossing]], ends[second[crossing]]
    x = (s * q[:, 1] - t * p[:, 1]) / determinant
    y = (t * p[:, 0] - s * q[:, 0]) / determinant
    return np.stack((x, y), axis=1)


def _least_violation(
    A: FloatArray, b: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return the point of the box whose worst violation of A u <= b is least.

    Nearly so: among the box's corners, the crossings of lines with it, and its middle.
    """
    sides = np.concatenate((A, np.eye(2), -np.eye(2)))
    ends = np.concatenate((b, upper, -lower))
    corners = np.stack(np.meshgrid(*zip(lower, upper, strict=True)), axis=-1).reshape(-1, 2)
    middle = 0.5 * (lower + upper)
    crossings = np.clip(_vertices(sides, ends), lower, upper)
    candidates = np.concatenate((corners, middle[None], crossings))
    worst = (candidates @ A.T - b).max(axis=1)
    return np.asarray(candidates[int(np.argmin(worst))])
