"""Everything the mission core needs to know before the first tick.

Made from a scenario (`server.scenarios`), read by the core and by whoever drives it.
Plain immutable values, frame ENU, metres, seconds, so that a recording can carry it.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from server.mission.checkpoint import Checkpoint
from solver.beliefs import FilterSettings
from solver.directives import Directives, Pairing, Weights
from solver.observations import TargetPrior
from solver.problem import Dynamics, SensorModel
from solver.zones import Point, ZoneKind


class Compat(StrEnum):
    """Whose semantics a mission follows where ours and the paper authors' program differ."""

    NONE = "none"
    AUTHORS = "authors"
    """Their measurement noise, jamming law, recovery rule, static prediction and priors, so
    that figures can be compared; and their trace accounting beside ours."""


class GateMode(StrEnum):
    """What becomes of a verified proposal whose predicted effect is worse."""

    OFF = "off"
    """Adopted: nothing is predicted (the paper)."""

    SHADOW = "shadow"
    """Adopted; the prediction is only logged."""

    AUTO = "auto"
    """Refused when it is clearly worse."""

    CONFIRM = "confirm"
    """A person approves; silence refuses."""


@dataclass(frozen=True, slots=True)
class RobotSetup:
    """One robot as the planner is told of it."""

    id: int
    position: Point
    """Where it is expected before its first report, metres."""

    altitude_m: float
    control_lower: Point
    control_upper: Point
    """Box of u per axis: m/s (single integrator) or m/s^2 (double integrator)."""

    speed_limit_m_s: float
    """Bound on each axis of the velocity."""

    capacity: int
    """Most targets it tracks at once, before anybody changes it."""


@dataclass(frozen=True, slots=True)
class TargetSetup:
    """One target as the planner is told of it."""

    id: int
    prior: TargetPrior | None
    """Prior knowledge of its place; None until somebody sees it."""


@dataclass(frozen=True, slots=True)
class PlannerSetup:
    """How the optimizer looks ahead (paper, eq. 3, over `horizon` steps)."""

    horizon: int
    plan_step_s: float
    min_dist_m: float
    separation_weight: float
    engine: str | None
    """fast, sqp or ipopt; None for the default of the machine."""

    sensing_failure_s: float = 0.0
    communication_failure_s: float = 0.0
    """How long a failure is taken to last, which prices being exposed to it; 0 for no price:
    then only the chance constraints keep robots out of zones (the paper)."""

    attack_period_s: float = 0.5
    """Seconds in which a density of 1/m^2 is taken to hit once."""


@dataclass(frozen=True, slots=True)
class LoopSetup:
    """Periods of the two models, and how long a comment waits for them."""

    task_period_s: float = 20.0
    action_period_s: float = 5.0
    comment_ttl_s: float = 120.0


@dataclass(frozen=True, slots=True)
class MeritSetup:
    """The fixed yardstick of the gate (`server.gate.merit`), and when worse is clearly worse."""

    sensing_price: float | None = None
    """One expected sensing hit, m^2 s; None for what such a failure costs this mission."""

    communication_price: float | None = None
    """The same for a communication hit."""

    effort_price: float = 1e-3
    """One m^2/s of effort (squared speed times time), m^2 s."""

    margin: float = 0.05
    """Share of the merit in force by which a proposal may be worse and still be adopted."""

    approval_s: float = 30.0
    """How long a person may think about a proposal; then it is refused."""


@dataclass(frozen=True, slots=True)
class HazardSetup:
    """How zones are inferred that nothing reveals (`solver.hazards`)."""

    recover_density: float
    """A robot recovers where every density is below this, 1/m^2."""

    expected_zones: float = 2.0
    """Of each kind in the field, before anything is known."""

    faults_per_hour: float = 2.0
    """Failures of one robot that no zone causes."""

    deviation_m: float = 0.7
    """Median standard deviation of a zone."""

    memory_s: float = 600.0
    """Time after which evidence counts for 1/e."""

    confidence: float = 0.5
    """What a zone needs to be known to the team."""


class ZoneDefaults(NamedTuple):
    """What a zone is taken to have when nobody said otherwise."""

    margin: float
    """Metres (sensing) or factor on the team's spread (communication)."""

    risk: float
    risk_single: float


@dataclass(frozen=True, slots=True)
class MissionSetup:
    """One mission before its first tick. Immutable."""

    name: str
    team: str
    """Names the team on the bus: falconer/{team}/..."""

    compat: Compat
    seed: int
    tick_s: float
    """Time step of lockstep (the scenario's dt)."""

    steps: int
    """Steps of a lockstep run, at `tick_s`."""

    dynamics: Dynamics
    robots: tuple[RobotSetup, ...]
    """In team order: row i of A."""

    targets: tuple[TargetSetup, ...]
    """In mission order: column j of A."""

    field_lower: Point
    field_upper: Point
    assignment: frozenset[Pairing]
    weights: Weights
    weight_lower: Weights
    weight_upper: Weights
    """What any proposal's weights must lie between."""

    severity_bounds: tuple[float, float]
    planner: PlannerSetup
    sensor: SensorModel
    filter: FilterSettings
    loops: LoopSetup
    merit: MeritSetup
    gate: GateMode
    """Unless whoever starts the mission says otherwise."""

    sensing_defaults: ZoneDefaults
    communication_defaults: ZoneDefaults
    """For zones drawn by people."""

    live_tick_s: float = 0.1
    lost_after_s: float = 3.0
    """A robot silent for longer, without being jammed, is lost."""

    setpoint_ttl_s: float = 0.5
    """Life time of a set-point on the receiver's clock."""

    hazards: HazardSetup | None = None
    """How zones are inferred; None where they are only revealed and drawn."""

    start: Checkpoint | None = None
    """Where a mission goes on that was broken off: it begins held. None for a new one."""

    @property
    def duration_s(self) -> float:
        """Mission time at which a lockstep run, and a live run of the scenario, ends."""
        return self.steps * self.tick_s

    @property
    def robot_ids(self) -> tuple[int, ...]:
        """Ids in team order."""
        return tuple(robot.id for robot in self.robots)

    @property
    def target_ids(self) -> tuple[int, ...]:
        """Ids in mission order."""
        return tuple(target.id for target in self.targets)

    def zone_defaults(self, kind: ZoneKind) -> ZoneDefaults:
        """Return what a drawn zone of this kind is taken to have."""
        if kind is ZoneKind.SENSING:
            return self.sensing_defaults
        return self.communication_defaults

    def initial_directives(self) -> Directives:
        """Return the directives in force at time 0, from the scenario."""
        return Directives(
            assignment=self.assignment,
            weights=self.weights,
            capacities=tuple((robot.id, robot.capacity) for robot in self.robots),
        )
