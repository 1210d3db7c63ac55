"""Where directives would lead: the optimizer flown ahead on beliefs, with no dice.

From the snapshot's beliefs the team is planned and moved on, as the mission would do it: each
plan is flown to its end before the next is made. Targets keep their smoothed velocities, robots
in sensing failure see again after the usual time, jammed ones stand where they were last seen
and report again after the usual time, and zones are those that are known. Deterministic: plans
are bounded by iterations.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from server.gate.merit import COMMUNICATION_FAILURE_S, SENSING_FAILURE_S, Merit
from server.mission.setup import Compat, MissionSetup
from solver import matrices
from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool
from solver.planner import Planner
from solver.problem import Budget, Problem, Solution
from solver.sensing import information
from solver.snapshot import Snapshot
from solver.zones import Zone, ZoneKind

WEIGHTS_HORIZON_S = 5.0
LONGEST_HORIZON_S = 30.0

MOST_STEPS = 60
"""Of a roll-out; longer horizons take longer steps."""

BUDGET = Budget(iterations=60)
"""Of one plan."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What both roll-outs of a comparison have in common. M planned robots, N known targets."""

    setup: MissionSetup
    positions: FloatArray
    """(N, 2) targets now."""

    drift: FloatArray
    """(N, 2) their smoothed velocities, m/s."""

    covariances: FloatArray
    """(N, 2, 2) now."""

    blind: BoolArray
    """(M,) robots in sensing failure."""

    absent: FloatArray
    """(K, 2) jammed robots, where they were last seen."""

    zones: tuple[Zone, ...]
    known: BoolArray
    """(M, Z)."""

    tick_s: float
    """Time between measurements."""

    likely: FloatArray | None = None
    """(Z,) what each zone's density counts for: less than 1 where it may not exist, or be weaker.
    None counts all in full."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One side of a comparison."""

    problem: Problem
    """The first plan's."""

    assigned: BoolArray
    """(M, N) whom the planned robots track, failures left aside."""

    absent: BoolArray
    """(K, N) whom the jammed robots track."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What the gate is asked: the directives in force beside those proposed."""

    scene: Scene
    in_force: Course
    proposed: Course
    horizon_s: float


@dataclass(frozen=True, slots=True)
class Forecast:
    """What both sides are predicted to come to over the same time."""

    horizon_s: float
    in_force: Merit
    proposed: Merit


def forecast(comparison: Comparison, planner: Planner) -> Forecast:
    """Return the predicted merits of both sides. A pure function; may run in another thread."""
    scene, horizon_s = comparison.scene, comparison.horizon_s
    return Forecast(
        horizon_s,
        rolled(scene, comparison.in_force, horizon_s, planner),
        rolled(scene, comparison.proposed, horizon_s, planner),
    )


def rolled(scene: Scene, course: Course, horizon_s: float, planner: Planner) -> Merit:
    """Fly one course ahead and return its merit."""
    problem = course.problem
    step_s = max(problem.step_s, horizon_s / MOST_STEPS)
    count = math.ceil(horizon_s / step_s - 1e-9)
    P, growth = scene.covariances, problem.target_priors - scene.covariances
    growth = growth * (step_s / problem.step_s)
    problem = _stretched(problem, step_s)
    paths, speeds, trace = [], [], 0.0
    done = 0
    while done < count:
        plan = planner.solve(_seen_at(scene, course, problem, done * step_s), BUDGET)
        steps = min(problem.horizon, count - done)
        for k in range(steps):
            done += 1
            where = plan.positions[:, k]
            P = _measured(scene, course, P + growth, where, done * step_s, step_s)
            trace += float(P[:, 0, 0].sum() + P[:, 1, 1].sum())
            paths.append(where)
            speeds.append(plan.velocities[:, k])
        problem = _moved_on(scene, problem, plan, P + growth, steps)
    hits = expected_hits(scene, np.array(paths)) * step_s
    return Merit(
        seconds=count * step_s,
        trace=trace * step_s,
        sensing_hits=float(hits[0]),
        communication_hits=float(hits[1]),
        effort=float((np.array(speeds) ** 2).sum()) * step_s,
    )


