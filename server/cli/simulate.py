"""`falconer sim`: a scenario's world and its robots as a process of their own."""

import asyncio
from dataclasses import replace
from typing import Annotated

import typer

from server.cli.bus import DEFAULT_BUS, bus_of
from server.cli.endless import log_to_stderr, until_interrupted
from server.cli.errors import UsageError
from server.cli.options import EngineName, ScenarioArgument, SeedOption


def sim(
    scenario: ScenarioArgument,
    connect: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help=f"Where the planner or a router listens; default {DEFAULT_BUS}.",
        ),
    ] = None,
    external: Annotated[
        list[int] | None,
        typer.Option(
            metavar="ID",
            help="A robot that is flown elsewhere, by `falconer vehicle`: the world senses for it "
            "and does not move it. May be given several times.",
        ),
    ] = None,
    seed: SeedOption = None,
    engine: Annotated[
        EngineName | None, typer.Option(help="Optimizer of robots that fly alone.")
    ] = None,
) -> None:
    """Simulate the world of SCENARIO with one agent per robot, for a planner elsewhere."""
    from server.scenarios import library
    from server.settings import load_settings
    from vehicles.agent import DuplicateRobotError
    from vehicles.bus import BusError
    from vehicles.settings import SimulationSettings
    from vehicles.sim_job import SimulationJob
    from vehicles.sim_worker import simulate

    chosen = library.load(scenario)
    setup = chosen.mission_setup()
    bus = bus_of(connect)
    try:
        job = SimulationJob(
            world=chosen.world_setup(),
            team=setup.team,
            # Started before the planner it waits: robots without a planner hold anyway.
            zenoh=replace(bus, open_timeout_s=None),
            simulation=SimulationSettings(
                seed=setup.seed if seed is None else seed,
                tick_s=setup.live_tick_s,
                external=tuple(external or ()),
            ),
            engine=load_settings().engine if engine is None else engine.value,
        )
    except ValueError as error:
        raise UsageError(str(error)) from error
    log_to_stderr()
    where = ", ".join(bus.connect)
    typer.echo(f"world of {setup.name}, team {setup.team}, on {where} (Ctrl-C ends it)", err=True)
    try:
        asyncio.run(until_interrupted(simulate(job)))
    except (BusError, DuplicateRobotError) as error:
        raise UsageError(str(error)) from error
