import asyncio
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from llm.chat import ErrorKind, LanguageModel, ModelError
from llm.local.model import LocalModel
from llm.local.worker import MISSING, PACKAGE, missing, model_file
from llm.prompts import PromptStyle, PromptView, task_request
from tests.llm.builders import LIMITS, hardware
from tests.patience import PATIENCE_S

FAKE = str(Path(__file__).parent / "fake_worker.py")
VIEW = PromptView(hardware().snapshot(), LIMITS)


def model(way: str = "sound", **changes: float) -> LocalModel:
    return LocalModel(command=(sys.executable, FAKE, way), **changes)  # type: ignore[arg-type]


async def error_of(asked: LanguageModel) -> ModelError:
    with pytest.raises(ModelError) as caught:
        await asked.complete(task_request(VIEW), PATIENCE_S)
    return caught.value


def pid_of(asked: LocalModel) -> int:
    assert asked._process is not None
    return asked._process.pid


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.process
@pytest.mark.asyncio
async def test_the_worker_is_started_on_first_use_and_ends_with_the_model() -> None:
    told: list[str] = []
    async with model() as asked:
        asked.progress = told.append
        assert asked._process is None
        replies = await asyncio.gather(
            *(asked.complete(task_request(VIEW), PATIENCE_S) for _ in range(3))
        )
        pid = pid_of(asked)
        assert is_running(pid)
    assert len(told) == 2, "one start for all three"
    assert told[0].startswith("starting the embedded language model")
    assert all("21" in json.loads(reply.text)["assignment"] for reply in replies)
    assert not is_running(pid)


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_worker_that_died_is_started_again() -> None:
    async with model() as asked:
        await asked.complete(task_request(VIEW), PATIENCE_S)
        first = pid_of(asked)
        os.kill(first, signal.SIGKILL)
        assert asked._process is not None
        await asked._process.wait()
        await asked.complete(task_request(VIEW), PATIENCE_S)
        assert pid_of(asked) != first


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_worker_that_does_not_listen_is_killed() -> None:
    async with model("deaf", stop_timeout_s=0.1) as asked:
        await asked.complete(task_request(VIEW), PATIENCE_S)
        pid = pid_of(asked)
    assert not is_running(pid)


@pytest.mark.process
@pytest.mark.parametrize(
    ("way", "kind", "words"),
    [
        ("missing", ErrorKind.REJECTED, "is not installed"),
        ("mute", ErrorKind.CONNECTION, "ended while it was starting"),
        ("slow", ErrorKind.TIMEOUT, "did not start within 1 s"),
    ],
)
@pytest.mark.asyncio
async def test_workers_that_do_not_come_up(way: str, kind: ErrorKind, words: str) -> None:
    async with model(way, start_timeout_s=1.0 if way == "slow" else PATIENCE_S) as asked:
        error = await error_of(asked)
        assert error.kind is kind
        assert words in str(error)
        assert asked._process is None


@pytest.mark.asyncio
async def test_a_worker_that_cannot_even_be_started(tmp_path: Path) -> None:
    async with LocalModel(command=(str(tmp_path / "nowhere"),)) as asked:
        error = await error_of(asked)
        assert error.kind is ErrorKind.CONNECTION
        assert "cannot be started (FileNotFoundError)" in str(error)
        assert asked.breaker.failures == 1


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_start_is_cancelled_at_once() -> None:
    async with model("slow") as asked:
        call = asyncio.create_task(asked.complete(task_request(VIEW), PATIENCE_S))
        for _ in range(1000):
            if asked._process is not None:
                break
            await asyncio.sleep(0.01)
        pid = pid_of(asked)
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        assert not is_running(pid), "nobody waits for its start, which takes an hour"


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_worker_that_dies_in_the_midst_of_an_answer_says_so() -> None:
    async with model() as asked:
        await asked.complete(task_request(VIEW), PATIENCE_S)
        os.kill(pid_of(asked), signal.SIGSTOP)
        assert asked._client is not None
        call = asyncio.create_task(error_of(asked))
        for _ in range(10_000):
            if asked._client.usage.requests > 1:
                break
            await asyncio.sleep(0.01)
        os.kill(pid_of(asked), signal.SIGKILL)
        error = await call
        assert error.kind is ErrorKind.CONNECTION
        assert "process has ended (code -9)" in str(error)
        assert (await asked.complete(task_request(VIEW), PATIENCE_S)).text


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_worker_that_is_deaf_before_it_is_dead_counts_as_dead() -> None:
    async with model("lingering", stop_timeout_s=PATIENCE_S) as asked:
        error = await error_of(asked)
        assert "process has ended (code 1)" in str(error)
        assert asked.breaker.failures == 1


@pytest.mark.process
@pytest.mark.parametrize("way", ["mute", "dying"])
@pytest.mark.asyncio
async def test_a_worker_that_never_answers_is_not_started_for_ever(way: str) -> None:
    async with model(way, stop_timeout_s=PATIENCE_S) as asked:
        for _ in range(asked.breaker.threshold):
            assert (await error_of(asked)).kind is ErrorKind.CONNECTION
        assert (await error_of(asked)).kind is ErrorKind.CIRCUIT_OPEN


@pytest.mark.process
@pytest.mark.timeout(600)
@pytest.mark.asyncio
async def test_the_real_model_gives_a_well_formed_answer_and_steps_back() -> None:
    assert missing() is None, MISSING
    view = PromptView(hardware().snapshot(), LIMITS, style=PromptStyle.COMPACT)
    async with LocalModel(niceness=5) as asked:
        reply = await asked.complete(task_request(view), 500.0)
        ours = os.getpriority(os.PRIO_PROCESS, 0)
        assert os.getpriority(os.PRIO_PROCESS, pid_of(asked)) == min(ours + 5, 19)
    rows = json.loads(reply.text)["assignment"]
    assert set(rows) == {"21", "26"}
    assert all(set(row) <= {122, 124} and 1 <= len(row) <= 2 for row in rows.values())


@pytest.mark.process
def test_the_worker_says_what_is_missing_and_how_to_get_it() -> None:
    """Without any installed package: the worker itself needs none."""
    command = [sys.executable, "-S", "-m", "llm.local.worker", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert json.loads(done.stdout) == {"error": MISSING}
    assert done.returncode == 3
    assert "make setup-local" in MISSING


def test_the_model_is_found_without_importing_its_package() -> None:
    model_file()
    assert PACKAGE not in sys.modules
