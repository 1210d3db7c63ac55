"""Bodies and answers of the routes by which people steer in person."""

from typing import Annotated, Any, Self

from pydantic import Field, StrictBool, model_validator

from server.api.models import Answer, Body, Number
from solver.zones import ZoneKind

MAX_PLACE_M = 1e6
LEAST_VARIANCE_M2 = 1e-4
GREATEST_VARIANCE_M2 = 1e6
LONGEST_PIN_S = 86_400.0

Id = Annotated[int, Field(strict=True, ge=0, le=2**31 - 1)]
IdKey = Annotated[str, Field(pattern=r"^(0|[1-9][0-9]{0,9})$")]
"""A robot's id as the key of an object, as JSON wants it."""

Place = Annotated[Number, Field(ge=-MAX_PLACE_M, le=MAX_PLACE_M)]
Margin = Annotated[Number, Field(ge=0.0, le=1e3)]
Risk = Annotated[Number, Field(gt=0.0, le=0.5)]
Entry = Annotated[Number, Field(ge=-GREATEST_VARIANCE_M2, le=GREATEST_VARIANCE_M2)]
"""No entry of a covariance is greater than its greatest eigenvalue."""

Matrix = tuple[tuple[Entry, Entry], tuple[Entry, Entry]]


class AssignmentRequest(Body):
    """A whole assignment."""

    assignment: dict[IdKey, list[Id]] = Field(
        description="Per robot id the ids of its targets.", examples=[{"21": [121, 122]}]
    )


class WeightsRequest(Body):
    """All four weights. Their bounds stand in every snapshot."""

    tracking: Number
    control: Number
    sensing: Number
    communication: Number

    def ordered(self) -> list[float]:
        """Return them in the paper's order, w1 to w4."""
        return [self.tracking, self.control, self.sensing, self.communication]


class CapacitiesRequest(Body):
    """Capacities of some robots, or of all."""

    capacities: dict[IdKey, Id] = Field(
        min_length=1, description="Per robot id the most targets.", examples=[{"21": 3}]
    )


class PinRequest(Body):
    """One pin."""

    robot: Id
    target: Id
    forbids: StrictBool = Field(default=False, description="True keeps the pair apart instead.")
    ttl_s: Annotated[Number, Field(gt=0.0, le=LONGEST_PIN_S)] | None = Field(
        None, description="It is lifted by itself after this; left out: never."
    )


class _Sized(Body):
    @model_validator(mode="after")
    def _covariance_is_one(self) -> Self:
        covariance: Matrix | None = getattr(self, "covariance", None)
        if covariance is None:
            return self
        (a, b), (c, d) = covariance
        mean, radius = 0.5 * (a + d), (0.25 * (a - d) ** 2 + b * b) ** 0.5
        if b != c or mean - radius < LEAST_VARIANCE_M2 or mean + radius > GREATEST_VARIANCE_M2:
            raise ValueError(
                "covariance must be symmetric, its eigenvalues between "
                f"{LEAST_VARIANCE_M2:g} and {GREATEST_VARIANCE_M2:g} m^2"
            )
        return self


class ZoneRequest(_Sized):
    """A zone to be drawn."""

    kind: ZoneKind
    mean: tuple[Place, Place] = Field(description="Centre, metres.")
    covariance: Matrix = Field(description="Extent, m^2.", examples=[[[0.5, 0.0], [0.0, 0.5]]])
    margin: Margin | None = Field(None, description="The scenario's default if left out.")
    risk: Risk | None = Field(None, description="The scenario's default if left out.")


class ZoneChangeRequest(_Sized):
    """What is to be different about a known zone."""

    severity: Number | None = Field(
        None, description="Multiplier within the scenario's bounds, [1, 5] by default."
    )
    mean: tuple[Place, Place] | None = None
    covariance: Matrix | None = None
    margin: Margin | None = None
    risk: Risk | None = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        if all(value is None for value in self.model_dump().values()):
            raise ValueError("give at least one of severity, mean, covariance, margin and risk")
        return self


class ApprovalRequest(Body):
    """A person's word."""

    approve: StrictBool


class DirectionAnswer(Answer):
    """What came of it, with the verdict and the predicted price."""

    decision: dict[str, Any] = Field(description="The decision card.")


class ZoneAnswer(Answer):
    """A zone as it is believed to be now."""

    zone: dict[str, Any]
    decision: dict[str, Any] | None = Field(description="The card of a change of severity.")
