"""The parts of a scenario file. Every number states its unit and its range.

Frame ENU, metres, seconds, radians. The ranges are wide: they keep out what no solver can
digest and what would make one request use up the machine.
"""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from solver.beliefs import MotionModel, NearField
from solver.directives import Weights
from solver.zones import ZoneKind
from vehicles.world.motion import Ending

MIN_VARIANCE_M2 = 1e-6
MAX_VARIANCE_M2 = 1e4
"""What eigenvalues of covariances must lie between: the optimizer clamps priors to the same."""

Coordinate = Annotated[float, Field(strict=True, ge=-1e4, le=1e4)]
Point = tuple[Coordinate, Coordinate]
Speed = Annotated[float, Field(strict=True, ge=-100.0, le=100.0)]
Velocity = tuple[Speed, Speed]
Id = Annotated[int, Field(strict=True, ge=0, le=999_999)]
Seconds = Annotated[float, Field(strict=True, ge=0.01, le=3600.0)]
Positive = Annotated[float, Field(strict=True, gt=0.0, le=1e6)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, le=1e6)]
WeightValue = Annotated[float, Field(strict=True, ge=1e-6, le=1e6)]
Risk = Annotated[float, Field(strict=True, gt=0.0, le=0.5)]
Margin = Annotated[float, Field(strict=True, ge=0.0, le=100.0)]


def _is_spd(value: tuple[Point, Point]) -> tuple[Point, Point]:
    (a, b), (c, d) = value
    allowed = f"allowed: symmetric, eigenvalues {MIN_VARIANCE_M2:g} to {MAX_VARIANCE_M2:g} m^2"
    if abs(b - c) > 1e-9 * max(abs(b), abs(c)):
        raise ValueError(f"must be symmetric, but {b:g} stands against {c:g} ({allowed})")
    middle, radius = (a + d) / 2.0, (((a - d) / 2.0) ** 2 + b * b) ** 0.5
    low, high = middle - radius, middle + radius
    if not (low >= MIN_VARIANCE_M2 and high <= MAX_VARIANCE_M2):
        raise ValueError(
            f"must be positive definite, but its eigenvalues are {low:g} and {high:g} ({allowed})"
        )
    return value


Covariance = Annotated[tuple[Point, Point], AfterValidator(_is_spd)]


class Part(BaseModel):
    """Immutable; unknown keys and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class FieldPart(Part):
    """The rectangle the robots must stay in."""

    lower: Point = Field(description="South-west corner, m.")
    upper: Point = Field(description="North-east corner, m.")


class RobotPart(Part):
    """One robot: where it starts and what it can do."""

    id: Id
    position: Point = Field(description="Start, m.")
    altitude_m: Annotated[float, Field(strict=True, ge=0.0, le=1000.0)] = Field(
        description="Height it flies at, m. Different heights keep robots apart vertically."
    )
    capacity: Annotated[int, Field(strict=True, ge=0, le=1000)] = Field(
        description="Most targets it tracks at once."
    )
    control_lower: Velocity = Field(
        default=(-0.5, -0.5),
        description="Least control per axis: m/s, or m/s^2 for a double integrator.",
    )
    control_upper: Velocity = Field(default=(0.5, 0.5), description="Greatest control per axis.")
    speed_limit_m_s: Positive | None = Field(
        default=None,
        description="Bound on each axis of the velocity, m/s. Needed for a double integrator; "
        "otherwise the control box itself by default.",
    )


class LinearMotion(Part):
    """Constant velocity for ever; the field does not hold it back."""

    kind: Literal["linear"] = "linear"
    velocity: Velocity = Field(default=(0.0, 0.0), description="m/s.")


class RandomWalkMotion(Part):
    """A mean velocity plus Brownian motion."""

    kind: Literal["random_walk"]
    velocity: Velocity = Field(default=(0.0, 0.0), description="Mean, m/s.")
    deviation: NotNegative = Field(description="Of each axis after one second, m/sqrt(s).")


class WaypointMotion(Part):
    """From the start through these points at constant speed."""

    kind: Literal["waypoints"]
    points: tuple[Point, ...] = Field(min_length=1, max_length=10_000, description="m.")
    speed_m_s: Positive
    ending: Ending = Field(default=Ending.LOOP, description="Start again, or stop.")


class CircleMotion(Part):
    """Around a centre, from the start position, at a constant rate."""

    kind: Literal["circle"]
    centre: Point = Field(description="m.")
    rate_rad_s: Annotated[float, Field(strict=True, ge=-10.0, le=10.0)] = Field(
        description="rad/s, positive is counter-clockwise."
    )


class ReplayMotion(Part):
    """A recorded track: linear between samples, still before the first and after the last."""

    kind: Literal["replay"]
    times_s: tuple[NotNegative, ...] = Field(min_length=1, max_length=100_000)
    positions: tuple[Point, ...] = Field(min_length=1, max_length=100_000, description="m.")


MotionPart = Annotated[
    LinearMotion | RandomWalkMotion | WaypointMotion | CircleMotion | ReplayMotion,
    Field(discriminator="kind"),
]


class PriorPart(Part):
    """What the team believes of a target's place before anybody has seen it."""

    mean: Point = Field(description="m.")
    covariance: Covariance = Field(description="m^2.")


