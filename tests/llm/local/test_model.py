import asyncio
import importlib.util
import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from llm.chat import ErrorKind, LanguageModel, ModelError
from llm.local.model import LocalModel
from llm.local.worker import MISSING, PACKAGE, model_file
from llm.prompts import PromptStyle, PromptView, task_request
from tests.llm.builders import LIMITS, hardware

FAKE = str(Path(__file__).parent / "fake_worker.py")
VIEW = PromptView(hardware().snapshot(), LIMITS)


def model(way: str = "sound", **changes: float) -> LocalModel:
    return LocalModel(command=(sys.executable, FAKE, way), **changes)  # type: ignore[arg-type]


async def error_of(asked: LanguageModel) -> ModelError:
    with pytest.raises(ModelError) as caught:
        await asked.complete(task_request(VIEW), 20.0)
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
            *(asked.complete(task_request(VIEW), 20.0) for _ in range(3))
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
        await asked.complete(task_request(VIEW), 20.0)
        first = pid_of(asked)
        os.kill(first, signal.SIGKILL)
        assert asked._process is not None
        await asked._process.wait()
        await asked.complete(task_request(VIEW), 20.0)
        assert pid_of(asked) != first


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_worker_that_does_not_listen_is_killed() -> None:
    async with model("deaf", stop_timeout_s=0.1) as asked:
        await asked.complete(task_request(VIEW), 20.0)
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
    async with model(way, start_timeout_s=1.0 if way == "slow" else 20.0) as asked:
        error = await error_of(asked)
        assert error.kind is kind
        assert words in str(error)
        assert asked._process is None


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_start_is_cancelled_at_once() -> None:
    async with model("slow") as asked:
        call = asyncio.create_task(asked.complete(task_request(VIEW), 20.0))
        for _ in range(1000):
            if asked._process is not None:
                break
            await asyncio.sleep(0.01)
        pid = pid_of(asked)
        started = time.perf_counter()
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        assert time.perf_counter() - started < 2.0
        assert not is_running(pid)


@pytest.mark.process
@pytest.mark.asyncio
async def test_the_real_worker_answers_or_says_what_is_missing() -> None:
    """With the packages of the embedded model: a well-formed answer. Without: which they are."""
    view = PromptView(hardware().snapshot(), LIMITS, style=PromptStyle.COMPACT)
    there = model_file() is not None and importlib.util.find_spec("xllamacpp") is not None
    async with LocalModel() as asked:
        if not there:
            error = await error_of(asked)
            assert str(error) == MISSING
            return
        reply = await asked.complete(task_request(view), 50.0)
    rows = json.loads(reply.text)["assignment"]
    assert set(rows) == {"21", "26"}
    assert all(set(row) <= {122, 124} and 1 <= len(row) <= 2 for row in rows.values())


def test_the_model_is_found_without_importing_its_package() -> None:
    model_file()
    assert PACKAGE not in sys.modules
