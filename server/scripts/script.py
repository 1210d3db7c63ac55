"""What a scripted mission is: whom to fly, what to do when, and what is expected of it.

A YAML file read under the same strict rules as scenarios. Times are mission seconds, and the
seconds for which the script itself keeps the mission paused: mission time stands still then, and
nobody would be left to resume it.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from server.mission.setup import GateMode
from server.scenarios.errors import ScenarioError
from server.scenarios.reading import read

Seconds = Annotated[float, Field(ge=0.0, le=86_400.0, allow_inf_nan=False)]


class ScriptError(Exception):
    """Raised when a script cannot be read; the message names the fields."""


class Part(BaseModel):
    """Unknown fields are refused, so that a typing error is noticed."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Mission(Part):
    """What `POST /missions` is asked for."""

    scenario: str
    llm: str = "mock"
    gate: GateMode | None = None
    seed: int | None = Field(None, ge=0)


class Say(Part):
    """Say something to the models."""

    at_s: Seconds
    say: str = Field(min_length=1, max_length=2000)
    expect: tuple[str, ...] = ()
    """Receipts that are good; none for any."""


class Do(Part):
    """Steer the mission."""

    at_s: Seconds
    do: Literal["hold", "resume", "pause"]


class Bound(Part):
    """What a figure of the result must lie between."""

    at_least: float = -math.inf
    at_most: float = math.inf

    @model_validator(mode="after")
    def _says_something(self) -> "Bound":
        if not self.at_least <= self.at_most or self.at_least == -math.inf == -self.at_most:
            raise ValueError("at_least, at_most or both, the first not above the second")
        return self


class Script(Part):
    """One scripted mission."""

    name: str = Field(min_length=1, max_length=100)
    mission: Mission
    until_s: Seconds
    """Time at which it is stopped and judged, and later by what an action was late."""

    actions: tuple[Say | Do, ...] = Field((), max_length=200)
    expect: dict[str, Bound] = Field(default_factory=dict)
    """Bounds by the names of the result's figures, with dots into its objects."""

    patience_s: float = Field(600.0, gt=0.0, le=86_400.0)
    """Wall-clock time after which it has failed, whatever the server does."""

    @model_validator(mode="after")
    def _in_time(self) -> "Script":
        late = [action.at_s for action in self.actions if action.at_s >= self.until_s]
        if late:
            raise ValueError(f"actions: {late[0]:g} s is not before until_s, {self.until_s:g} s")
        return self


def load_script(path: Path) -> Script:
    """Read a script. Raises ScriptError."""
    try:
        return Script.model_validate(read(path))
    except ScenarioError as error:
        raise ScriptError(str(error)) from None
    except ValidationError as error:
        problems = "; ".join(map(_words, error.errors(include_url=False, include_input=False)))
        raise ScriptError(f"{path}: {problems}") from None


def _words(problem: Any) -> str:
    where = ".".join(str(part) for part in problem["loc"]) or "script"
    return f"{where}: {problem['msg']}"
