"""Flying a mission on that a crash of the server, or of its planner, broke off."""

from dataclasses import replace
from enum import StrEnum
from http import HTTPStatus

import structlog

from server.api import revival
from server.api.errors import ServiceError
from server.api.processes import Processes, end_processes
from server.api.record import MissionRecord
from server.encoding import EventKind, MissionState, Severity
from server.live.job import JobError

log = structlog.get_logger(__name__)

AUTHOR = "server"


class AfterCrash(StrEnum):
    """What becomes of a mission that was live when the server died."""

    HOLD = "hold"
    """It comes up held; a person resumes it."""

    RESUME_SIMULATED = "resume_simulated"
    """The same, but where the world is simulated beside the server it goes on by itself."""


class Interrupted(StrEnum):
    """What died, in the words of the event that tells of it."""

    SERVER = "server"
    PLANNER = "planner"


async def launch(record: MissionRecord, processes: Processes) -> None:
    """Start a mission; one that failed in flight goes on where it was broken off, held.

    The caller holds `record.change`. Raises ServiceError 503.
    """
    remains = record.remains
    if record.state is not MissionState.FAILED or remains is None or remains.start is None:
        await processes.launch(record)
        return
    record.change_state(MissionState.HELD, "the planner was interrupted")
    if not await bring_up(record, processes, Interrupted.PLANNER):
        raise ServiceError("start_failed", record.reason, HTTPStatus.SERVICE_UNAVAILABLE)


async def bring_up(record: MissionRecord, processes: Processes, interrupted: Interrupted) -> bool:
    """Start a mission's processes where it was broken off, held; return whether it flies.

    One that cannot be held does not fly at all, and is failed. The caller holds `record.change`,
    and the record is live.
    """
    remains = record.remains
    if remains is None or not record.live:
        return False
    # A simulated world of our own stands still when it dies with us, and lives on otherwise.
    stood_still = remains.definition.world is not None and not record.tasks
    try:
        planner = revival.planner_job(remains, 0.0 if stood_still else remains.away_s())
        world = revival.world_job(remains)
        record.definition = replace(record.definition, planner=planner, world=world)
        await processes.launch(record)
        if record.state is not MissionState.ENDED:
            await processes.ask(record, "hold", {"author": AUTHOR})
    except (ServiceError, JobError) as error:
        log.error("mission not brought up", mission=record.id, why=str(error))
        await _give_up(record, str(error))
        return False
    except Exception as error:  # whatever the journal held, nobody waits for a mission without end
        log.exception("mission not brought up", mission=record.id)
        await _give_up(record, f"{type(error).__name__}: {error}")
        return False
    if record.state is MissionState.ENDED:  # its time was over at once
        await end_processes(record)
        return False
    words = f"The {interrupted} was interrupted. The mission goes on, and all robots hold."
    record.report(EventKind.HOLD, Severity.WARNING, words, interrupted)
    return True


async def _give_up(record: MissionRecord, why: str) -> None:
    """Fail a mission; nothing of it flies on, unheld or beside its successor."""
    await end_processes(record)
    record.change_state(MissionState.FAILED, f"it could not be brought up: {why}")
