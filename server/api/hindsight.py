"""Looking back at missions: their course, and pictures of any instant that is still kept.

A picture comes from memory, where the newest half hour of the live mission lies, else from the
mission's recording, which can be read while it is written.
"""

import asyncio
from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Any, Final

from server.api.chronicle import Chronicle
from server.api.errors import ServiceError
from server.api.record import MissionRecord
from server.course import SAMPLE_S, Course, course_of, sample_of
from server.encoding import MissionState
from server.recording.errors import RecordingError
from server.recording.reader import Recording, open_recording

Json = dict[str, Any]

PAGE: Final = 1000


class Hindsight:
    """Answers what was. Owns nothing but the recording that was opened last."""

    def __init__(self, record_of: Callable[[str], MissionRecord], chronicle: Chronicle) -> None:
        self._record_of = record_of
        self._chronicle = chronicle
        self._opened: Recording | None = None

    async def course(self, mission_id: str) -> Course:
        """Return how a mission went so far; it grows while the mission flies.

        What happened before this process began is read from the journal, a replay's from its
        recording, once. Raises ServiceError 404, 503.
        """
        record = self._record_of(mission_id)
        if record.course is None:
            async with record.reading:
                if record.course is None:
                    record.course = await self._read_course(record)
        return record.course

    async def picture(self, mission_id: str, at_s: float) -> Json:
        """Return the newest snapshot at or before a mission time.

        Raises ServiceError 404, 409 where nothing of that time is kept.
        """
        record = self._record_of(mission_id)
        found = record.past.at(at_s)
        if found is not None:
            return found
        if record.recording is not None:
            recorded = await self._recorded(record, at_s)
            if recorded is not None:
                return recorded | {"mission": record.id}
        since = record.past.from_s
        words = "nothing is kept of it" if since is None else f"it is kept from {since:.0f} s on"
        raise ServiceError(
            "not_kept",
            f"There is no picture of mission {record.id} at {at_s:.0f} s: {words}.",
            HTTPStatus.CONFLICT,
            {"kept_from_s": since},
        )

    async def last(self, mission_id: str) -> Json | None:
        """Return a mission's newest picture, None where none is kept. Raises ServiceError 404."""
        record = self._record_of(mission_id)
        if record.snapshot is not None or record.recording is None:
            return record.snapshot
        found = await self._recorded(record, float("inf"))
        return None if found is None else found | {"mission": record.id, "state": record.state}

    def absence(self, mission_id: str) -> str:
        """Return in a sentence why there is no picture of a mission, empty where there is one.

        Raises ServiceError 404.
        """
        record = self._record_of(mission_id)
        if record.snapshot is not None or record.recording is not None:
            return ""
        if not record.has_flown:
            over = record.state in (MissionState.ENDED, MissionState.FAILED)
            return f"Mission {record.id} {'never flew' if over else 'has not flown yet'}."
        if record.live:
            return f"Mission {record.id} is being brought up: nothing is seen of it yet."
        gone = record.definition.planner.get("record") is not None
        return (
            f"There is no picture of mission {record.id}: it flew before this server was started, "
            + ("and its recording is gone. " if gone else "and was not recorded. ")
            + "Its events, decisions, comments and the course of its figures are kept. "
            "FALCONER_RECORDINGS names a folder that missions are recorded into."
        )

    def kept_from_s(self, mission_id: str) -> float | None:
        """Return from when on pictures are at hand, None for none. Raises ServiceError 404."""
        record = self._record_of(mission_id)
        return 0.0 if record.recording is not None else record.past.from_s

    def keep_past(self, flying: MissionRecord, records: Iterable[MissionRecord]) -> None:
        """Keep the pictures of one mission that flies and of no other: memory is bounded."""
        for record in records:
            if flying.real and record is not flying:
                record.past.clear()

    async def _recorded(self, record: MissionRecord, at_s: float) -> Json | None:
        path = record.recording
        if path is None:
            return None

        def read() -> Json | None:
            opened = self._opened
            if opened is None or opened.path != path or not opened.complete:
                opened = self._opened = open_recording(path)
            return opened.snapshot_at(min(at_s, opened.duration_s))

        try:
            return await asyncio.to_thread(read)
        except RecordingError as error:
            raise ServiceError("not_kept", f"{error}.", HTTPStatus.CONFLICT) from error

    async def _read_course(self, record: MissionRecord) -> Course:
        """Return the course of a replay or of a mission that is known from the journal."""
        if record.replays and record.recording is not None:
            path = record.recording
            try:
                return await asyncio.to_thread(lambda: recorded_course(open_recording(path)))
            except RecordingError as error:
                raise ServiceError("not_kept", f"{error}.", HTTPStatus.CONFLICT) from error
        samples = await _all(self._chronicle.samples, record.id)
        events = await _all(self._chronicle.events, record.id)
        known = events[-1]["seq"] if events else 0
        fresh = [e for e in record.recent_events(PAGE) if e["seq"] > known]  # not written yet
        return course_of(samples, [*events, *fresh])


def recorded_course(recording: Recording) -> Course:
    """Return the course of a recorded mission. Raises RecordingError."""
    samples = (sample_of(snapshot) for snapshot in recording.sampled(SAMPLE_S))
    return course_of(samples, recording.events())


async def _all(page: Callable[..., Any], mission_id: str) -> list[Json]:
    """Return everything that a paged reading gives."""
    found: list[Json] = []
    while rows := await page(mission_id, found[-1]["seq"] if found else 0, PAGE):
        found += rows
    return found
