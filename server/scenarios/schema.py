"""A scenario: the team, the targets, the zones, and how the mission shall be flown.

One file describes both sides: the world as it really is (`Scenario.world_setup`) and what
the planner is told of it before the first tick (`Scenario.mission_setup`).
"""

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from server.mission.setup import (
    Compat,
    GateMode,
    HazardSetup,
    LoopSetup,
    MeritSetup,
    MissionSetup,
    PlannerSetup,
    RobotSetup,
    TargetSetup,
    ZoneDefaults,
)
from server.scenarios import consistency, worlds
from server.scenarios.errors import InconsistentError
from server.scenarios.parts import (
    AttackPart,
    FieldPart,
    FilterPart,
    Id,
    InferencePart,
    LinksPart,
    LoopsPart,
    MeritPart,
    Part,
    PlannerPart,
    RobotPart,
    Seconds,
    SensorPart,
    TargetPart,
    WeightBoundsPart,
    WeightsPart,
    ZoneDefaultsByKind,
    ZoneDefaultsPart,
    ZonePart,
)
from solver.beliefs import FilterSettings
from solver.directives import Pairing, Weights
from solver.observations import TargetPrior
from solver.problem import Dynamics, SensorModel
from vehicles.world.setup import Discovery, WorldSetup

MAX_ROBOTS = 1000
MAX_TARGETS = 2000
MAX_ZONES = 256

WEIGHT_FACTOR = 10.0
"""Weights may be changed by this factor either way unless the scenario says otherwise."""

SEVERITY_BOUNDS = (1.0, 5.0)

