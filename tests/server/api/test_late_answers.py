"""What a mission tells before it answers: the answer comes too late to undo it."""

from collections.abc import Mapping
from typing import Any

import pytest

from server.api.catalogue import Definition
from server.encoding import EventKind, MissionState, Severity
from tests.server.api.serving import Stage, client_of
from tests.server.api.test_missions import API, created
from tests.server.scripted import ScriptedHost


class Brief(ScriptedHost):
    """Flies a mission that is over before its start has been answered."""

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> dict[str, Any]:
        answer = await super().request(op, params, timeout_s=timeout_s)
        if op == "start":
            figures = {"scenario": "scripted"}
            self.event(EventKind.ENDED, Severity.INFO, "Its time is over.", result=figures)
        return answer


class BriefStage(Stage):
    def planner(self, definition: Definition) -> ScriptedHost:
        self.planners.append(Brief(definition, period_s=self.period_s))
        return self.planners[-1]


@pytest.mark.asyncio
async def test_a_mission_that_is_over_before_its_start_is_answered_has_ended() -> None:
    stage = BriefStage()
    async with client_of(stage.app(), stage) as client:
        mission = await created(client)
        started = await client.post(f"{API}/missions/{mission}/start")
        assert (started.json()["state"], started.json()["reason"]) == ("ended", "Its time is over.")
        assert stage.planners[0].state is MissionState.ENDED  # its process is gone
        result = await client.get(f"{API}/missions/{mission}/result")
        assert result.json() == {"scenario": "scripted"}
        assert (await client.delete(f"{API}/missions/{mission}")).status_code == 204


class Prompt(ScriptedHost):
    """Its models have answered a comment before whoever said it is told that it was received."""

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> dict[str, Any]:
        answer = await super().request(op, params, timeout_s=timeout_s)
        if op == "comment":
            self._answer(self.receipts[-1])
            self.say(self.time_s)
        return answer


class PromptStage(Stage):
    def planner(self, definition: Definition) -> ScriptedHost:
        self.planners.append(Prompt(definition, period_s=1000.0))
        return self.planners[-1]


@pytest.mark.asyncio
async def test_what_became_of_a_comment_is_not_undone_by_the_late_answer_to_who_said_it() -> None:
    """A server that was held up finds the answer and the pictures after it all at once."""
    stage = PromptStage()
    async with client_of(stage.app(), stage) as client:
        mission = await created(client)
        await client.post(f"{API}/missions/{mission}/start")
        said = await client.post(f"{API}/missions/{mission}/comments", json={"text": "Focus."})
        assert said.json()["status"] == "received"
        path = f"{API}/missions/{mission}/comments/{said.json()['id']}"
        assert (await client.get(path)).json()["status"] == "applied"
