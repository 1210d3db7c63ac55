"""One tick's planning problem, its solution, and the seam where engines plug in.

Paper, eq. (3): choose controls that minimise the weighted sum of predicted trace, effort
and the slacks of the safety constraints. Everything an engine needs is in the problem,
everything it answers is in the solution; engines keep no mission state.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from solver.arrays import BoolArray, FloatArray
from solver.directives import Weights


class Dynamics(StrEnum):
    """How a control moves a robot over one step h."""

    SINGLE_INTEGRATOR = "single_integrator"
    """x+ = x + h u; u is a velocity (m/s)."""

    DOUBLE_INTEGRATOR = "double_integrator"
    """x+ = x + h v + h^2/2 u, v+ = v + h u; u is an acceleration (m/s^2)."""


class Rung(StrEnum):
    """Which step of the ladder the setpoints come from."""

    CONVERGED = "converged"
    FEASIBLE = "feasible"
    """The best feasible iterate when the budget ran out."""

    SHIFTED = "shifted"
    """The last plan, one step on."""

    BRAKE = "brake"


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Range and bearing noise that grows with distance: 1/R = peak exp(-shape d)."""

    range_peak: float = 15.0
    """1/m^2."""

    range_shape: float = 0.2
    """1/m."""

    bearing_peak: float = 15.0
    """1/rad^2."""

    bearing_shape: float = 0.2
    """1/m."""


@dataclass(frozen=True, slots=True, eq=False)
class ZoneTable:
    """Zones of one kind as arrays over K zones, severity already folded in. Frame ENU."""

    centres: FloatArray
    """(K, 2) metres."""

    covariances: FloatArray
    """(K, 2, 2) square metres."""

    margins: FloatArray
    """(K,) metres for sensing, factor on the spread for communication."""

    quantiles: FloatArray
    """(K,) factor on sqrt(n'Sn), severity's square root included."""

    severities: FloatArray
    """(K,) multiplier of the squared hinge."""

    known: BoolArray
    """(M, K): the zone constrains the robot."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What to solve: M planned robots, N tracked targets, H steps. All arrays read-only.

    Frame ENU; metres, seconds, metres per second (squared), covariances in square metres.
    """

    robot_ids: tuple[int, ...]
    """(M) the connected robots, in team order."""

    step_s: float
    horizon: int
    dynamics: Dynamics
    positions: FloatArray
    """(M, 2)."""

    velocities: FloatArray
    """(M, 2); the state of a double integrator, ignored by a single one."""

    control_lower: FloatArray
    control_upper: FloatArray
    """(M, 2) box of u: velocity (single) or acceleration (double)."""

    speed_limit: FloatArray
    """(M,) per-axis bound on velocity; for a single integrator at least that of the box."""

    field_lower: FloatArray
    field_upper: FloatArray
    """(2,) the field; hard for the first step, a squared hinge (`field_weight`) after it."""

    sees: BoolArray
    """(M, N) A_ij without the robots in sensing failure."""

    target_means: FloatArray
    """(H, N, 2) predicted target positions at steps 1..H."""

    target_priors: FloatArray
    """(N, 2, 2) predicted position covariance P- at step 1."""

    target_growth: FloatArray
    """(H, N, 2, 2) added to the posterior of step k-1 to give P- of step k (row 0 unused)."""

    sensor: SensorModel
    sensing: ZoneTable
    communication: ZoneTable
    weights: Weights
    separation_weight: float
    min_dist_m: float
    obstacles: FloatArray
    """(K, 2) last known positions of team mates that are not planned here (soft discs)."""

    previous: FloatArray | None
    """(M, H, 2) controls of the last plan, already shifted: the warm start; None for none."""

    replan: BoolArray
    """(M,) robots to be started afresh from probe starts."""

    field_weight: float = 1000.0
    """Price of a squared metre outside the field, and of a squared m/s above the speed limit."""


@dataclass(frozen=True, slots=True)
class Budget:
    """How long an engine may work: iterations in lockstep and replay, seconds live."""

    iterations: int = 200
    deadline_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """An engine's or the planner's answer to a problem."""

    robot_ids: tuple[int, ...]
    controls: FloatArray
    """(M, H, 2)."""

    positions: FloatArray
    """(M, H, 2) predicted positions at steps 1..H."""

    velocities: FloatArray
    """(M, H, 2) velocity over (single) or after (double) each step."""

    objective: float
    """Reduced smoothed objective at `controls`."""

    rung: Rung
    iterations: int
    solve_s: float
    engine: str
    late: bool = False
    """Whether wall time may have ended it: then the same problem may give another plan."""


class Engine(Protocol):
    """Minimises a problem. Raises `EngineFailed` when it has no feasible iterate."""

    @property
    def name(self) -> str:
        """Name people choose it by: fast, sqp or ipopt."""
        ...

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return the optimum (rung converged) or the best feasible iterate (feasible).

        Deterministic when the budget counts iterations only. Safe to call from a worker
        thread; one call at a time per engine.
        """
        ...


class EngineFailed(Exception):
    """Raised when an engine ends without any feasible iterate."""