class TargetPart(Part):
    """One target: where it really starts, how it moves, what is believed of it."""

    id: Id
    position: Point = Field(description="Start, m.")
    motion: MotionPart = LinearMotion()
    prior: PriorPart | None = Field(
        default=None, description="Left out: the target is unknown until a robot sees it."
    )


class ZonePart(Part):
    """One danger zone as it really is. The team learns of it when it is hit."""

    id: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
    kind: ZoneKind
    mean: Point = Field(description="Centre, m.")
    covariance: Covariance = Field(description="Extent, m^2.")
    margin: Margin | None = Field(
        default=None,
        description="Sensing: m added to the keep-out radius. Communication: factor on the "
        "spread of the team. Left out: `zone_defaults`.",
    )
    risk: Risk | None = Field(
        default=None,
        description="Tolerated chance of being hit: eps1 of the paper (sensing), 1 - eps2 "
        "(communication). Left out: `zone_defaults`.",
    )
    risk_single: Risk | None = Field(
        default=None,
        description="The same for a robot that is cut off and plans alone (eps2_single). "
        "Left out: `zone_defaults`.",
    )
    velocity: Velocity = Field(default=(0.0, 0.0), description="Of its centre, m/s.")
    growth_m2_s: NotNegative = Field(default=0.0, description="Of both variances, m^2/s.")


class ZoneDefaultsPart(Part):
    """What a zone has where it does not say so, and what a drawn zone gets."""

    margin: Margin
    risk: Risk
    risk_single: Risk


class ZoneDefaultsByKind(Part):
    """The defaults of both kinds of zone."""

    sensing: ZoneDefaultsPart = ZoneDefaultsPart(margin=0.1, risk=0.1, risk_single=0.1)
    communication: ZoneDefaultsPart = ZoneDefaultsPart(margin=0.2, risk=0.05, risk_single=0.05)


class AttackPart(Part):
    """How often zones hit, and how far a robot must get away to recover."""

    period_s: Seconds = Field(
        default=0.5,
        description="In a step of dt a robot is hit with probability density * dt / period.",
    )
    recover_density: Positive = Field(
        default=0.2, description="A robot recovers where every density is below this, 1/m^2."
    )


class InferencePart(Part):
    """How zones are inferred that nothing reveals."""

    expected_zones: Positive = Field(
        default=2.0, description="Of each kind in the field, before anything is known."
    )
    faults_per_hour: Positive = Field(
        default=2.0, description="Failures of one robot that no zone causes."
    )
    deviation_m: Annotated[float, Field(strict=True, ge=0.05, le=100.0)] = Field(
        default=0.7, description="Median standard deviation of a zone, m."
    )
    memory_s: Annotated[float, Field(strict=True, ge=10.0, le=1e6)] = Field(
        default=600.0, description="Evidence that old counts for 1/e: zones may move."
    )
    confidence: Annotated[float, Field(strict=True, ge=0.05, le=0.99)] = Field(
        default=0.5, description="Probability from which the team goes by an inferred zone."
    )


