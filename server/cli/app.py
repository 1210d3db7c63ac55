"""The command line, and how its errors read: one sentence on stderr, exit code 2 for bad input."""

import sys

import typer

from server.cli.commands import CommandGroup
from server.errors import BadInput
from solver.engines import EngineUnavailable

app = typer.Typer(
    name="falconer",
    cls=CommandGroup,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Fly a team of robots that tracks moving targets among unknown hazards, "
    "with language models in the loop and people in charge.",
)


@app.callback()
def _falconer() -> None:
    """Stand for the group: the commands themselves are found by their names."""


def main() -> None:
    """Run the command line; bad input ends in one sentence and exit code 2."""
    try:
        app()
    except (BadInput, EngineUnavailable) as error:
        print(f"falconer: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
