"""Processes that wait for their work."""

import asyncio
import sys

import pytest

from server.live.standby import standby
from server.live.world import WorldHost

pytestmark = [pytest.mark.asyncio, pytest.mark.process, pytest.mark.timeout(60)]

ECHO = (sys.executable, "-c", "import sys; print(sys.stdin.readline().upper(), end='')")
ENDED = (sys.executable, "-c", "")


async def said(process: asyncio.subprocess.Process, words: str) -> str:
    """What a process answers to a line; it has ended then."""
    answer, _ = await process.communicate(words.encode())
    return answer.decode()


async def test_the_process_that_waits_is_taken_over_once() -> None:
    async with standby([ECHO]) as start:
        ready = await start.ready(ECHO)
        first, second, third = [await start(ECHO) for _ in range(3)]
        assert first is ready
        assert len({first.pid, second.pid, third.pid}) == 3
        assert [await said(second, "one\n"), await said(third, "two\n")] == ["ONE\n", "TWO\n"]
        first.kill()
        await first.wait()


async def test_another_command_or_environment_gets_a_process_of_its_own() -> None:
    async with standby([ECHO]) as start:
        other = await start(ECHO, {"LANG": "C"})
        another = await start(ENDED)
        waiting = await start(ECHO)
        assert len({other.pid, another.pid, waiting.pid}) == 3
        assert await said(other, "x\n") == await said(waiting, "x\n") == "X\n"
        assert await another.wait() == 0


async def test_a_process_that_has_ended_while_it_waited_is_not_handed_out() -> None:
    async with standby([]) as start:
        waiting = await start.ready(ENDED)
        await waiting.wait()
        fresh = await start(ENDED)
        assert fresh.pid != waiting.pid
        assert await fresh.wait() == 0


async def test_nobody_who_waits_outlives_the_block() -> None:
    async with standby([ECHO]) as start:
        waiting = await start.ready(ECHO)
    assert waiting.returncode is not None


async def test_a_world_takes_the_process_that_waits_for_it() -> None:
    answering = (
        sys.executable,
        "-c",
        "import sys; job = sys.stdin.readline(); print('ready', flush=True); sys.stdin.read()",
    )
    async with standby([]) as start:
        waiting = await start.ready(answering)
        world = WorldHost(answering, start=start)
        running = asyncio.create_task(world.run(lambda frame: None))
        await world.request("start", {"job": {}, "endpoint": "tcp/127.0.0.1:1"}, timeout_s=30.0)
        assert world.pid == waiting.pid
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    assert waiting.returncode is not None
