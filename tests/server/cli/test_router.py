"""`falconer router`: a process between planner and vehicles that either end can outlive."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.vehicles.buses import Reader, reaches, until
from vehicles.inbox import SampleKind
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

KEYS = TeamKeys("hall")
COMMAND = (sys.executable, "-m", "server.cli", "router", "hardware")
pytestmark = pytest.mark.process


def environment(**extra: str) -> dict[str, str]:
    own = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    return own | extra


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
    return port


async def started(endpoint: str) -> asyncio.subprocess.Process:
    process = await asyncio.create_subprocess_exec(
        *COMMAND, "--listen", endpoint, stderr=asyncio.subprocess.PIPE, env=environment()
    )
    assert process.stderr is not None
    async with asyncio.timeout(PATIENCE_S):
        line = (await process.stderr.readline()).decode()
    assert line.startswith(f"routing for team hall at {endpoint}, open to all"), line
    return process


@pytest.mark.asyncio
async def test_planner_and_vehicle_come_back_by_themselves_when_the_router_is_killed() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = await started(endpoint)
    states, tokens, setpoints = Reader(), Reader(), Reader()
    client = ZenohSettings(connect=(endpoint,))
    state, setpoint = KEYS.robot(21, Topic.STATE), KEYS.robot(21, Topic.SETPOINT)
    try:
        async with ZenohBus(client, KEYS.delivery) as planner:
            await planner.subscribe(KEYS.robot(None, Topic.STATE), states.inbox)
            await planner.watch(KEYS.alive(None), tokens.inbox)
            async with ZenohBus(client, KEYS.delivery) as vehicle:
                await vehicle.subscribe(setpoint, setpoints.inbox)
                await vehicle.announce(KEYS.alive(21))
                await reaches(vehicle, states, state)
                await reaches(planner, setpoints, setpoint)
                await until(lambda: tokens.take())
                router.kill()
                await router.wait()
                await until(lambda: tokens.take()[-1].kind is SampleKind.DELETE)
                vehicle.publish(state, b"nobody hears this, and nothing breaks")
                router = await started(endpoint)
                states.samples.clear()
                setpoints.samples.clear()
                await reaches(vehicle, states, state)
                await reaches(planner, setpoints, setpoint)
                await until(lambda: tokens.take()[-1].kind is SampleKind.PUT)
        router.send_signal(signal.SIGINT)
        async with asyncio.timeout(PATIENCE_S):
            assert await router.wait() == 0
    finally:
        if router.returncode is None:
            router.kill()
            await router.wait()


def run(*arguments: str, **extra: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=environment(**extra),
        check=False,
    )


def test_its_configuration_is_shown_with_the_rules_and_without_the_password(
    tmp_path: Path,
) -> None:
    users = tmp_path / "users.txt"
    users.write_text("robot21:falcon\n")
    secrets = {"FALCONER_ZENOH_USER": "planner", "FALCONER_ZENOH_PASSWORD": "hush-hush"}
    shown = run("--show", FALCONER_ZENOH_USERS_FILE=str(users), **secrets)
    assert shown.returncode == 0, shown.stderr
    values = json.loads(shown.stdout)
    assert values["mode"] == "router"
    assert values["listen"]["endpoints"] == ["tcp/127.0.0.1:7447"]
    assert values["access_control"]["default_permission"] == "deny"
    subjects = {subject["id"] for subject in values["access_control"]["subjects"]}
    assert subjects == {"robot21", "robot26", "planner", "operator", "world", "site"}
    assert "hush-hush" not in shown.stdout


def test_a_taken_port_ends_it_in_one_sentence() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        ended = run("--listen", f"tcp/127.0.0.1:{taken.getsockname()[1]}")
    assert ended.returncode == 2
    assert ended.stderr.startswith("falconer: cannot listen on tcp/127.0.0.1:")
    assert len(ended.stderr.splitlines()) == 1
