"""`falconer experiment`: campaigns over many seeds, with tables and figures."""

import math
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markdown import Markdown

from server.cli.errors import UsageError
from server.cli.options import (
    EngineName,
    EngineOption,
    GateOption,
    LatencyOption,
    LlmOption,
    latency_option,
    scripted_comments,
)
from server.cli.progress import progress_bar
from server.experiments.campaign import Done, Failed, Workers, outcomes
from server.experiments.report import Report
from server.experiments.store import TrialStore
from server.experiments.trials import Trial

MOST_SEEDS = 10_000

experiment = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Measure what the parts are worth: many seeds, in parallel, resumable, with tables "
    "(Markdown, CSV) and figures (PNG) in a folder.",
)

LlmsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--llm",
        metavar="mock|local|URL",
        help="A model to measure; may be repeated. Default: mock, which is a rule model.",
    ),
]
SeedsOption = Annotated[int, typer.Option("--seeds", min=1, max=MOST_SEEDS, help="Seeds 0 to N-1.")]
JobsOption = Annotated[
    int | None,
    typer.Option("--jobs", min=1, max=512, help="Worker processes; default: one per processor."),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler (tcp://HOST:8786) whose workers do the runs; extra `distributed`.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder of results, tables and figures; runs found there are not done again. "
        "Default: experiments/NAME.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@experiment.command()
def ablation(
    llm: LlmsOption = None,
    scenario: Annotated[
        str, typer.Option(metavar="SCENARIO", help="As for `falconer run`.")
    ] = "ablation",
    seeds: SeedsOption = 10,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    out: OutOption = None,
    gate: GateOption = None,
    comment: Annotated[
        list[str] | None,
        typer.Option(
            metavar="T:TEXT",
            help="What the person says at mission second T, in place of the paper's sentence "
            "after the first period of the task model and every third; may be repeated.",
        ),
    ] = None,
    trade_off: Annotated[
        bool,
        typer.Option("--trade-off", help="Also fly other weights of safety: trace for attacks."),
    ] = False,
    steps: Annotated[
        int | None, typer.Option(min=1, max=1_000_000, help="Steps of a run; default: the file's.")
    ] = None,
    engine: EngineOption = None,
    llm_latency: LatencyOption = "paper",
    as_json: JsonOption = False,
) -> None:
    """Measure what optimizer, assignment solver, model and person are worth (paper, Table I).

    Rows: nobody advises, our assignment solver, each model, each model with a person who
    comments. Means with 95 % intervals, and differences paired over the seeds.
    """
    from server.experiments.ablation import Ablation, AblationPlan, person
    from server.experiments.ablation_figures import draw
    from server.scenarios import library

    chosen = library.load(scenario).varied(steps=steps)
    setup = chosen.mission_setup()
    plan = AblationPlan(
        scenario=chosen,
        llms=_asked(llm),
        seeds=tuple(range(seeds)),
        gate=setup.gate if gate is None else gate,
        latency=latency_option(llm_latency),
        engine=_engine(engine, setup.planner.engine),
        comments=scripted_comments(comment) if comment else person(chosen),
        trade_off=trade_off,
    )
    store = _opened(out, "ablation")
    done = _conducted("ablation", plan.trials(), store, Workers(_jobs(jobs), scheduler))
    found = Ablation.of(plan, done)
    report = Report(plan.title, plan.notes, found.tables(), draw(found), found.as_json())
    _deliver(store, report, as_json=as_json)


@experiment.command()
def reasoning(
    llm: LlmsOption = None,
    seeds: SeedsOption = 5,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    out: OutOption = None,
    engine: EngineOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure how often models answer validly, and in how many tokens (the paper's 3 x 3 grid).

    Four robots of capacity 3; 2, 4 and 8 targets among 2, 4 and 8 zones; with and without a
    worked example in the prompt; task and action model.
    """
    from server.experiments.ablation import model_names
    from server.experiments.reasoning import Reasoning, ReasoningPlan
    from server.experiments.reasoning_figures import draw

    llms = _asked(llm)
    plan = ReasoningPlan(
        llms=llms,
        names=tuple(name.removeprefix("llm-") for name in model_names(llms)),
        seeds=tuple(range(seeds)),
        engine=_engine(engine),
    )
    store = _opened(out, "reasoning")
    done = _conducted("reasoning", plan.trials(), store, Workers(_jobs(jobs), scheduler))
    found = Reasoning.of(plan, done)
    report = Report(plan.title, plan.notes, found.tables(), draw(found), found.as_json())
    _deliver(store, report, as_json=as_json)


@experiment.command()
def scaling(
    largest: Annotated[
        int, typer.Option("--largest", min=2, max=1000, help="Robots of the largest team.")
    ] = 256,
    seeds: SeedsOption = 3,
    steps: Annotated[
        int, typer.Option(min=10, max=10_000, help="Ticks of a run, the first five not counted.")
    ] = 40,
    jobs: Annotated[
        int,
        typer.Option("--jobs", min=1, max=512, help="Worker processes; more than one disturbs."),
    ] = 1,
    scheduler: SchedulerOption = None,
    out: OutOption = None,
    engine: EngineOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the time of a tick of the core against the size of the team.

    Teams of 2, 4, 8, ... robots and twice as many targets at constant density. Processor time
    of the ticking thread, by its parts.
    """
    from server.experiments.scaling import Scaling, ScalingPlan

    plan = ScalingPlan(largest, tuple(range(seeds)), _engine(engine), steps)
    store = _opened(out, "scaling")
    done = _conducted("scaling", plan.trials(), store, Workers(jobs, scheduler))
    found = Scaling.of(plan, done)
    report = Report(plan.title, plan.notes, found.tables(), found.draw(), found.as_json())
    _deliver(store, report, as_json=as_json)


@experiment.command()
def runtime(
    llm: LlmOption = "mock",
    scenario: Annotated[
        str, typer.Option(metavar="SCENARIO", help="As for `falconer run`.")
    ] = "hardware",
    duration: Annotated[
        int, typer.Option("--duration", min=5, max=86_400, help="Seconds to fly, real time.")
    ] = 60,
    gate: GateOption = None,
    out: OutOption = None,
    engine: EngineOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fly live and report rate, run time and success of each module (paper, Table II).

    The planner, the simulated world and its vehicles are processes of their own, as for
    `falconer run`; no console is served. Each call flies anew.
    """
    import asyncio

    from server.api.definitions import define_live
    from server.experiments import runtime as live
    from server.models import checked_choice
    from server.scenarios import library
    from server.settings import load_settings

    settings = load_settings()
    chosen = library.load(scenario)
    setup = chosen.mission_setup(_engine(engine, settings.engine))
    setup = replace(
        setup,
        gate=setup.gate if gate is None else gate,
        steps=max(setup.steps, math.ceil((duration + live.SPARE_S) / setup.tick_s)),
    )
    definition = define_live(setup, chosen.world_setup(), checked_choice(llm), settings)
    store = _opened(out, "runtime")
    with progress_bar(f"{setup.name} live", duration) as progress:
        flight = asyncio.run(live.fly(definition, duration, progress))
    notes = f"{setup.name}, {duration} s, model {llm}, engine {setup.planner.engine}."
    tables = {"runtime": live.table(flight)}
    report = Report("Modules of a live mission", notes, tables, {}, live.as_json(flight))
    _deliver(store, report, as_json=as_json)


def _jobs(asked: int | None) -> int:
    return asked or len(os.sched_getaffinity(0))


def _asked(llms: list[str] | None) -> tuple[str, ...]:
    """Return the models to ask, each once. Raises ModelUnavailable, UsageError."""
    from server.models import EXACT, NOBODY, checked_choice

    chosen = tuple(dict.fromkeys(map(checked_choice, llms or ["mock"])))
    for llm in chosen:
        if llm in (EXACT, NOBODY):
            raise UsageError(f"--llm {llm}: expected a model; rows without one are flown anyway")
    return chosen


def _engine(asked: EngineName | None, scenarios_own: str | None = None) -> str:
    """Return the engine's name: as asked, as the settings or the scenario say, or the best."""
    from server.settings import load_settings
    from solver import engines

    if asked is not None:
        return asked.value
    return load_settings().engine or scenarios_own or engines.default_engine()


def _opened(out: Path | None, name: str) -> TrialStore:
    """Return the folder of results. Raises StoreError."""
    store = TrialStore(out or Path("experiments") / name)
    store.open()
    return store


def _conducted(
    name: str, trials: Iterable[Trial], store: TrialStore, workers: Workers
) -> list[Done]:
    """Do the trials under a progress bar; tell of those that fail.

    Raises UsageError when none could be done.
    """
    waiting = list(trials)
    done: list[Done] = []
    failed: list[Failed] = []
    with progress_bar(name, len(waiting)) as progress:
        for outcome in outcomes(waiting, store, workers):
            if isinstance(outcome, Done):
                done.append(outcome)
            else:
                failed.append(outcome)
                typer.echo(f"failed: {outcome.trial.label}: {outcome.error}", err=True)
            progress(len(done) + len(failed))
    if failed:
        typer.echo(failed[0].details, err=True)
        typer.echo(
            f"{len(failed)} of {len(waiting)} runs failed; run it again to repeat them", err=True
        )
    if not done:
        raise UsageError("no run could be done")
    return done


def _deliver(store: TrialStore, report: Report, *, as_json: bool) -> None:
    """Write everything, then tell it. Raises StoreError."""
    report.write(store)
    if as_json:
        typer.echo(report.as_text())
        return
    console = Console()
    console.print(f"[bold]{report.title}[/bold]\n{report.notes}", highlight=False)
    for table in report.tables.values():
        console.print(Markdown(f"**{table.title}**\n\n{table.markdown()}"))
    console.print(f"tables and figures in {store.folder}", highlight=False)
