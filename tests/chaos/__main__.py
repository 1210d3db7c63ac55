"""Break everything that can break, and see that what must hold holds: `make chaos`.

Each seed is a run of its own: a router, a server with its planner, a mock language model, six
robots (two of them MAVLink vehicles), three programs and a browser as clients, all real processes,
and a schedule of faults that the seed determines. Exit code 1 when an invariant did not hold.
"""

import asyncio
import json
import os
import signal
from collections.abc import Coroutine, Sequence
from time import monotonic
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from tests.chaos.plants import Caught, plant_all
from tests.chaos.run import Outcome, Row, database_of, fly
from tests.chaos.watch import Invariant

app = typer.Typer(add_completion=False)
screen = Console(stderr=True)
T = TypeVar("T")


@app.command()
def chaos(
    seed: Annotated[
        list[int] | None, typer.Option(help="Of a schedule; several times for several. 0 to 4.")
    ] = None,
    minutes: Annotated[float, typer.Option(min=1.0, help="For all of them together.")] = 18.0,
    database: Annotated[
        str, typer.Option(help="sqlite, postgresql, or auto: both by turns.")
    ] = "auto",
    plants: Annotated[
        bool, typer.Option(help="First plant a bug for each invariant: it must be caught.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Break everything that can break, and see that what must hold holds."""
    seeds = tuple(range(5)) if not seed else tuple(seed)
    end_s = monotonic() + 60.0 * minutes
    caught = asyncio.run(_ended_in_order(_plant(end_s))) if plants else []
    outcomes = []
    for done, one in enumerate(seeds):
        share_s = (end_s - monotonic()) / (len(seeds) - done)
        kept = database_of(one) if database == "auto" else database
        with Progress(end_s, f"seed {one}") as progress:
            work = fly(one, monotonic() + share_s, kept, progress.show)
            outcomes.append(asyncio.run(_ended_in_order(work)))
        if not as_json:
            tell(outcomes[-1])
    if as_json:
        values = {
            "plants": [each.shown() for each in caught],
            "runs": [outcome.shown() for outcome in outcomes],
        }
        typer.echo(json.dumps(values, indent=2, default=str))
    else:
        tell_caught(caught)
    if not all(outcome.passed for outcome in outcomes) or not all(c.caught for c in caught):
        raise typer.Exit(1)


class Progress:
    """A line that says what is being done and how much time is left. `with`."""

    def __init__(self, end_s: float, title: str) -> None:
        self._end_s, self._title = end_s, title
        self._live = Live(console=screen, transient=True, refresh_per_second=2)

    def __enter__(self) -> "Progress":
        if screen.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if screen.is_terminal:
            self._live.stop()

    def show(self, doing: str, rows: Sequence[Row]) -> None:
        """Say what is being done."""
        left_s = max(0, round(self._end_s - monotonic()))
        broken = sum(len(row.violations) for row in rows)
        line = (
            f"{self._title}: {len(rows)} faults, {broken} violations; {doing};"
            f" {left_s // 60}:{left_s % 60:02d} left, load {os.getloadavg()[0]:.1f}"
        )
        if screen.is_terminal:
            self._live.update(line)
        else:
            screen.print(line)


async def _ended_in_order(work: Coroutine[Any, Any, T]) -> T:
    """Do some work; SIGTERM ends it as Ctrl-C does, so that nothing outlives it."""
    task = asyncio.ensure_future(work)
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    return await task


async def _plant(end_s: float) -> list[Caught]:
    with Progress(end_s, "planted bugs") as progress:
        return await plant_all(lambda doing: progress.show(doing, ()))


def tell(outcome: Outcome) -> None:
    """Print a run's tables."""
    table = Table(
        title=f"Seed {outcome.seed}: {outcome.database}, {outcome.disk}; {outcome.figures}",
        title_justify="left",
    )
    for name in ("at", "fault", "reported by", "all fly after", "broken"):
        table.add_column(name, overflow="fold")
    for row in outcome.rows:
        broken = "; ".join(f"{one.invariant}: {one.text}" for one in row.violations)
        table.add_row(
            f"{row.at_s:.0f} s",
            row.fault,
            escape(row.report[:90]),
            f"{row.flying_s:.1f} s",
            escape(broken),
        )
    verdict = Table(title="Verdict", title_justify="left")
    for name in ("invariant", "looked at", "seen broken"):
        verdict.add_column(name)
    for invariant in Invariant:
        count = sum(one.invariant is invariant for one in outcome.violations)
        sign = f"[bold red]{count}[/]" if count else "[green]never[/]"
        verdict.add_row(invariant.value, str(outcome.checks.get(invariant.value, 0)), sign)
    console = Console()
    console.print(table)
    console.print(verdict)
    for one in outcome.late:
        console.print(f"[bold red]{one.invariant}[/]: {escape(one.text)}")


def tell_caught(caught: Sequence[Caught]) -> None:
    """Print what became of the planted bugs."""
    if not caught:
        return
    table = Table(title="Planted bugs", title_justify="left")
    for name in ("invariant", "planted", "caught by"):
        table.add_column(name, overflow="fold")
    for one in caught:
        seen = escape(one.text) if one.caught else "[bold red]not caught[/]"
        table.add_row(one.invariant.value, one.planted, seen)
    Console().print(table)


if __name__ == "__main__":
    app()