DEFAULT_WEIGHTS = WeightsPart(tracking=10.0, control=0.05, sensing=50.0, communication=50.0)
"""As good as their own on all of the paper authors' scenarios (docs/decisions)."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]


class Scenario(Part):
    """One mission and its world."""

    name: Name
    description: Annotated[str, Field(max_length=2000)] = ""
    team: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")] = Field(
        default="falcons", description="Names the team on the bus."
    )
    compat: Compat = Field(
        default=Compat.NONE,
        description="`authors`: noise, jamming and recovery as in the paper authors' program, "
        "and their trace accounting beside ours.",
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)] = Field(
        default=0, description="One seed, one world."
    )
    tick_s: Seconds = Field(default=0.1, description="Time step of lockstep.")
    steps: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = Field(
        default=600, description="Length of a run, in steps of `tick_s`."
    )
    dynamics: Dynamics = Field(
        default=Dynamics.SINGLE_INTEGRATOR, description="How a control moves a robot."
    )
    field: FieldPart
    robots: tuple[RobotPart, ...] = Field(min_length=1, max_length=MAX_ROBOTS)
    targets: tuple[TargetPart, ...] = Field(min_length=1, max_length=MAX_TARGETS)
    zones: tuple[ZonePart, ...] = Field(default=(), max_length=MAX_ZONES)
    zone_defaults: ZoneDefaultsByKind = ZoneDefaultsByKind()
    assignment: dict[Annotated[int, Field(ge=0, le=999_999)], tuple[Id, ...]] = Field(
        description="At the start: robot id to the ids of its targets."
    )
    weights: WeightsPart = DEFAULT_WEIGHTS
    weight_bounds: WeightBoundsPart = WeightBoundsPart()
    planner: PlannerPart = PlannerPart()
    sensor: SensorPart = SensorPart()
    filter: FilterPart = FilterPart()
    attacks: AttackPart = AttackPart()
    discovery: Discovery = Field(
        default=Discovery.ORACLE,
        description="`oracle`: the first hit reveals a zone as it is (the paper). `inferred`: "
        "nothing is revealed, zones are learned from failures and their absence.",
    )
    inference: InferencePart = InferencePart()
    loops: LoopsPart = LoopsPart()
    links: LinksPart = LinksPart()
    merit: MeritPart = MeritPart()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if problems := consistency.problems(self):
            raise InconsistentError(problems)
        return self

    def varied(self, *, seed: int | None = None, steps: int | None = None) -> "Scenario":
        """Return the same scenario with another seed or length.

        Raises:
            pydantic.ValidationError: A value is out of its range.
        """
        asked = {"seed": seed, "steps": steps}
        changes = {key: value for key, value in asked.items() if value is not None}
        if not changes:
            return self
        return Scenario.model_validate({**self.model_dump(), **changes})

    def weight_range(self) -> tuple[Weights, Weights]:
        """Return the lowest and the highest weights anybody may ask for."""
        weights = self.weights.weights()
        ranges = [
            getattr(self.weight_bounds, name) or (value / WEIGHT_FACTOR, value * WEIGHT_FACTOR)
            for name, value in weights._asdict().items()
        ]
        lower, upper = zip(*ranges, strict=True)
        return Weights(*lower), Weights(*upper)

    def world_setup(self) -> WorldSetup:
        """Return the world as it really is at time 0."""
        return worlds.world_setup(self)

    def mission_setup(self, engine: str | None = None) -> MissionSetup:
        """Return what the planner is told before the first tick.

        Args:
            engine: Name of the optimizer's engine, before the scenario's own.
        """
        lower, upper = self.weight_range()
        authors = self.compat is Compat.AUTHORS
        return MissionSetup(
            name=self.name,
            team=self.team,
            compat=self.compat,
            seed=self.seed,
            tick_s=self.tick_s,
            steps=self.steps,
            dynamics=self.dynamics,
            robots=tuple(map(_robot_setup, self.robots)),
            targets=tuple(map(_target_setup, self.targets)),
            field_lower=self.field.lower,
            field_upper=self.field.upper,
            assignment=frozenset(
                Pairing(robot, target) for robot, row in self.assignment.items() for target in row
            ),
            weights=self.weights.weights(),
            weight_lower=lower,
            weight_upper=upper,
            severity_bounds=SEVERITY_BOUNDS,
            planner=self._planner_setup(engine),
            sensor=self.sensor_model(),
            filter=FilterSettings(**self.filter.model_dump()),
            loops=LoopSetup(**self.loops.model_dump()),
            merit=MeritSetup(**self.merit.model_dump()),
            gate=GateMode.OFF if authors else GateMode.AUTO,
            sensing_defaults=_zone_defaults(self.zone_defaults.sensing),
            communication_defaults=_zone_defaults(self.zone_defaults.communication),
            lost_after_s=self.links.lost_after_s,
            setpoint_ttl_s=self.links.setpoint_ttl_s,
            hazards=self._hazard_setup(),
        )

    def _hazard_setup(self) -> HazardSetup | None:
        if self.discovery is Discovery.ORACLE:
            return None
        density = self.attacks.recover_density
        return HazardSetup(recover_density=density, **self.inference.model_dump())

    def sensor_model(self) -> SensorModel:
        """Return the noise of the robots' sensors."""
        return SensorModel(**self.sensor.model_dump(exclude={"detection_range_m"}))

    def _planner_setup(self, engine: str | None) -> PlannerSetup:
        own = self.planner
        return PlannerSetup(
            horizon=own.horizon,
            plan_step_s=own.plan_step_s,
            min_dist_m=own.min_dist_m,
            separation_weight=own.separation_weight,
            engine=engine or own.engine,
            sensing_failure_s=own.sensing_failure_s,
            communication_failure_s=own.communication_failure_s,
            attack_period_s=self.attacks.period_s,
        )


def schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario file, for editors and for people."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Scenario.model_json_schema(),
    }


def _robot_setup(robot: RobotPart) -> RobotSetup:
    box = max(map(abs, (*robot.control_lower, *robot.control_upper)))
    return RobotSetup(
        id=robot.id,
        position=robot.position,
        altitude_m=robot.altitude_m,
        control_lower=robot.control_lower,
        control_upper=robot.control_upper,
        speed_limit_m_s=box if robot.speed_limit_m_s is None else robot.speed_limit_m_s,
        capacity=robot.capacity,
    )


def _target_setup(target: TargetPart) -> TargetSetup:
    if target.prior is None:
        return TargetSetup(target.id, prior=None)
    prior = TargetPrior(target.id, target.prior.mean, target.prior.covariance)
    return TargetSetup(target.id, prior)


def _zone_defaults(part: ZoneDefaultsPart) -> ZoneDefaults:
    return ZoneDefaults(part.margin, part.risk, part.risk_single)
