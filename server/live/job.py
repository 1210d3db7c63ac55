"""What a planner process is told before it starts: one JSON object over its channel."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from server.bus import LOOPBACK
from server.live.figures import KeptFigures
from server.mission.setup import MissionSetup
from vehicles.problems import problems_of
from vehicles.world.setup import WorldSetup
from vehicles.zenoh_settings import ZenohSettings


@dataclass(frozen=True, slots=True)
class PlannerJob:
    """One mission to fly. Keys of models come from the process's own settings, never from here."""

    setup: MissionSetup
    llm: str
    """mock, local, exact, none, or the address of an OpenAI-compatible API."""

    bus: ZenohSettings = LOOPBACK
    comments: tuple[tuple[float, str], ...] = ()
    """(mission time, text) said by themselves."""

    comments_said: int = 0
    """How many of those were said before the mission was broken off; they are no longer listed."""

    figures: KeptFigures | None = None
    """What was counted before it was broken off."""

    record: Path | None = None
    """File to record the mission into; the next free name where it exists."""

    world: WorldSetup | None = None
    """The simulated world, for the recording; None where the vehicles are real."""


class JobError(ValueError):
    """Raised when an object is not a job; the message names the fields."""


_JOB: Final = TypeAdapter(PlannerJob)


def dump_job(job: PlannerJob) -> dict[str, Any]:
    """Return a job as JSON values."""
    values: dict[str, Any] = _JOB.dump_python(job, mode="json")
    return values


def load_job(values: object) -> PlannerJob:
    """Return the job that JSON values describe. Raises JobError."""
    try:
        return _JOB.validate_python(values)
    except ValidationError as error:
        raise JobError(problems_of(error, "job")) from None
