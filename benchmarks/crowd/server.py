"""The server under the crowd: started as people start it, and looked at from outside."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import httpx
from prometheus_client.parser import text_string_to_metric_families

from benchmarks.fleet import FALCONER, Fleet, Running, free_port
from benchmarks.product import memory_mib

TOKEN: Final = "operator-of-the-crowd"
HEADERS: Final = {"authorization": f"Bearer {TOKEN}"}
MISSION: Final = "m1"
START_S: Final = 180.0
"""A first start compiles the optimizer's kernels."""

LOOK_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class Cost:
    """What the server's processes hold at one moment."""

    memory_mib: float
    """Proportional set size of all of them."""

    web_mib: float
    """Resident in the web process alone, which is the one that serves clients."""

    mission_mib: float
    """Resident in the mission's process."""

    handles: int
    """Open files and sockets of the web process."""

    tasks: int
    """Asyncio tasks of the web process."""

    streams: int
    """Readers of the mission's stream, the console's own among them."""


@dataclass(frozen=True, slots=True)
class Server:
    """One `falconer run` with its mission in the air."""

    process: Running
    http: httpx.AsyncClient
    port: int

    @property
    def address(self) -> str:
        """Host and port."""
        return f"127.0.0.1:{self.port}"

    async def optimizer(self) -> dict[str, Any]:
        """Return the optimizer's loop as the newest snapshot tells of it."""
        path = f"/api/v1/missions/{MISSION}/snapshot"
        said: dict[str, Any] = (await self.http.get(path)).raise_for_status().json()
        return {**said["loops"]["optimizer"], "tick": said["tick"]}

    async def cost(self) -> Cost:
        """Return what its processes hold now."""
        text = (await self.http.get("/metrics")).raise_for_status().text
        found = {
            (sample.name, sample.labels.get("process", "")): sample.value
            for family in text_string_to_metric_families(text)
            for sample in family.samples
        }
        pid = self.process.process.pid
        return Cost(
            memory_mib=memory_mib(self.process),
            web_mib=found["falconer_process_resident_bytes", "web"] / 2**20,
            mission_mib=found.get(("falconer_process_resident_bytes", "mission"), 0.0) / 2**20,
            handles=_handles(pid),
            tasks=int(found["falconer_process_tasks", "web"]),
            streams=int(found["falconer_stream_clients", ""]),
        )


@asynccontextmanager
async def flying(scenario: str, folder: Path, options: tuple[str, ...]) -> AsyncIterator[Server]:
    """Fly a scenario with the console until the block ends."""
    port = free_port()
    environment: Mapping[str, str] = {
        "FALCONER_OPERATOR_TOKEN": TOKEN,
        "FALCONER_DATABASE_URL": f"sqlite:///{folder}/journal.db",
    }
    command = (*FALCONER, "run", scenario, "--port", str(port), *options)
    async with (
        Fleet() as fleet,
        httpx.AsyncClient(
            base_url=f"http://127.0.0.1:{port}", headers=HEADERS, timeout=30.0, trust_env=False
        ) as http,
    ):
        process = await fleet.start("falconer", command, environment=environment)
        await process.until_said("Falconer on", START_S)
        server = Server(process, http, port)
        await _until_flying(server)
        yield server


def _handles(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


async def _until_flying(server: Server) -> None:
    """Wait for the first ticks. Raises TimeoutError when there are none."""
    async with asyncio.timeout(START_S):
        while True:
            with suppress(httpx.HTTPError):
                if (await server.optimizer())["tick"] > 0:
                    return
            await asyncio.sleep(LOOK_S)
