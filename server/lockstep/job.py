"""What a lockstep mission is told. The machinery that flies it is not needed to say so."""

from dataclasses import dataclass
from typing import Any, Final

from pydantic import TypeAdapter

from server.mission.setup import MissionSetup
from vehicles.world.setup import WorldSetup


@dataclass(frozen=True, slots=True)
class Latency:
    """How long an answer takes in lockstep, virtual seconds; None as measured."""

    task_s: float | None
    action_s: float | None


PAPER_LATENCY = Latency(task_s=1.36, action_s=0.89)
"""The paper's Table II."""


@dataclass(frozen=True, slots=True)
class ScriptedComment:
    """A sentence to be said at a mission time, in seconds."""

    time_s: float
    text: str


@dataclass(frozen=True, slots=True)
class LockstepJob:
    """One mission in virtual time, for a process of its own."""

    setup: MissionSetup
    world: WorldSetup
    llm: str
    comments: tuple[tuple[float, str], ...] = ()


_JOB: Final = TypeAdapter(LockstepJob)


def dump_job(job: LockstepJob) -> dict[str, Any]:
    """Return a job as JSON values."""
    values: dict[str, Any] = _JOB.dump_python(job, mode="json")
    return values


def load_job(values: object) -> LockstepJob:
    """Return the job that JSON values describe. Raises pydantic.ValidationError."""
    return _JOB.validate_python(values)
