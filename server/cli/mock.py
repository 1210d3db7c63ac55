"""`falconer mock-llm`: the rule model as an OpenAI-compatible server."""

from typing import Annotated

import typer

from llm.mock.behaviours import Mode
from server.cli.options import finite


def mock_llm(
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8081,
    behaviour: Annotated[
        Mode, typer.Option(help="How it (mis)behaves; PUT /mock/behaviour changes it later.")
    ] = Mode.SOUND,
    delay_s: Annotated[
        float,
        typer.Option(
            "--delay-s",
            callback=finite,
            min=0.0,
            max=3600.0,
            help="Seconds: of slow answers, silence of stalled ones.",
        ),
    ] = 5.0,
) -> None:
    """Serve the mock language model at http://HOST:PORT/v1: rules over the prompt's words."""
    from llm.mock.app import serve
    from llm.mock.behaviours import Behaviour

    typer.echo(f"mock language model on http://{host}:{port}/v1 (Ctrl-C ends it)", err=True)
    serve(host, port, Behaviour(mode=behaviour, delay_s=delay_s))
