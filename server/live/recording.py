"""A live mission's recording: opened before it, fed beside it, finished after it."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager
from pathlib import Path

from server.live.channel import Json
from server.live.job import PlannerJob
from server.mission.tape import NoTape, Recorder
from server.recording.header import flight_header
from server.recording.shelf import free_path
from server.recording.writer import RecordingWriter, opened_writer
from vehicles.messages import Truth


class FlightRecorder:
    """What a live mission hands over to be kept: its tape, its story, the truth. Never waits."""

    def __init__(self, writer: RecordingWriter | None, tape: Recorder) -> None:
        self._writer = writer
        self._told_step = -1
        self.tape = tape
        self.failed: Callable[[str], None] | None = None
        """Told, on the event loop, why the recording ended early."""

    @property
    def path(self) -> Path | None:
        """Where it is written, None when nothing is."""
        return None if self._writer is None else self._writer.path

    def tell(self, message: Json) -> None:
        """Take a message of the stream."""
        if self._writer is not None:
            self._writer.tell(message)

    def truth(self, truth: Truth | None) -> None:
        """Take the simulated world's truth, once per step of the world."""
        if self._writer is not None and truth is not None and truth.step != self._told_step:
            self._told_step = truth.step
            self._writer.truth(truth)


@asynccontextmanager
async def open_recorder(
    mission: str, job: PlannerJob, tape: Recorder | None = None
) -> AsyncIterator[FlightRecorder]:
    """Open what the job says; yield it. Raises RecordingError when the file cannot be made."""
    if job.record is None:
        yield FlightRecorder(None, tape or NoTape())
        return
    loop = asyncio.get_running_loop()
    recorder: FlightRecorder | None = None

    def report(words: str) -> None:
        """Pass on, from the writing thread, why the recording has ended."""
        if recorder is not None and recorder.failed is not None and not loop.is_closed():
            loop.call_soon_threadsafe(recorder.failed, words)

    header = flight_header(mission, job.setup, job.world, job.llm, "realtime")
    opening: AbstractContextManager[RecordingWriter] = opened_writer(
        free_path(job.record), header, report
    )
    writer = await asyncio.to_thread(opening.__enter__)
    recorder = FlightRecorder(writer, writer)
    try:
        yield recorder
    finally:
        await asyncio.shield(asyncio.to_thread(writer.close))
