"""Our own assignment solver in the place of the task model: the baseline models are held to."""

from server.mission.changes import assignment_proposal
from server.mission.setup import MissionSetup
from solver.assignment import AssignmentSettings, assign
from solver.beliefs import MotionModel
from solver.directives import Proposal, Source
from solver.problem import Dynamics
from solver.snapshot import Snapshot

DRIFT_M2_S = 0.1
"""Uncertainty of a target's position per second where the filter's noise is of its velocity."""


class ExactSolver:
    """Proposes the assignment of least predicted trace. Deterministic; keeps no state."""

    def __init__(self, setup: MissionSetup) -> None:
        self._sensor = setup.sensor
        self._settings = assignment_settings(setup)

    def propose(self, snapshot: Snapshot, name: str) -> Proposal:
        """Return the best assignment of a snapshot as a proposal."""
        pairs = assign(snapshot, self._sensor, self._settings)
        return assignment_proposal(name, Source.EXACT, snapshot, pairs)


def assignment_settings(setup: MissionSetup) -> AssignmentSettings:
    """Return how the solver looks ahead in a mission: its robots' speed, its targets' drift."""
    walking = setup.filter.model is MotionModel.RANDOM_WALK
    return AssignmentSettings(
        speed_m_s=min((_speed_m_s(setup, row) for row in range(len(setup.robots))), default=0.5),
        process_noise=setup.filter.process_noise if walking else DRIFT_M2_S,
    )


def _speed_m_s(setup: MissionSetup, row: int) -> float:
    robot = setup.robots[row]
    if setup.dynamics is Dynamics.DOUBLE_INTEGRATOR:
        return robot.speed_limit_m_s
    return min(*robot.control_upper, *(-bound for bound in robot.control_lower))