class WeightsPart(Part):
    """Weights of the objective, in the paper's order w1..w4."""

    tracking: WeightValue
    control: WeightValue
    sensing: WeightValue
    communication: WeightValue

    def weights(self) -> Weights:
        """Return them in the solver's own type."""
        return Weights(self.tracking, self.control, self.sensing, self.communication)


WeightRange = tuple[WeightValue, WeightValue]


class WeightBoundsPart(Part):
    """Lowest and highest weight anybody may ask for. Left out: 0.1 to 10 times the weight."""

    tracking: WeightRange | None = None
    control: WeightRange | None = None
    sensing: WeightRange | None = None
    communication: WeightRange | None = None


class PlannerPart(Part):
    """How the optimizer looks ahead."""

    horizon: Annotated[int, Field(strict=True, ge=1, le=50)] = Field(
        default=3, description="Steps (1 is the paper's)."
    )
    plan_step_s: Seconds = Field(default=0.5, description="Length of one such step.")
    min_dist_m: NotNegative = Field(default=0.5, description="Least distance between robots.")
    separation_weight: NotNegative = 1000.0
    sensing_failure_s: Annotated[float, Field(ge=0.0, le=60.0)] = Field(
        default=1.2,
        description="How long a sensing failure is taken to last, which prices being exposed to "
        "one; 0: only the chance constraints count (the paper).",
    )
    communication_failure_s: Annotated[float, Field(ge=0.0, le=60.0)] = Field(
        default=1.9, description="The same for communication."
    )
    engine: Literal["fast", "sqp", "ipopt"] | None = Field(
        default=None, description="Left out: the best one of this machine."
    )


class SensorPart(Part):
    """Range and bearing noise: variance 1 / (peak exp(-shape distance))."""

    range_peak: Positive = 15.0
    range_shape: NotNegative = Field(default=0.2, description="1/m.")
    bearing_peak: Positive = 15.0
    bearing_shape: NotNegative = Field(default=0.2, description="1/m.")
    detection_range_m: Positive | None = Field(
        default=None, description="Targets farther away are not seen. Left out: no limit."
    )


class FilterPart(Part):
    """The team's filter over the targets."""

    model: MotionModel = MotionModel.CONSTANT_VELOCITY
    process_noise: Positive = Field(
        default=0.02,
        description="m^2/s (random walk) or m^2/s^3 (constant velocity: density of the white "
        "acceleration).",
    )
    prior_variance: Positive = Field(
        default=100.0, description="Shown for a target nobody has seen, m^2 per axis."
    )
    gate_probability: Annotated[float, Field(strict=True, gt=0.5, lt=1.0)] | None = Field(
        default=0.9999, description="Share of true measurements let in; null lets in all."
    )
    drop_after_s: Positive = Field(default=30.0, description="A track unseen so long is dropped.")
    speed_variance: Positive = Field(default=0.25, description="Of a new track, m^2/s^2.")
    near_field: NearField = Field(
        default=NearField.MOMENTS,
        description="What is taken of the posterior close to a target: its moments, or its mode "
        "(for worlds whose noise is far below the sensor model's).",
    )


class LoopsPart(Part):
    """The two models' periods, and how long a comment waits for both answers."""

    task_period_s: Seconds = 20.0
    action_period_s: Seconds = 5.0
    comment_ttl_s: Seconds = 120.0


class LinksPart(Part):
    """How long silence is borne."""

    lost_after_s: Seconds = Field(default=3.0, description="A silent robot is lost after this.")
    setpoint_ttl_s: Seconds = Field(default=0.5, description="A vehicle holds after this.")


class MeritPart(Part):
    """The fixed yardstick that proposals are compared by; it does not depend on the weights."""

    sensing_price: NotNegative | None = Field(
        default=None,
        description="Of one expected hit, m^2 s; left out: what a failure costs this mission.",
    )
    communication_price: NotNegative | None = Field(
        default=None, description="The same for communication."
    )
    effort_price: NotNegative = Field(
        default=0.001, description="Of 1 m^2/s of squared speed times time, m^2 s."
    )
    margin: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.05,
        description="A proposal whose merit is worse by more than this share is clearly worse.",
    )
    approval_s: Seconds = Field(
        default=30.0, description="A person's time to approve; then a proposal is refused."
    )
