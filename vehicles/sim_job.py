"""What a simulated world's process is told: one line of JSON."""

from dataclasses import dataclass, field
from typing import Final

from pydantic import TypeAdapter, ValidationError

from vehicles.problems import problems_of
from vehicles.settings import SimulationSettings, check_external
from vehicles.world.setup import WorldSetup
from vehicles.zenoh_settings import ZenohSettings


@dataclass(frozen=True, slots=True)
class SimulationJob:
    """One world to simulate and where.

    Raises:
        ValueError: An external robot is none of the world's.
    """

    world: WorldSetup
    team: str
    zenoh: ZenohSettings
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    engine: str | None = None
    """For plans on board; None for the default of the machine."""

    def __post_init__(self) -> None:
        check_external(self.world, self.simulation.external)


_JOB: Final = TypeAdapter(SimulationJob)


class JobError(ValueError):
    """Raised when a text is not a job; the message names the fields."""


def dump_job(job: SimulationJob) -> str:
    """Return a job as one line of JSON. It contains the bus's password, if there is one."""
    return _JOB.dump_json(job).decode()


def load_job(text: str | bytes) -> SimulationJob:
    """Return the job that a JSON text describes.

    Raises:
        JobError: It is not JSON, a field is missing or wrong, or makes no sense.
    """
    try:
        return _JOB.validate_json(text)
    except ValidationError as error:
        raise JobError(problems_of(error, "job")) from None
