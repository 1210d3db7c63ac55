import asyncio
import threading
from dataclasses import replace
from typing import Any

import pytest

from llm.chat import ChatReply, ChatRequest
from llm.consultation import Accepted, Consultation, GivenUp, Outcome, consult_task
from llm.prompts import PromptView
from server.gate.decisions import Decision, Loop, Status
from server.live.consulting import ModelLoop, Pace
from server.loops import LoopClock
from solver.directives import Source
from solver.snapshot import Snapshot
from tests.llm.builders import LIMITS, hardware
from tests.server.waiting import eventually


class Sound:
    """Answers at once what is in force."""

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        return ChatReply('{"assignment": {"21": [122], "26": [124]}}', 10, 5, 0.1)


class Noted(Consultation):
    """Takes note of the threads it is worded and read in."""

    threads: list[int]

    def receive(self, reply: ChatReply, snapshot: Snapshot) -> Outcome:
        self.threads.append(threading.get_ident())
        return super().receive(reply, snapshot)


async def decided(consultation: Consultation, outcome: Accepted | GivenUp) -> Decision:
    return Decision("d1", "t1", Loop.TASK, Source.TASK_LLM, "task", 0.0, 0.0, Status.ADOPTED)


@pytest.mark.asyncio
async def test_an_answer_counts_as_valid_while_a_person_thinks_about_it() -> None:
    snapshot = hardware().snapshot()
    asked, word = asyncio.Event(), asyncio.Event()

    async def waiting(consultation: Consultation, outcome: Accepted | GivenUp) -> Decision:
        asked.set()
        await word.wait()
        return replace(await decided(consultation, outcome), status=Status.REFUSED)

    now = asyncio.get_running_loop().time
    loop = ModelLoop(
        Pace(LoopClock(60.0, now()), now),
        Loop.TASK,
        Sound(),
        8.0,
        lambda: lambda: consult_task(PromptView(snapshot, LIMITS), "t1"),
        lambda: snapshot,
        waiting,
        lambda *_: None,
    )
    flying = asyncio.Event()
    flying.set()
    running = asyncio.create_task(loop.run(flying))
    await asked.wait()
    meanwhile = loop.meter.report(now())
    assert (meanwhile.calls, meanwhile.success_rate) == (1, 1.0)
    assert meanwhile.age_s is not None
    assert meanwhile.adopted_rate is None
    word.set()
    await eventually(lambda: loop.tally.calls == 1)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert (loop.tally.valid, loop.tally.adopted) == (1, 0)
    after = loop.meter.report(now())
    assert (after.success_rate, after.adopted_rate) == (1.0, 0.0)


@pytest.mark.asyncio
async def test_words_are_made_and_read_beside_the_event_loop() -> None:
    """They take longer for a large team than a tick can spare."""
    snapshot, threads = hardware().snapshot(), list[int]()
    told: list[Any] = []

    def ask() -> Consultation:
        threads.append(threading.get_ident())
        call = consult_task(PromptView(snapshot, LIMITS), "t1")
        noted = Noted(call.loop, call.view, call.proposal_id, call.request)
        noted.threads = threads
        return noted

    now = asyncio.get_running_loop().time
    loop = ModelLoop(
        Pace(LoopClock(60.0, now()), now),
        Loop.TASK,
        Sound(),
        8.0,
        lambda: ask,
        lambda: snapshot,
        decided,
        lambda *words: told.append(words),
    )
    flying = asyncio.Event()
    flying.set()
    running = asyncio.create_task(loop.run(flying))
    await eventually(lambda: bool(told))
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert loop.tally.valid_first == 1
    assert len(threads) == 2
    assert threading.get_ident() not in threads
