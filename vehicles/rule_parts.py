"""What holds for one robot through a whole mission, as parts of messages (docs/messages.md)."""

from typing import Annotated

from pydantic import Field

from solver.beliefs import MotionModel, NearField
from solver.problem import Dynamics
from vehicles.fields import Amount, Duration, Position, Risk, Velocity, Wire


class SensorPart(Wire):
    """The measurement noise over distance."""

    range_peak: Annotated[float, Field(gt=0.0, le=1e9)]
    range_shape: Annotated[float, Field(ge=0.0, le=1e3)]
    bearing_peak: Annotated[float, Field(gt=0.0, le=1e9)]
    bearing_shape: Annotated[float, Field(ge=0.0, le=1e3)]


class FilterPart(Wire):
    """What the filter on board takes for granted."""

    model: MotionModel
    process_noise: Amount
    prior_variance: Annotated[float, Field(gt=0.0, le=1e9)]
    gate_probability: Annotated[float, Field(gt=0.0, lt=1.0)] | None
    drop_after_s: Duration
    speed_variance: Annotated[float, Field(gt=0.0, le=1e9)]
    near_field: NearField = NearField.MOMENTS


class InferencePart(Wire):
    """How a robot infers what cuts it off."""

    period_s: Annotated[float, Field(gt=0.0, le=1e6)]
    step_s: Annotated[float, Field(gt=0.0, le=60.0)]
    recover_density: Annotated[float, Field(gt=0.0, le=1e6)]
    zones_per_m2: Annotated[float, Field(gt=0.0, le=1e6)]
    faults_per_s: Annotated[float, Field(gt=0.0, le=1e3)]
    deviation_m: Annotated[float, Field(gt=0.0, le=1e6)]
    memory_s: Annotated[float, Field(gt=0.0, le=1e9)]
    confidence: Annotated[float, Field(ge=0.0, le=1.0)]
    risk: Risk
    risk_single: Risk


class RulesPart(Wire):
    """What holds for one robot through a whole mission."""

    step_s: Annotated[float, Field(gt=0.0, le=60.0)]
    horizon: Annotated[int, Field(ge=1, le=100)]
    dynamics: Dynamics
    control_lower: Velocity
    control_upper: Velocity
    speed_limit_m_s: Annotated[float, Field(ge=0.0, le=1e4)]
    field_lower: Position
    field_upper: Position
    min_dist_m: Annotated[float, Field(ge=0.0, le=1e6)]
    separation_weight: Amount
    sensor: SensorPart
    filter: FilterPart
    inference: InferencePart | None = None
