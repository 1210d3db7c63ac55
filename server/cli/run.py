"""`falconer run`: one mission from a scenario, live with the console or in lockstep."""

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from server.cli.errors import UsageError
from server.cli.options import (
    EngineName,
    EngineOption,
    GateOption,
    LatencyOption,
    LlmOption,
    ScenarioArgument,
    SeedOption,
    StepsOption,
    latency_option,
    scripted_comments,
)
from server.cli.progress import progress_bar
from server.cli.tables import comment_lines, result_table, warning_lines
from server.mission.setup import GateMode, MissionSetup
from server.models import checked_choice
from server.settings import load_settings

if TYPE_CHECKING:
    from server.lockstep.assembly import Assembly
    from server.lockstep.job import ScriptedComment

RecordOption = Annotated[
    Path | None,
    typer.Option("--record", metavar="FILE.mcap", help="Record it; see falconer replay."),
]


def run(
    scenario: ScenarioArgument,
    llm: LlmOption = "mock",
    gate: GateOption = None,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Virtual time, as fast as it goes, no console.")
    ] = False,
    seed: SeedOption = None,
    steps: StepsOption = None,
    engine: EngineOption = None,
    llm_latency: LatencyOption = "paper",
    comment: Annotated[
        list[str] | None,
        typer.Option(metavar="T:TEXT", help="Say TEXT at mission second T; may be repeated."),
    ] = None,
    record: RecordOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also write result.json there.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Of the live console; default 8000.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Fly SCENARIO: live with the console on http://127.0.0.1:PORT, or in --lockstep."""
    from server.scenarios import library

    chosen = library.load(scenario)
    settings = load_settings(port=port)
    setup = _adjusted(chosen.mission_setup(settings.engine), gate, seed, steps, engine)
    comments = scripted_comments(comment or [])
    latency = latency_option(llm_latency)
    llm = checked_choice(llm)
    if out is not None:
        _make_folder(out)
    if not lockstep:
        from server.api.definitions import define_live
        from server.cli.live import Until, serve_live

        said = [(said.time_s, said.text) for said in comments]
        definition = define_live(setup, chosen.world_setup(), llm, settings, said, record)
        if (figures := serve_live(settings, definition, Until.OVER)) is not None:
            _deliver(figures, out, as_json=as_json)
        return
    from server.lockstep.assembly import Assembly

    assembly = Assembly(
        setup=setup,
        world=chosen.world_setup(),
        llm=llm,
        latency=latency,
        settings=settings,
    )
    with progress_bar(f"{setup.name} seed {setup.seed}", setup.steps) as progress:
        result = _flown(assembly, comments, progress, record)
    _deliver(result, out, as_json=as_json)


def _adjusted(
    setup: MissionSetup,
    gate: GateMode | None,
    seed: int | None,
    steps: int | None,
    engine: EngineName | None,
) -> MissionSetup:
    """Return the setup with what the command line says otherwise."""
    if gate is not None:
        setup = replace(setup, gate=gate)
    if seed is not None:
        setup = replace(setup, seed=seed)
    if steps is not None:
        setup = replace(setup, steps=steps)
    if engine is not None:
        setup = replace(setup, planner=replace(setup.planner, engine=engine.value))
    return setup


def _flown(
    assembly: "Assembly",
    comments: "tuple[ScriptedComment, ...]",
    progress: Callable[[int], None],
    record: Path | None,
) -> dict[str, Any]:
    """Fly in lockstep, recorded or not; return the result."""
    if record is None:
        return asyncio.run(assembly.run(comments, progress, say=_say))
    from server.recording.session import recorded_run

    with recorded_run(record, assembly, lambda words: _say(f"warning: {words}")) as recorded:
        writer, chronicle = recorded
        flight = assembly.run(comments, progress, writer, _say, chronicle.note, chronicle.decide)
        result = asyncio.run(flight)
        chronicle.close(result)
    return result


def _say(words: str) -> None:
    typer.echo(words, err=True)


def _make_folder(out: Path) -> None:
    """Make the result's folder before anything is flown. Raises UsageError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {out}: {error.strerror or error}") from error


def _deliver(result: dict[str, Any], out: Path | None, *, as_json: bool) -> None:
    """Print a result, then keep it: a full disk costs the file alone. Raises UsageError."""
    text = json.dumps(result, indent=2, allow_nan=False)
    for line in (*warning_lines(result), *comment_lines(result)):
        _say(line)
    if as_json:
        typer.echo(text)
    else:
        Console().print(result_table(result))
    if out is None:
        return
    try:
        (out / "result.json").write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--out {out}: {error.strerror or error}") from error
