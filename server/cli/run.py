"""`falconer run`: one mission from a scenario, live with the console or in lockstep."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from server.cli.errors import UsageError
from server.cli.options import (
    EngineName,
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

GateOption = Annotated[
    GateMode | None,
    typer.Option("--gate", help="What a verified proposal must still pass."),
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
    engine: Annotated[EngineName | None, typer.Option(help="Optimizer; default: the best.")] = None,
    llm_latency: Annotated[
        str,
        typer.Option(
            "--llm-latency",
            metavar="paper|measured|SECONDS",
            help="Virtual seconds an answer takes in lockstep.",
        ),
    ] = "paper",
    comment: Annotated[
        list[str] | None,
        typer.Option(metavar="T:TEXT", help="Say TEXT at mission second T; may be repeated."),
    ] = None,
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
    if not lockstep:
        from server.api.library import define_live
        from server.cli.live import serve_live

        said = [(said.time_s, said.text) for said in comments]
        definition = define_live(setup, chosen.world_setup(), llm, settings, said)
        figures = serve_live(settings, definition, until_over=True)
        if figures is not None:
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
        result = asyncio.run(assembly.run(comments, progress))
    _deliver(result, out, as_json=as_json)


def _adjusted(
    setup: MissionSetup,
    gate: GateMode | None,
    seed: int | None,
    steps: int | None,
    engine: EngineName | None,
) -> MissionSetup:
    """Return the setup with what the command line says otherwise."""
    if gate not in (None, GateMode.OFF):
        raise UsageError(f"--gate {gate.value}: this gate is not built yet; use --gate off")
    setup = replace(setup, gate=GateMode.OFF)
    if seed is not None:
        setup = replace(setup, seed=seed)
    if steps is not None:
        setup = replace(setup, steps=steps)
    if engine is not None:
        setup = replace(setup, planner=replace(setup.planner, engine=engine.value))
    return setup


def _deliver(result: dict[str, Any], out: Path | None, *, as_json: bool) -> None:
    text = json.dumps(result, indent=2, allow_nan=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "result.json").write_text(text + "\n", encoding="utf-8")
    for line in (*warning_lines(result), *comment_lines(result)):
        typer.echo(line, err=True)
    if as_json:
        typer.echo(text)
    else:
        Console().print(result_table(result))
