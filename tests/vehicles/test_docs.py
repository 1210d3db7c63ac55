"""The page on vehicles: its agent flies."""

import asyncio
import re
import sys
from pathlib import Path

import pytest

from solver.observations import Link
from solver.setpoints import Setpoint
from tests.patience import PATIENCE_S
from tests.vehicles.buses import KEYS, LOOPBACK
from tests.vehicles.test_sim_worker import Mission
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "guides" / "vehicles.md").read_text()


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
            async with mission.link, asyncio.timeout(PATIENCE_S):
                # It stands still while nobody sends it anything.
                while mission.speeds().get(21) != 0.0:
                    mission.observed.extend(mission.link.drain(0.0))
                    await asyncio.sleep(0.02)
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
