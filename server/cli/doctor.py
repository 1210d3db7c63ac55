"""`falconer doctor`: what this installation has and lacks, and whether the journal is whole."""

import asyncio
import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from server.cli.errors import UsageError
from server.diagnosis import Finding, Health, findings
from server.journal.store import Store, StoreError, StoreUrlError
from server.journal.verification import Verification, verify
from server.settings import Settings, load_settings

_SIGNS = {
    Health.GOOD: "[green]good[/]",
    Health.NOTE: "[dim]note[/]",
    Health.POOR: "[yellow]poor[/]",
    Health.BAD: "[bold red]bad[/]",
}


def doctor(
    journal: Annotated[
        bool, typer.Option("--journal", help="Read the whole journal and check its chain.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Of the server; default 8000.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check the installation, or the journal; exit code 1 when something does not work."""
    settings = load_settings(port=port)
    if journal:
        _show_verification(asyncio.run(_verified(settings)), as_json=as_json)
        return
    found = asyncio.run(_looked_at(settings))
    bad = [finding for finding in found if finding.health is Health.BAD]
    if as_json:
        typer.echo(json.dumps({"sound": not bad, "findings": [asdict(f) for f in found]}, indent=2))
    else:
        table = Table(title="Falconer's installation")
        table.add_column("what")
        table.add_column("")
        table.add_column("found", overflow="fold")
        for finding in found:
            table.add_row(finding.name, _SIGNS[finding.health], escape(finding.text))
        Console().print(table)
    if bad:
        raise typer.Exit(1)


async def _looked_at(settings: Settings) -> list[Finding]:
    return [finding async for finding in findings(settings)]


async def _verified(settings: Settings) -> Verification:
    try:
        store = Store(settings.journal_address())
    except StoreUrlError as error:
        raise UsageError(f"FALCONER_DATABASE_URL: {error}") from error
    try:
        await store.open_to_read()
        return await verify(store)
    except StoreError as error:
        raise UsageError(str(error)) from error
    finally:
        await store.close()


def _show_verification(found: Verification, *, as_json: bool) -> None:
    if as_json:
        head = asdict(found.head)
        answer = {"sound": found.sound, "entries": found.entries, "head": head}
        typer.echo(json.dumps({**answer, "problems": found.problems}, indent=2))
    else:
        word = "whole" if found.sound else "NOT whole"
        typer.echo(f"The journal is {word}: {found.entries} entries.")
        typer.echo(f"Its head: {found.head.seq} {found.head.hash}")
        for problem in found.problems:
            typer.echo(f"- {problem}")
    if not found.sound:
        raise typer.Exit(1)
