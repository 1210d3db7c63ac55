"""The page on vehicles: its agent flies, its access rules let one robot speak for itself only."""

import asyncio
import re
import sys
from pathlib import Path

import pytest

from solver.observations import Link
from solver.setpoints import Setpoint
from tests.vehicles.buses import KEYS, LOOPBACK, Reader, reaches, until
from tests.vehicles.test_sim_worker import Mission
from vehicles.keys import Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "vehicles.md").read_text()


def block(language: str) -> str:
    """Return the page's only code block in a language."""
    (text,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(text)


@pytest.mark.process
@pytest.mark.asyncio
async def test_the_agent_in_thirty_lines_flies_and_stops(tmp_path: Path) -> None:
    program = tmp_path / "agent.py"
    program.write_text(block("python"))
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))
    async with ZenohBus(router, KEYS.delivery) as bus:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            str(program),
            bus.endpoints[0],
            "red",
            "21",
            env={"PYTHONPATH": str(ROOT)},
        )
        mission = Mission(bus, "p1")
        try:
            async with mission.link, asyncio.timeout(20.0):
                while mission.speeds().get(21) != 0.0:
                    await mission.tick()
                while mission.speeds().get(21) != 0.5:
                    mission.link.send_setpoints(
                        (Setpoint(21, (0.0, 0.5), (0.0, 0.0), 1.0, 0.3),), "m1"
                    )
                    await mission.tick()
                assert mission.links()[21] is Link.CONNECTED
                while mission.speeds()[21] != 0.0:
                    mission.observed.extend(mission.link.drain(0.0))
                    await asyncio.sleep(0.02)
        finally:
            process.kill()
            await process.wait()


@pytest.mark.asyncio
async def test_the_access_rules_let_a_robot_speak_for_itself_only(tmp_path: Path) -> None:
    rules, users = tmp_path / "zenoh.json5", tmp_path / "users.txt"
    rules.write_text(block("json5"))
    users.write_text("planner:mission\nrobot21:falcon\n")
    router = ZenohSettings(
        mode=ZenohMode.ROUTER,
        listen=(LOOPBACK,),
        user="planner",
        password="mission",
        dictionary_file=str(users),
        config_file=str(rules),
    )
    states, setpoints, tokens = Reader(), Reader(), Reader()
    async with ZenohBus(router, KEYS.delivery) as mission:
        await mission.subscribe(KEYS.robot(None, Topic.STATE), states.inbox)
        await mission.watch(KEYS.alive(None), tokens.inbox)
        client = ZenohSettings(connect=mission.endpoints, user="robot21", password="falcon")
        async with ZenohBus(client, KEYS.delivery) as vehicle:
            await vehicle.announce(KEYS.alive(21))
            await vehicle.announce(KEYS.alive(26))
            await vehicle.subscribe(KEYS.robot(None, Topic.SETPOINT), setpoints.inbox)
            await vehicle.subscribe(KEYS.robot(21, Topic.SETPOINT), setpoints.inbox)
            vehicle.publish(KEYS.robot(26, Topic.STATE), b"not mine")
            await reaches(vehicle, states, KEYS.robot(21, Topic.STATE))
            await reaches(mission, setpoints, KEYS.robot(21, Topic.SETPOINT))
            mission.publish(KEYS.robot(26, Topic.SETPOINT), b"not for 21")
            await reaches(mission, setpoints, KEYS.robot(21, Topic.SETPOINT))
            await until(lambda: tokens.take())
        assert {sample.key for sample in states.take()} == {KEYS.robot(21, Topic.STATE)}
        assert {sample.key for sample in setpoints.take()} == {KEYS.robot(21, Topic.SETPOINT)}
        assert {sample.key for sample in tokens.take()} == {KEYS.alive(21)}
