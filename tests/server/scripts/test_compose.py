"""What docker-compose.yml says, without an engine: its commands are ours, and they fly.

The services of the headless profile are run as plain processes with the very commands, settings
and restart policy that the file gives them; only names of hosts become ports of this machine. One
of them is killed in flight. On a real engine the same is proven by `make compose-test`.
"""

import asyncio
import json
import os
import re
import signal
import socket
import sys
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from server.cli import app
from tests.house.inventory import parse
from tests.server.waiting import eventually

FALCONER = (sys.executable, "-m", "server.cli")
SCRIPT = """
name: short
mission: {scenario: mixed, llm: endpoint, gate: auto, seed: 7}
until_s: 8.0
actions:
  - {at_s: 1.0, say: The Drone 21 should focus on tracking target 102.}
  - {at_s: 5.0, do: hold}
  - {at_s: 6.0, do: resume}
expect:
  min_separation_m: {at_least: 0.3}
  task_llm.valid: {at_least: 1}
  steps: {at_least: 30}
patience_s: 200
"""
VARIABLE = re.compile(r"\$\{\w+:-([^}]*)\}")


@pytest.fixture(scope="module")
def services(root: Path) -> dict[str, dict[str, Any]]:
    """The services, with the defaults of their variables."""
    text = (root / "docker-compose.yml").read_text("utf-8")
    found: dict[str, dict[str, Any]] = yaml.safe_load(VARIABLE.sub(r"\1", text))["services"]
    return found


def headless(services: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {name: each for name, each in services.items() if "headless" in each["profiles"]}


def test_every_service_runs_a_command_of_ours(services: dict[str, dict[str, Any]]) -> None:
    for service in services.values():
        parse(app, [str(word) for word in service["command"]])
        assert set(service["profiles"]) <= {"demo", "headless"}


def test_every_service_comes_back_but_the_script(services: dict[str, dict[str, Any]]) -> None:
    policies = {name: service["restart"] for name, service in services.items()}
    assert policies.pop("script") == "no"
    assert set(policies.values()) == {"unless-stopped"}


def test_services_wait_for_services_of_their_profile(services: dict[str, dict[str, Any]]) -> None:
    for service in services.values():
        for other in service.get("depends_on", {}):
            assert set(service["profiles"]) <= set(services[other]["profiles"])


def test_ports_are_this_machines_alone(services: dict[str, dict[str, Any]]) -> None:
    ports = [port for service in services.values() for port in service.get("ports", ())]
    assert ports == ["127.0.0.1:8000:8000"]


@dataclass
class Process:
    """A service as a process that comes back when it dies."""

    command: list[str]
    environment: dict[str, str]
    restarts: int = -1
    pid: int | None = None
    output: bytearray = field(default_factory=bytearray)

    async def run(self) -> int:
        """Run it once; return its exit code."""
        self.restarts += 1
        process = await asyncio.create_subprocess_exec(
            *FALCONER,
            *self.command,
            env=self.environment,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        self.pid = process.pid
        assert process.stdout is not None
        try:
            while said := await process.stdout.read(4096):
                self.output += said
            return await process.wait()
        finally:
            self.pid = None
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    async def keep(self) -> None:
        """Run it for ever, as `restart: unless-stopped` does."""
        while True:
            await self.run()
            await asyncio.sleep(0.2)


def ports(count: int) -> list[int]:
    """Return ports that nobody uses now."""
    taken = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    found = [each.getsockname()[1] for each in taken]
    for each in taken:
        each.close()
    return found


@asynccontextmanager
async def flying(
    services: dict[str, dict[str, Any]], folder: Path
) -> AsyncIterator[dict[str, Process]]:
    """Run the headless profile's services but for the script, which is returned with them."""
    bus, model, web = ports(3)
    (folder / "headless.yaml").write_text(SCRIPT)
    here = {
        "/scripts/": f"{folder}/",
        "sqlite:////data/": f"sqlite:///{folder}/",
        "router:7447": f"127.0.0.1:{bus}",
        "0.0.0.0:7447": f"127.0.0.1:{bus}",
        "mock-llm:8081": f"127.0.0.1:{model}",
        "8081": str(model),
        "server:8000": f"127.0.0.1:{web}",
        "0.0.0.0": "127.0.0.1",
    }

    def local(word: object) -> str:
        text = str(word)
        for there, instead in here.items():
            text = text.replace(there, instead)
        return text

    inherited = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    made = {}
    for name, service in headless(services).items():
        given = {key: local(value) for key, value in service.get("environment", {}).items()}
        environment = {**inherited, **given}
        if name == "server":
            environment["FALCONER_PORT"] = str(web)
        made[name] = Process([local(word) for word in service["command"]], environment)
    keepers = [asyncio.create_task(each.keep()) for n, each in made.items() if n != "script"]
    try:
        yield made
    finally:
        for keeper in keepers:
            keeper.cancel()
        await asyncio.gather(*keepers, return_exceptions=True)


@pytest.mark.process
@pytest.mark.asyncio
async def test_the_headless_profile_ends_with_its_verdict_though_its_server_dies(
    services: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    async with flying(services, tmp_path) as flown:
        script, server = flown["script"], flown["server"]
        scripted = asyncio.create_task(script.run())
        await eventually(lambda: b": said " in script.output or scripted.done(), within_s=150.0)
        assert server.pid is not None, bytes(server.output).decode()
        os.kill(server.pid, signal.SIGKILL)
        code = await scripted
        told = bytes(script.output).decode()
    assert code == 0, told
    verdict = json.loads(told[told.index("{") :])
    assert verdict["passed"]
    assert verdict["interruptions"] >= 1
    assert verdict["checks"][0]["what"] == "comment at 1 s"
    assert server.restarts == 1
    assert verdict["result"]["steps"] >= 30
