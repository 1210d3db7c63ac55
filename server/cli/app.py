"""The commands and how their errors read: one sentence on stderr, exit code 2 for bad input."""

import sys

import typer

from server.api.security import ExposureRefused
from server.cli.errors import UsageError
from server.cli.mock import mock_llm
from server.cli.run import run
from server.cli.serve import serve
from server.cli.simulate import sim
from server.models import ModelUnavailable
from server.scenarios.errors import ScenarioError
from server.settings import SettingsError
from solver.engines import EngineUnavailable

_BAD_INPUT = (
    UsageError,
    ScenarioError,
    SettingsError,
    ModelUnavailable,
    EngineUnavailable,
    ExposureRefused,
)

app = typer.Typer(
    name="falconer",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Fly a team of robots that tracks moving targets among unknown hazards, "
    "with language models in the loop and people in charge.",
)
app.command()(run)
app.command()(serve)
app.command()(sim)
app.command("mock-llm")(mock_llm)


@app.callback()
def _falconer() -> None:
    """Keep `run` a command of its own, however many there are."""


def main() -> None:
    """Run the command line; bad input ends in one sentence and exit code 2."""
    try:
        app()
    except _BAD_INPUT as error:
        print(f"falconer: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
