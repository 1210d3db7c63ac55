"""`falconer serve`: the service and the console, for missions started by REST or by name."""

from typing import Annotated

import typer

from server.cli.options import LlmOption
from server.models import checked_choice
from server.settings import load_settings


def serve(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO", help="Fly this at once; without it, missions come by REST."
        ),
    ] = None,
    llm: LlmOption = "mock",
    host: Annotated[
        str | None, typer.Option(help="Address to listen on; default 127.0.0.1.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port to listen on; default 8000.")
    ] = None,
    zenoh_listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Wait for vehicles here (tcp/127.0.0.1:7447) instead of simulating them.",
        ),
    ] = None,
    zenoh_connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Reach vehicles through this router.")
    ] = None,
) -> None:
    """Serve REST, stream and console; vehicles are simulated beside it unless a bus is named."""
    from server.api.definitions import define_live
    from server.cli.live import Until, serve_live
    from server.scenarios import library

    settings = load_settings(
        host=host, port=port, zenoh_listen=zenoh_listen, zenoh_connect=zenoh_connect
    )
    definition = None
    if scenario is not None:
        chosen = library.load(scenario)
        setup = chosen.mission_setup(settings.engine)
        definition = define_live(setup, chosen.world_setup(), checked_choice(llm), settings)
    serve_live(settings, definition, Until.STOPPED)
