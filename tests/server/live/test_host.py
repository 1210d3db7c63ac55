import asyncio
import os
import signal
import sys
import textwrap

import pytest

from server.live.channel import ChannelClosed, RequestTimeout
from server.live.host import ProcessHost
from server.live.outbox import Frame
from server.live.world import WorldHost
from tests.patience import PATIENCE_S
from tests.server.waiting import eventually

pytestmark = pytest.mark.process

CHILD = """
    import json, sys
    print(json.dumps({"push": {"type": "event", "seq": 1}}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        if request["op"] == "exit":
            sys.exit(request["params"]["code"])
        if request["op"] != "ignore":
            print(json.dumps({"id": request["id"], "ok": request["params"]}), flush=True)
"""

STUBBORN = """
    import signal, time
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    print('{"push": {"type": "event"}}', flush=True)
    time.sleep(1000)
"""


def host(source: str, *, grace_s: float = 3.0) -> ProcessHost:
    return ProcessHost((sys.executable, "-c", textwrap.dedent(source)), grace_s=grace_s)


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.asyncio
async def test_a_process_answers_pushes_and_ends_with_its_code() -> None:
    got: list[Frame] = []
    child = host(CHILD)
    running = asyncio.create_task(child.run(got.append))
    assert await child.request("echo", {"text": "hä"}, timeout_s=PATIENCE_S) == {"text": "hä"}
    assert got[0].data == {"type": "event", "seq": 1}
    with pytest.raises(ChannelClosed):
        await child.request("exit", {"code": 7}, timeout_s=PATIENCE_S)
    assert await running == 7
    with pytest.raises(ChannelClosed):
        await child.request("echo")


@pytest.mark.asyncio
async def test_cancelling_ends_the_process_by_end_of_file() -> None:
    child = host(CHILD, grace_s=20.0)
    running = asyncio.create_task(child.run(lambda frame: None))
    await child.request("echo", timeout_s=PATIENCE_S)
    pid = child.pid
    assert pid is not None
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert gone(pid)


@pytest.mark.asyncio
async def test_a_process_that_ignores_everything_is_killed() -> None:
    started = asyncio.Event()
    child = host(STUBBORN, grace_s=0.05)
    running = asyncio.create_task(child.run(lambda frame: started.set()))
    await started.wait()
    pid = child.pid
    assert pid is not None
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert gone(pid)


@pytest.mark.asyncio
async def test_cancelling_twice_still_waits_for_the_end() -> None:
    child = host(CHILD, grace_s=20.0)
    running = asyncio.create_task(child.run(lambda frame: None))
    await child.request("echo", timeout_s=PATIENCE_S)
    pid = child.pid
    assert pid is not None
    for _ in range(3):
        running.cancel()
        await asyncio.sleep(0)
    with pytest.raises(asyncio.CancelledError):
        await running
    assert gone(pid)


@pytest.mark.asyncio
async def test_a_killed_process_fails_what_is_pending() -> None:
    child = host(CHILD)
    running = asyncio.create_task(child.run(lambda frame: None))
    await child.request("echo", timeout_s=PATIENCE_S)
    pending = asyncio.create_task(child.request("ignore", timeout_s=PATIENCE_S))
    await asyncio.sleep(0)
    assert child.pid is not None
    os.kill(child.pid, signal.SIGKILL)
    with pytest.raises(ChannelClosed):
        await pending
    assert await running == -signal.SIGKILL


@pytest.mark.asyncio
async def test_a_process_that_never_starts_times_out() -> None:
    child = host(CHILD)  # nobody runs it
    with pytest.raises(RequestTimeout, match="did not start"):
        await child.request("echo", timeout_s=0.02)


@pytest.mark.asyncio
async def test_no_child_outlives_a_killed_parent() -> None:
    """The parent is a process of its own, killed with SIGKILL; the child reads end of file."""
    parent = """
        import asyncio, sys
        from server.live.host import ProcessHost
        async def main():
            child = ProcessHost((sys.executable, "-c", sys.argv[1]))
            running = asyncio.create_task(child.run(lambda frame: None))
            await child.request("echo", timeout_s=20.0)
            print(child.pid, flush=True)
            await running
        asyncio.run(main())
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        textwrap.dedent(parent),
        textwrap.dedent(CHILD),
        stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    pid = int(await process.stdout.readline())
    assert not gone(pid)
    process.kill()
    await process.wait()
    await eventually(lambda: gone(pid))


@pytest.mark.asyncio
@pytest.mark.parametrize("made", [ProcessHost, WorldHost])
async def test_a_command_that_is_not_there_is_told_at_once(
    made: type[ProcessHost | WorldHost],
) -> None:
    child = made(("/no/such/command",))
    running = asyncio.create_task(child.run(lambda frame: None))
    asked = {"job": {}, "endpoint": "tcp/127.0.0.1:7"}
    async with asyncio.timeout(PATIENCE_S):
        with pytest.raises(ChannelClosed):
            await child.request("start", asked, timeout_s=2.0 * PATIENCE_S)
        with pytest.raises(OSError, match="no/such"):
            await running
