"""`falconer sim`: a scenario's world and its robots as a process of their own."""

import asyncio
import contextlib
import logging
import signal
import sys
from collections.abc import Coroutine
from dataclasses import replace
from typing import Annotated, Any

import typer

from server.cli.errors import UsageError
from server.cli.options import EngineName, ScenarioArgument, SeedOption


def sim(
    scenario: ScenarioArgument,
    connect: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Where the planner or a router listens.")
    ] = "tcp/127.0.0.1:7447",
    seed: SeedOption = None,
    engine: Annotated[
        EngineName | None, typer.Option(help="Optimizer of robots that fly alone.")
    ] = None,
) -> None:
    """Simulate the world of SCENARIO with one agent per robot, for a planner elsewhere."""
    from server.bus import vehicle_bus
    from server.scenarios import library
    from server.settings import load_settings
    from vehicles.agent import DuplicateRobotError
    from vehicles.bus import BusError
    from vehicles.sim_worker import SimulationJob, simulate
    from vehicles.simulation import SimulationSettings

    chosen = library.load(scenario)
    setup = chosen.mission_setup()
    settings = load_settings(zenoh_connect=connect)
    job = SimulationJob(
        world=chosen.world_setup(),
        team=setup.team,
        # Started before the planner it waits: robots without a planner hold anyway.
        zenoh=replace(vehicle_bus(settings), open_timeout_s=None),
        simulation=SimulationSettings(
            seed=setup.seed if seed is None else seed, tick_s=setup.live_tick_s
        ),
        engine=settings.engine if engine is None else engine.value,
    )
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(levelname)s %(message)s")
    typer.echo(f"world of {setup.name}, team {setup.team}, on {connect} (Ctrl-C ends it)", err=True)
    try:
        asyncio.run(_until_interrupted(simulate(job)))
    except (BusError, DuplicateRobotError) as error:
        raise UsageError(str(error)) from error


async def _until_interrupted(work: Coroutine[Any, Any, None]) -> None:
    """Run until the work ends, or SIGINT or SIGTERM asks for an orderly end."""
    task = asyncio.ensure_future(work)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
