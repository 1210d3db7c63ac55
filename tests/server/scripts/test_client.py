"""The script's client against the real application, whose missions follow a script of their own."""

import json
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from server.scripts import client as module
from server.scripts.client import ScriptClient, ScriptFailed, Verdict
from server.scripts.script import Script
from tests.server.api.serving import Stage, client_of

BASE: dict[str, Any] = {
    "name": "smoke",
    "mission": {"scenario": "scripted", "llm": "none"},
    "until_s": 4.0,
    "patience_s": 600.0,
}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LOOK_S", 0.01)


class Unreliable(httpx.AsyncBaseTransport):
    """Passes requests on, but for those that a test makes fail."""

    def __init__(self, inner: httpx.AsyncBaseTransport, fails: Callable[[int], bool]) -> None:
        self._inner = inner
        self._fails = fails
        self.count = 0

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        self.count += 1
        answer = await self._inner.handle_async_request(request)
        if self._fails(self.count):
            raise httpx.ReadError("the answer was lost")
        return answer


async def flown(
    stage: Stage, script: dict[str, Any], fails: Callable[[int], bool] = lambda count: False
) -> tuple[Verdict, list[str]]:
    told: list[str] = []
    async with client_of(stage.app(), stage) as client:
        client._transport = Unreliable(client._transport, fails)
        chosen = Script.model_validate(BASE | script)
        verdict = await ScriptClient(chosen, client, told.append).run()
    return verdict, told


@pytest.mark.asyncio
async def test_it_flies_says_holds_and_judges() -> None:
    stage = Stage()
    actions = [
        {"at_s": 1.0, "say": "Look after target 122.", "expect": ["applied"]},
        {"at_s": 2.0, "do": "hold"},
        {"at_s": 2.0, "do": "resume"},
    ]
    verdict, told = await flown(stage, {"actions": actions})
    assert verdict.passed, verdict
    assert verdict.interruptions == 0
    assert [check.found for check in verdict.checks] == ["applied"]
    asked = [op for op, _ in stage.planners[0].requests]
    assert asked.count("hold") == asked.count("resume") == asked.count("comment") == 1
    assert any("hold" in words for words in told)


@pytest.mark.asyncio
async def test_a_pause_ends_when_its_own_script_says_so() -> None:
    """Mission time stands still meanwhile, and must not be what the resume waits for."""
    stage = Stage()
    actions = [{"at_s": 1.0, "do": "pause"}, {"at_s": 1.2, "do": "resume"}]
    verdict, told = await flown(stage, {"actions": actions, "until_s": 2.0})
    assert verdict.passed, verdict
    assert told[-2:] == ["1 s: pause", "1.2 s: resume"]
    asked = [op for op, _ in stage.planners[0].requests]
    assert asked.index("pause") < asked.index("resume")


@pytest.mark.asyncio
async def test_what_was_expected_and_not_found_fails_it() -> None:
    bounds = {"final": {"at_least": 2}, "nothing.there": {"at_most": 1}}
    actions = [{"at_s": 1.0, "say": "Hello.", "expect": ["declined"]}]
    verdict, _ = await flown(Stage(), {"expect": bounds, "actions": actions})
    assert not verdict.passed
    assert [check.passed for check in verdict.checks] == [False, False, False]


@pytest.mark.asyncio
async def test_lost_answers_are_asked_for_again_and_nothing_is_said_twice() -> None:
    stage = Stage()
    actions = [{"at_s": 1.0, "say": "Look after target 122.", "expect": ["applied"]}]
    verdict, told = await flown(stage, {"actions": actions}, lambda count: count % 4 == 0)
    assert verdict.passed, verdict
    assert verdict.interruptions > 0
    said = [params["text"] for op, params in stage.planners[0].requests if op == "comment"]
    assert said == ["Look after target 122."]
    assert "the server is back" in told


@pytest.mark.asyncio
async def test_a_planner_that_dies_is_started_again() -> None:
    stage = Stage()
    crashed: list[int] = []

    def crash_once(count: int) -> bool:
        if count == 12 and stage.planners and not crashed:
            stage.planners[0].crash()
            crashed.append(count)
        return False

    verdict, told = await flown(stage, {}, crash_once)
    assert crashed
    assert verdict.passed, verdict
    assert verdict.interruptions == 1
    assert any("started again" in words for words in told)
    assert len(stage.planners) == 2


class Losing(httpx.AsyncBaseTransport):
    """Tells of a lost robot in the first snapshots that are asked for."""

    def __init__(self, inner: httpx.AsyncBaseTransport, times: int) -> None:
        self._inner = inner
        self._times = times

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        answer = await self._inner.handle_async_request(request)
        if not request.url.path.endswith("/snapshot") or self._times <= 0:
            return answer
        self._times -= 1
        said = json.loads(await answer.aread())
        said["robots"][0]["link"] = "lost"
        return httpx.Response(answer.status_code, json=said)


@pytest.mark.asyncio
async def test_nobody_is_spoken_of_while_a_robot_is_lost() -> None:
    stage, told = Stage(), list[str]()
    actions = [{"at_s": 3.0, "say": "Look after target 122.", "expect": ["applied"]}]
    async with client_of(stage.app(), stage) as client:
        client._transport = Losing(client._transport, 20)
        script = Script.model_validate(BASE | {"actions": actions})
        verdict = await ScriptClient(script, client, told.append).run()
    assert verdict.passed, verdict
    assert verdict.interruptions == 1
    assert told.count("robots 21 are lost; waiting for them") == 1


class ComingBack(httpx.AsyncBaseTransport):
    """Tells of a held mission at first, which cannot be resumed yet."""

    def __init__(self, inner: httpx.AsyncBaseTransport, times: int) -> None:
        self._inner = inner
        self._times = times

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        answer = await self._inner.handle_async_request(request)
        if self._times <= 0:
            return answer
        if request.url.path.endswith("/m1/resume"):
            self._times -= 1
            error = {"code": "wrong_state", "message": "Mission m1 is held and cannot resume."}
            return httpx.Response(409, json={"error": error})
        said = json.loads(await answer.aread())
        if request.method == "GET" and said.get("state") == "running":
            said["state"] = "held"
        return httpx.Response(answer.status_code, json=said)


@pytest.mark.asyncio
async def test_a_mission_that_is_being_brought_up_is_waited_for_and_told_of_once() -> None:
    stage, told = Stage(), list[str]()
    async with client_of(stage.app(), stage) as client:
        client._transport = ComingBack(client._transport, 5)
        verdict = await ScriptClient(Script.model_validate(BASE), client, told.append).run()
    assert verdict.passed, verdict
    assert verdict.interruptions == 1
    assert told == [
        "mission m1 flies",
        "mission m1 came back held; it is resumed",
        "waiting: Mission m1 is held and cannot resume.",
    ]


@pytest.mark.asyncio
async def test_a_refusal_ends_it_in_words() -> None:
    with pytest.raises(ScriptFailed, match="No scenario elsewhere"):
        await flown(Stage(), {"mission": {"scenario": "elsewhere", "llm": "none"}})


@pytest.mark.asyncio
async def test_patience_ends() -> None:
    with pytest.raises(ScriptFailed, match=r"not done after 0\.5 s"):
        await flown(Stage(), {"patience_s": 0.5}, lambda count: True)
