"""Throw generated requests at every route and hold the answers against the OpenAPI document.

    python -m benchmarks.fuzz [--examples 400] [--seed 1]

Schemathesis makes the requests, valid and invalid, and checks with all its checks. The
service is the real one with its real scenarios and journal; only processes are left out: a
mission's planner, its world and experiments are scripted, so that thousands of requests start
no swarm.
"""

import argparse
import asyncio
import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from unittest.mock import patch

import uvicorn
from pydantic import SecretStr

from server.api.access import Access
from server.api.app import create_app
from server.api.laboratory import Laboratory
from server.api.library import ScenarioLibrary
from server.api.web import web_config
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.settings import Settings
from tests.server.api.serving import StagedService
from tests.server.scripted import ScriptedHost

TOKEN: Final = "admin-of-the-fuzzing"

CONFIGURATION: Final = """
[checks.positive_data_acceptance]
# What fits the schema may still not fit the mission: no such scenario, not now, not any more.
expected-statuses = ["2xx", 401, 403, 404, 409, 413, 422, 429, 503]

[checks.negative_data_rejection]
# What does not fit may also be too long to be read at all.
expected-statuses = [400, 401, 403, 404, 405, 406, 409, 413, 415, 422, 428, 429]
"""


def _host(definition: object) -> ScriptedHost:
    return ScriptedHost(definition, period_s=0.2)  # type: ignore[arg-type]


class _Served(threading.Thread):
    """The application on a free port of 127.0.0.1, on an event loop of its own."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self._folder = folder
        self.started = threading.Event()
        self.port = 0
        self._server: uvicorn.Server | None = None

    def run(self) -> None:
        asyncio.run(self._serve())

    def stop(self) -> None:
        if self._server is not None:
            self._server.should_exit = True
        self.join(30.0)

    async def _serve(self) -> None:
        settings = Settings(
            port=0,
            recordings=self._folder / "recordings",
            admin_token=SecretStr(TOKEN),
            request_rate=1e6,
        )
        journal = DatabaseJournal(Store(f"sqlite:///{self._folder / 'journal.db'}"))
        service = StagedService(ScenarioLibrary(settings), _host, _host, journal)
        app = create_app(settings, service, door=Access(settings))
        server = self._server = uvicorn.Server(web_config(app, settings))
        serving = asyncio.create_task(server.serve())
        await _until_started(server, serving)
        with contextlib.suppress(IndexError):
            self.port = server.servers[0].sockets[0].getsockname()[1]
        self.started.set()
        await serving


async def _until_started(server: uvicorn.Server, serving: asyncio.Task[None]) -> None:
    """Wait until a server listens or has ended; it offers a flag and no event."""
    while not server.started:
        done, _ = await asyncio.wait({serving}, timeout=0.02)
        if done:
            return


@contextmanager
def served(folder: Path) -> Iterator[int]:
    """Serve the application for the time of the block; yield its port."""

    def laboratory(state: Path) -> Laboratory:
        return Laboratory(folder / "experiments", (sys.executable, "-c", "print('{}')"))

    with (
        patch("server.api.app.Laboratory", laboratory),
        # A busy machine's disk is no database that is gone.
        patch("server.journal.store.OPERATION_S", 60.0),
        patch("server.journal.database.COMMIT_S", 60.0),
    ):
        server = _Served(folder)
        server.start()
        try:
            if not server.started.wait(60.0) or not server.port:
                raise RuntimeError("the application did not start")
            yield server.port
        finally:
            server.stop()


def fuzz(examples: int, seed: int, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run schemathesis against a served application; return how it ended and what it said."""
    configuration = folder / "schemathesis.toml"
    configuration.write_text(CONFIGURATION, "utf-8")
    with served(folder) as port:
        command = [
            *(str(Path(sys.executable).with_name("schemathesis")), "--config-file"),
            *(str(configuration), "run", f"http://127.0.0.1:{port}/api/v1/openapi.json"),
            *("--checks", "all", "--max-examples", str(examples), "--seed", str(seed)),
            *("--request-timeout", "30", "--suppress-health-check", "all", "--no-color"),
            *("--header", f"Authorization: Bearer {TOKEN}", "--max-response-time", "60"),
            *("--generation-database", "none", "--warnings", "off"),
        ]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            cwd=folder,
            env=environment,
        )


def main() -> None:
    """Run the program; its exit code is schemathesis's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=400, help="Per operation and phase.")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with TemporaryDirectory(prefix="falconer-fuzz-") as folder:
        done = fuzz(chosen.examples, chosen.seed, Path(folder))
    print(done.stdout)
    print(done.stderr, file=sys.stderr)
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
