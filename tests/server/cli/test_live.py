"""`falconer serve` and `falconer run` as people use them: links that are printed, Ctrl-C."""

import asyncio
import json
import os
import re
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from server.api.models import MissionRequest
from server.cli.site import is_over
from tests.patience import PATIENCE_S
from tests.server.api.serving import Stage

pytestmark = [pytest.mark.process]

LINK = re.compile(r"(http://127\.0\.0\.1:\d+)(/login\?key=\S+)")


async def started(
    folder: Path, *arguments: str, out: int = asyncio.subprocess.DEVNULL
) -> asyncio.subprocess.Process:
    """A command of falconer with a journal in this folder, and no settings but that."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "server.cli", *arguments, "--port", "0"),
        stdout=out,
        stderr=asyncio.subprocess.PIPE,
        env={**environment, "FALCONER_DATABASE_URL": f"sqlite:///{folder}/journal.db"},
    )


async def ended_by_ctrl_c(folder: Path, words: str, command: str) -> tuple[bytes, str]:
    """Press Ctrl-C when it says these words; return its output and all that it said.

    It must end in order.
    """
    arguments = (command, "ablation", "--llm", "none", *(("--json",) if command == "run" else ()))
    process = await started(folder, *arguments, out=asyncio.subprocess.PIPE)
    assert process.stderr is not None
    told = []
    try:
        async for line in process.stderr:
            told.append(line.decode())
            if words in told[-1]:
                break
        process.send_signal(signal.SIGINT)
        out, rest = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    said = "".join(told) + rest.decode()
    assert process.returncode == 0, said
    return out, said


@asynccontextmanager
async def serving(folder: Path) -> AsyncIterator[asyncio.StreamReader]:
    """A server without tokens or missions, on a free port; yields what it says."""
    process = await started(folder, "serve")
    assert process.stderr is not None
    try:
        yield process.stderr
    finally:
        process.terminate()
        await process.wait()


async def role_of(line: str) -> str:
    """Open the link in a line as a browser would; return who one is then."""
    found = LINK.search(line)
    assert found is not None, line
    async with httpx.AsyncClient(base_url=found[1], trust_env=False, timeout=PATIENCE_S) as browser:
        opened = await browser.get(found[2])
        assert (opened.status_code, opened.headers["location"]) == (303, "/")
        session = (await browser.get("/api/v1/session")).json()
        browser.cookies.clear()
        assert (await browser.get(found[2])).status_code == 401  # it works once
    role: str = session["role"]
    return role


@pytest.mark.asyncio
async def test_the_first_link_is_an_operators_and_the_second_an_admins(tmp_path: Path) -> None:
    async with serving(tmp_path) as said:
        lines = [(await said.readline()).decode() for _ in range(3)]
        assert lines[0].startswith("Open this link to steer")
        assert await role_of(lines[0]) == "operator"
        assert lines[1].startswith("Admin, to make and remove missions as well")
        assert await role_of(lines[1]) == "admin"
        assert lines[2].startswith("Falconer on http://127.0.0.1:")


@pytest.mark.asyncio
async def test_ctrl_c_ends_a_live_run_with_the_figures_so_far(tmp_path: Path) -> None:
    out, said = await ended_by_ctrl_c(tmp_path, "mission started", "run")
    figures = json.loads(out)
    assert figures["scenario"] == "ablation"
    assert 0 <= figures["steps"] < 300
    assert "no figures" not in said


@pytest.mark.asyncio
async def test_ctrl_c_while_the_mission_starts_is_no_failure(tmp_path: Path) -> None:
    _, said = await ended_by_ctrl_c(tmp_path, "starting ablation", "serve")
    assert "could not be started" not in said


@pytest.mark.asyncio
async def test_a_mission_that_was_stopped_and_removed_at_once_is_over() -> None:
    stage = Stage()
    async with stage.service as service:
        mission = (await service.create(MissionRequest(scenario="scripted"), "test")).id
        await service.start(mission, "test")
        assert not is_over(service, mission)
        await service.stop(mission, "test")
        assert is_over(service, mission)
        await service.delete(mission, "test")
        assert is_over(service, mission)
