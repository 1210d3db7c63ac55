"""What every message is made of: numbers within bounds, names, and the base of all parts.

Bounds are wide enough for any team and narrow enough that no accepted number overflows or
turns into infinity further on.
"""

from typing import Annotated, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

Length: TypeAlias = Annotated[float, Field(ge=-1e7, le=1e7)]
Speed: TypeAlias = Annotated[float, Field(ge=-1e4, le=1e4)]
Amount: TypeAlias = Annotated[float, Field(ge=0.0, le=1e12)]
Number: TypeAlias = Annotated[float, Field(ge=-1e12, le=1e12)]
Duration: TypeAlias = Annotated[float, Field(ge=0.0, le=1e10)]
Count: TypeAlias = Annotated[int, Field(ge=0, lt=2**53)]
Id: TypeAlias = Annotated[int, Field(ge=0, lt=2**31)]
Position: TypeAlias = tuple[Length, Length]
Velocity: TypeAlias = tuple[Speed, Speed]
Name: TypeAlias = Annotated[str, Field(min_length=1, max_length=64)]
Words: TypeAlias = Annotated[str, Field(max_length=200)]
Risk: TypeAlias = Annotated[float, Field(gt=0.0, le=0.5)]


class Wire(BaseModel):
    """A part of a message: frozen, finite, tolerant of fields added later."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)
