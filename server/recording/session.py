"""Recording a lockstep run: header, tape and story in one context."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from server.lockstep.assembly import Assembly
from server.recording.chronicle import Chronicle
from server.recording.header import flight_header
from server.recording.writer import RecordingWriter, Report, opened_writer


@contextmanager
def recorded_run(
    path: Path, assembly: Assembly, report: Report
) -> Iterator[tuple[RecordingWriter, Chronicle]]:
    """Record a lockstep run into a file. Raises RecordingError when it cannot be made."""
    setup = assembly.setup
    header = flight_header(setup.name, setup, assembly.world, assembly.llm, "lockstep")
    with opened_writer(path, header, report) as writer:
        yield writer, Chronicle(setup.name, setup, writer)
