"""`falconer replay` and `falconer report`: looking at what was flown."""

import asyncio
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from server.cli.errors import UsageError
from server.cli.options import (
    GateOption,
    LlmOption,
    finite,
    latency_option,
    scripted_comments,
)
from server.cli.progress import progress_bar
from server.mission.setup import GateMode
from server.models import checked_choice
from server.settings import load_settings

RecordingArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="A recording.", show_default=False)
]

VERIFY_FAILED = 1
"""Exit code of a recording whose replay differs."""


def replay(
    file: RecordingArgument,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", help="Run its inputs again and compare every set-point and directive."
        ),
    ] = False,
    fork_at: Annotated[
        float | None,
        typer.Option(
            "--fork-at",
            metavar="SECONDS",
            callback=finite,
            min=0.0,
            help="Fly on from this mission second in lockstep, with --llm and --comment.",
        ),
    ] = None,
    llm: LlmOption = "mock",
    gate: GateOption = None,
    comment: Annotated[
        list[str] | None,
        typer.Option(metavar="T:TEXT", help="Say TEXT at mission second T of the fork."),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=2**63 - 1, help="Other dice for the fork; default: the same."),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Of the console; default 8000.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Show FILE in the console, verify it, or fork it: fly on from an instant otherwise."""
    from server.recording.reader import open_recording

    recording = open_recording(file)
    if verify and fork_at is not None:
        raise UsageError("--verify and --fork-at exclude each other")
    if verify:
        _verify(recording, as_json=as_json)
    elif fork_at is not None:
        _fork(recording, fork_at, (llm, gate), comment or [], seed, as_json=as_json)
    else:
        from server.cli.live import serve_recording

        serve_recording(load_settings(port=port), recording)


def report(
    file: RecordingArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; default: FILE-report beside it."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the names of the files as JSON.")
    ] = False,
) -> None:
    """Write the after-action report of FILE: a page with figures, and CSV tables."""
    from server.recording.reader import open_recording
    from server.recording.report import write_report

    recording = open_recording(file)
    folder = out or file.with_name(f"{file.stem}-report")
    try:
        written = write_report(recording, folder)
    except OSError as error:
        raise UsageError(f"{folder} cannot be written: {error.strerror or error}") from error
    if as_json:
        typer.echo(json.dumps({"files": [str(path) for path in written]}, indent=2))
    else:
        for path in written:
            typer.echo(path)


def _verify(recording: Any, *, as_json: bool) -> None:
    from server.recording.verification import verify_recording

    total = max(1, round(recording.duration_s))
    with progress_bar(f"verifying {recording.path.name}", total) as progress:
        found = verify_recording(recording, lambda seconds: progress(min(total, round(seconds))))
    if as_json:
        typer.echo(json.dumps({"passed": found.passed, **asdict(found)}, indent=2))
    else:
        for line in found.differences:
            typer.echo(line, err=True)
        if not found.complete:
            typer.echo("the file was cut off; it was verified to its last whole chunk", err=True)
        same = found.ticks - found.different
        verdict = "passed" if found.passed else "FAILED"
        typer.echo(f"{verdict}: {same} of {found.ticks} ticks are the same, bit for bit")
        if found.late:
            typer.echo(f"the plans of {found.late} came from the tape: their solves were late")
    if not found.passed:
        sys.exit(VERIFY_FAILED)


def _fork(
    recording: Any,
    at_s: float,
    guidance: tuple[str, GateMode | None],
    comments: list[str],
    seed: int | None,
    *,
    as_json: bool,
) -> None:
    from server.recording.fork import Change, fork

    llm, gate = guidance
    said = scripted_comments(comments)
    change = Change(at_s, checked_choice(llm), latency_option("paper"), said, seed, gate)
    steps = max(1, round((recording.duration_s - at_s) / recording.header.tick_s))
    with progress_bar(f"fork at {at_s:g} s", steps) as progress:
        result = asyncio.run(fork(recording, change, load_settings(), progress))
    if as_json:
        typer.echo(json.dumps(result, indent=2, allow_nan=False))
        return
    table = Table("", "recorded", "forked", title=f"{result['at_s']:g} to {result['until_s']:g} s")
    for name, value in result["forked"].items():
        recorded = result["recorded"].get(name)
        table.add_row(name.replace("_", " "), _number(recorded), _number(value))
    Console().print(table)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
