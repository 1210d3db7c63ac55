"""Knowledge and planners for tests of flying alone."""

from dataclasses import replace

import numpy as np

from solver.directives import Weights
from solver.hypotheses import Law
from solver.observations import OnboardTrack
from solver.problem import Budget, Dynamics, Problem, Rung, Solution
from solver.zones import Zone, ZoneKind
from vehicles.inference import InferenceRules
from vehicles.knowledge import FlightRules, Knowledge, Mate

RULES = FlightRules(
    step_s=0.5,
    horizon=1,
    dynamics=Dynamics.SINGLE_INTEGRATOR,
    control_lower=(-0.5, -0.5),
    control_upper=(0.5, 0.5),
    speed_limit_m_s=0.5,
    field_lower=(-10.0, -10.0),
    field_upper=(10.0, 10.0),
    min_dist_m=0.4,
    separation_weight=100.0,
)
INFERENCE = InferenceRules(
    law=Law(period_s=1.0, step_s=0.2, recover_density=0.08, per_m2=0.0125, fault_rate=0.0005),
    memory_s=600.0,
    confidence=0.5,
    risk=0.02,
    risk_single=0.05,
)
SENSING = Zone("s1", ZoneKind.SENSING, (4.0, 0.0), ((0.4, 0.0), (0.0, 0.4)), 0.1, 0.1, 0.1)
JAMMING = Zone("c1", ZoneKind.COMMUNICATION, (0.0, 4.0), ((0.6, 0.0), (0.0, 0.6)), 0.2, 0.05, 0.3)


def track(target_id: int, x: float, y: float, variance: float = 0.2) -> OnboardTrack:
    return OnboardTrack(target_id, (x, y), ((variance, 0.0), (0.0, variance)))


def knowledge(robot_id: int = 21, time_s: float = 10.0) -> Knowledge:
    return Knowledge(
        robot_id=robot_id,
        mission="m1",
        time_s=time_s,
        rules=RULES,
        weights=Weights(10.0, 0.05, 50.0, 50.0),
        targets=(122, 124),
        tracks=(track(122, 1.0, 0.0), track(124, 2.0, 2.0)),
        zones=(SENSING, JAMMING),
        severities=(("c1", 2.0),),
        mates=(Mate(26, (3.0, 3.0)),),
    )


class Recorder:
    """A planner that keeps the problems and flies east at 0.1 m/s."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        self.problems.append(problem)
        controls = np.tile([0.1, 0.0], (1, problem.horizon, 1)).astype(float)
        controls[0, :, 1] = np.arange(problem.horizon)
        ways = problem.step_s * np.cumsum(controls, axis=1)
        return Solution(
            robot_ids=problem.robot_ids,
            controls=controls,
            positions=problem.positions[:, None, :] + ways,
            velocities=controls,
            objective=0.0,
            rung=Rung.CONVERGED,
            iterations=1,
            solve_s=0.0,
            engine="recorder",
        )


def with_rules(known: Knowledge, **changes: object) -> Knowledge:
    return replace(known, rules=replace(known.rules, **changes))  # type: ignore[arg-type]
