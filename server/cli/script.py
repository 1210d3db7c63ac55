"""`falconer script`: steer a server through a scripted mission and exit with the verdict."""

import asyncio
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import httpx
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from server.cli.errors import UsageError
from server.models import is_address
from server.settings import load_settings

if TYPE_CHECKING:
    from server.scripts.client import Verdict
    from server.scripts.script import Script

NOT_PASSED = 1
"""Exit code of a mission that was not as expected."""


def script(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A script, in YAML.", show_default=False)
    ],
    server: Annotated[
        str, typer.Option(metavar="URL", help="The server to steer.")
    ] = "http://127.0.0.1:8000",
    as_json: Annotated[bool, typer.Option("--json", help="Print the verdict as JSON.")] = False,
) -> None:
    """Steer a server through the scripted mission in FILE; exit 0 if it went as expected."""
    from server.scripts.client import ScriptFailed
    from server.scripts.script import ScriptError, load_script

    if not is_address(server):
        raise UsageError(f"--server {server[:80]!r}: expected http://HOST:PORT, or https")
    try:
        verdict = asyncio.run(_run(load_script(file), server))
    except (ScriptError, ScriptFailed, httpx.InvalidURL) as error:
        raise UsageError(str(error)) from error
    if as_json:
        typer.echo(json.dumps({"passed": verdict.passed, **asdict(verdict)}, indent=2))
    else:
        _show(verdict)
    if not verdict.passed:
        sys.exit(NOT_PASSED)


async def _run(script: "Script", server: str) -> "Verdict":
    from server.scripts.client import REQUEST_S, ScriptClient

    settings = load_settings()
    token = settings.admin_token or settings.operator_token
    headers = {} if token is None else {"Authorization": f"Bearer {token.get_secret_value()}"}
    async with httpx.AsyncClient(base_url=server, headers=headers, timeout=REQUEST_S) as client:
        return await ScriptClient(script, client, lambda words: typer.echo(words, err=True)).run()


def _show(verdict: "Verdict") -> None:
    passed = "passed" if verdict.passed else "FAILED"
    table = Table("", "expected", "found", "", title=escape(f"{verdict.script}: {passed}"))
    for check in verdict.checks:
        mark = "ok" if check.passed else "NOT OK"
        table.add_row(escape(check.what), escape(check.expected), escape(str(check.found)), mark)
    Console().print(table)