def expected_hits(scene: Scene, paths: FloatArray) -> FloatArray:
    """Return the expected hits per second along paths (K, M, 2), summed: sensing, communication.

    A zone that a robot knows hits it at the rate min(1, density) / attack period, and, if it is
    one of communication, at the rate 1 / attack period within margin * spread of its centre:
    the mission's own law of attacks, which severities and weights do not touch. A zone that was
    inferred counts by how likely it is: its density is that to be expected already.
    """
    rates = np.zeros(2)
    if not scene.zones or not paths.shape[1]:
        return rates
    gaps = np.linalg.norm(paths[:, :, None] - paths[:, None], axis=-1)
    spread = gaps.max(axis=2)
    if scene.setup.compat is Compat.AUTHORS:
        spread = np.sqrt(spread)
    for z, zone in enumerate(scene.zones):
        rate = np.minimum(1.0, zone.density(paths))
        jams = zone.kind is ZoneKind.COMMUNICATION
        if jams:
            distance = np.linalg.norm(paths - np.asarray(zone.mean), axis=-1)
            rate = np.where(distance < zone.margin * spread, 1.0, rate)
        share = 1.0 if scene.likely is None else float(scene.likely[z])
        rates[int(jams)] += share * float((rate * scene.known[:, z]).sum())
    return rates / scene.setup.planner.attack_period_s


def travel_s(snapshot: Snapshot, pairs: set[tuple[int, int]], speed_m_s: float) -> float:
    """Return the longest time to fly to the target of a new pair, within the gate's horizons."""
    robots = {robot_id: i for i, robot_id in enumerate(snapshot.robots.ids)}
    targets = {target_id: j for j, target_id in enumerate(snapshot.tracks.ids)}
    places, goals = snapshot.robots.positions, snapshot.tracks.positions
    ways = [
        float(np.hypot(*(goals[targets[t]] - places[robots[r]])))
        for r, t in pairs
        if r in robots and t in targets
    ]
    longest_s = max(ways, default=0.0) / max(speed_m_s, 1e-3)
    return min(LONGEST_HORIZON_S, max(WEIGHTS_HORIZON_S, math.ceil(longest_s)))


def _stretched(problem: Problem, step_s: float) -> Problem:
    """Return the problem with a longer step; the warm start is read off at the new times."""
    ratio = step_s / problem.step_s
    if ratio == 1.0:
        return problem
    previous = problem.previous
    if previous is not None:
        rows = np.minimum((np.arange(problem.horizon) * ratio).astype(int), problem.horizon - 1)
        previous = frozen(previous[:, rows])
    return replace(
        problem,
        step_s=step_s,
        previous=previous,
        target_growth=frozen(problem.target_growth * ratio),
    )


def _seen_at(scene: Scene, course: Course, problem: Problem, time_s: float) -> Problem:
    """Return the problem with the robots that see at a time."""
    blind_s = scene.setup.planner.sensing_failure_s or SENSING_FAILURE_S
    sees = course.assigned & ~(scene.blind & (time_s < blind_s))[:, None]
    return replace(problem, sees=frozen_bool(sees))


def _measured(
    scene: Scene, course: Course, prior: FloatArray, where: FloatArray, time_s: float, step_s: float
) -> FloatArray:
    """Return the covariances after a step's expected measurements from places (M, 2)."""
    setup = scene.setup
    blind_s = setup.planner.sensing_failure_s or SENSING_FAILURE_S
    jammed_s = setup.planner.communication_failure_s or COMMUNICATION_FAILURE_S
    sees = course.assigned & ~(scene.blind & (time_s <= blind_s))[:, None]
    if len(scene.absent):
        where = np.concatenate((where, scene.absent))
        sees = np.concatenate((sees, course.absent & (time_s > jammed_s)))
    targets = scene.positions + time_s * scene.drift
    told = information(setup.sensor, where[:, None] - targets[None]) * sees[..., None, None]
    gained = told.sum(axis=0) * (step_s / scene.tick_s)
    return matrices.inverse(matrices.inverse(prior) + gained)


def _moved_on(
    scene: Scene, problem: Problem, plan: Solution, priors: FloatArray, steps: int
) -> Problem:
    """Return the problem of the next plan, after `steps` steps of the last one."""
    flown_s = steps * problem.step_s
    last = plan.controls[:, steps - 1 : steps]
    return replace(
        problem,
        positions=plan.positions[:, steps - 1],
        velocities=plan.velocities[:, steps - 1],
        target_means=frozen(problem.target_means + flown_s * scene.drift),
        target_priors=frozen(priors),
        previous=frozen(np.repeat(last, problem.horizon, axis=1)),
        replan=frozen_bool(np.zeros(len(problem.robot_ids), dtype=bool)),
    )
