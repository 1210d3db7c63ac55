"""`falconer router`: the bus of a team as a process of its own."""

import asyncio
from typing import TYPE_CHECKING, Annotated

import typer

from server.cli.bus import DEFAULT_BUS
from server.cli.endless import log_to_stderr, until_interrupted
from server.cli.errors import UsageError
from server.cli.options import ScenarioArgument

if TYPE_CHECKING:
    from vehicles.zenoh_settings import ZenohSettings


def router(
    scenario: ScenarioArgument,
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help=f"Where planner and vehicles connect; several with commas; default {DEFAULT_BUS}.",
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Another router to join, if any.")
    ] = None,
    show: Annotated[
        bool, typer.Option("--show", help="Print its Zenoh configuration, for zenohd, and end.")
    ] = False,
) -> None:
    """Route the bus of SCENARIO's team, so that planners can come and go beneath the vehicles."""
    from server.bus import router_bus
    from server.scenarios import library
    from server.settings import load_settings
    from vehicles.bus import BusError
    from vehicles.zenoh_settings import described

    setup = library.load(scenario).mission_setup()
    settings = load_settings(zenoh_listen=listen, zenoh_connect=connect)
    if settings.zenoh_listen is None:
        settings = settings.model_copy(update={"zenoh_listen": DEFAULT_BUS})
    bus = router_bus(settings, setup.team, setup.robot_ids)
    if show:
        typer.echo(described(bus))
        return
    log_to_stderr()
    try:
        asyncio.run(until_interrupted(_route(bus, setup.team)))
    except BusError as error:
        raise UsageError(str(error)) from error


async def _route(bus: "ZenohSettings", team: str) -> None:
    """Route until cancelled."""
    from vehicles.keys import TeamKeys
    from vehicles.zenoh_bus import ZenohBus

    async with ZenohBus(bus, TeamKeys(team).delivery) as opened:
        rules = "open to all" if bus.access is None else "each party its own keys only"
        where = ", ".join(opened.endpoints)
        typer.echo(f"routing for team {team} at {where}, {rules} (Ctrl-C ends it)", err=True)
        await asyncio.get_running_loop().create_future()
