"""The snapshot: everything the team knows at a tick. Immutable; everybody reads it."""

import math
from dataclasses import dataclass
from enum import StrEnum

from solver.arrays import BoolArray, FloatArray
from solver.directives import CommentVerdict, Directives
from solver.observations import Attack, Comment, HoldState, Link
from solver.problem import Rung
from solver.zones import Matrix2, Zone


class TrackStatus(StrEnum):
    """How well a target is known."""

    UNKNOWN = "unknown"
    """Never seen and no prior: not in the optimizer's problem."""

    TRACKED = "tracked"
    COASTING = "coasting"
    """Predicted only: nobody has seen it lately."""

    DROPPED = "dropped"


class Guidance(StrEnum):
    """The degradation ladder of the guidance in force."""

    MODEL = "model"
    LAST_VALID = "last_valid"
    SOLVER = "solver"
    HOLD = "hold"


@dataclass(frozen=True, slots=True, eq=False)
class RobotTable:
    """All M robots of the team, lost ones included, in team order. Frame ENU."""

    ids: tuple[int, ...]
    """(M)."""

    positions: FloatArray
    """(M, 2) metres."""

    velocities: FloatArray
    """(M, 2) metres per second."""

    altitudes: FloatArray
    """(M,) metres."""

    sensing_failed: BoolArray
    """(M,) whether it is in sensing failure."""

    links: tuple[Link, ...]
    """(M)."""

    state_age_s: FloatArray
    """(M,) seconds since the last own report."""

    setpoint_velocities: FloatArray
    """(M, 2) last command, metres per second; zero for robots the planner does not fly."""

    waypoints: FloatArray
    """(M, 2) last commanded way-points, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackTable:
    """All N targets, in mission order. Frame ENU."""

    ids: tuple[int, ...]
    """(N)."""

    positions: FloatArray
    """(N, 2) metres."""

    velocities: FloatArray
    """(N, 2) metres per second; zero under the random-walk model."""

    covariances: FloatArray
    """(N, 2, 2) position covariance after the update, square metres."""

    unseen_s: FloatArray
    """(N,) seconds since the last accepted sighting (or prior, or start)."""

    status: tuple[TrackStatus, ...]
    """(N)."""


@dataclass(frozen=True, slots=True)
class SolveSummary:
    """The last solve, for people: which rung, how long, what it cost."""

    rung: Rung
    objective: float
    iterations: int
    solve_s: float
    """Thread time of the solve alone. Not part of what replay compares."""


@dataclass(frozen=True, slots=True)
class CommentReceipt:
    """Where a comment stands. It closes when both loops have answered, or it expires."""

    comment: Comment
    task: CommentVerdict | None = None
    task_reason: str = ""
    action: CommentVerdict | None = None
    action_reason: str = ""
    expired: bool = False
    task_feedback: str = ""
    """The task model's words to people, said with its answer."""

    task_proposal: str = ""
    """Id of the proposal that answered it: the decision on it tells what was changed."""

    action_feedback: str = ""
    action_proposal: str = ""

    @property
    def status(self) -> str:
        """Return received, considered, applied, partly_applied, noted, declined or expired."""
        verdicts = [v for v in (self.task, self.action) if v is not None]
        for verdict in (CommentVerdict.APPLIED, CommentVerdict.PARTLY):
            if verdict in verdicts:
                return verdict.value
        if len(verdicts) == 2:
            declined = CommentVerdict.DECLINED in verdicts
            return (CommentVerdict.DECLINED if declined else CommentVerdict.NOTED).value
        if self.expired:
            return "expired"
        return "considered" if verdicts else "received"


@dataclass(frozen=True, slots=True)
class InferredZone:
    """What is known of a zone that was inferred from failures, beside the zone it is taken for."""

    zone_id: str
    confidence: float
    """Probability that there is such a zone."""

    centre_covariance: Matrix2
    """How uncertain the centre is, m^2."""

    extent: Matrix2
    """Covariance of the density of attacks itself, m^2; the zone's is this and the doubt."""

    strength: float
    """Factor on the density that the law of attacks would have."""

    strength_deviation: float
    since_s: float
    """Mission time at which it was first suspected."""

    @property
    def centre_deviation_m(self) -> float:
        """How far the centre may be off: root mean square, metres."""
        return math.sqrt(self.centre_covariance[0][0] + self.centre_covariance[1][1])


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One tick of the mission."""

    mission: str
    tick: int
    time_s: float
    robots: RobotTable
    tracks: TrackTable
    zones: tuple[Zone, ...]
    """Every zone anybody of the team knows."""

    known: BoolArray
    """(M, Z): robot i knows zone z."""

    directives: Directives
    hold: HoldState
    trace: float
    """Sum over tracked targets of tr P (position), square metres."""

    solve: SolveSummary | None
    attacks: tuple[Attack, ...]
    """Those that became known since the last snapshot."""

    receipts: tuple[CommentReceipt, ...]
    """Comments that still stand, oldest first."""

    guidance: Guidance
    guidance_age_s: float
    closed: tuple[CommentReceipt, ...] = ()
    """Comments that lately expired or were withdrawn, oldest first; for people only."""

    inferred: tuple[InferredZone, ...] = ()
    """Of the zones, those that were inferred from failures."""
