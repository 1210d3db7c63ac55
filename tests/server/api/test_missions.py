import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any

import httpx
import pytest
import pytest_asyncio

from server.api.models import MAX_COMMENT_CHARACTERS
from tests.patience import PATIENCE_S
from tests.server.api.serving import Stage, client_of

API = "/api/v1"


@pytest.fixture
def stage() -> Stage:
    return Stage()


@pytest_asyncio.fixture
async def client(stage: Stage) -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(stage.app(), stage) as client:
        yield client


async def created(client: httpx.AsyncClient, **body: Any) -> str:
    answer = await client.post(f"{API}/missions", json={"scenario": "scripted"} | body)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


async def flying(client: httpx.AsyncClient, **body: Any) -> str:
    mission = await created(client, **body)
    answer = await client.post(f"{API}/missions/{mission}/start")
    assert answer.status_code == 200, answer.text
    await until(client, f"/missions/{mission}/snapshot", lambda s: "tick" in s)
    return mission


async def until(
    client: httpx.AsyncClient, path: str, condition: Callable[[dict[str, Any]], bool]
) -> dict[str, Any]:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            answer: dict[str, Any] = (await client.get(f"{API}{path}")).json()
            if condition(answer):
                return answer
            await asyncio.sleep(0.01)


def in_state(state: str) -> Callable[[dict[str, Any]], bool]:
    return lambda said: said.get("state") == state


def refused(answer: httpx.Response, status: int, code: str) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    error: dict[str, Any] = answer.json()["error"]
    assert set(error) == {"code", "message", "details"}
    assert error["code"] == code
    assert error["message"]
    return error


@pytest.mark.asyncio
async def test_the_catalogue_is_listed(client: httpx.AsyncClient) -> None:
    scenarios = (await client.get(f"{API}/scenarios")).json()
    assert scenarios == [
        {"name": "scripted", "description": "A script.", "robots": 4, "targets": 6, "zones": 3}
    ]
    profiles = (await client.get(f"{API}/llm-profiles")).json()
    assert [profile["name"] for profile in profiles] == ["none", "mock"]


@pytest.mark.asyncio
async def test_a_mission_is_created_but_not_started(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    answer = await client.post(f"{API}/missions", json={"scenario": "scripted", "seed": 7})
    mission = answer.json()
    assert mission["id"] == "m1"
    assert mission["state"] == "created"
    assert mission["seed"] == 7
    assert mission["clock"] == "realtime"
    assert mission["llm"] == "mock"
    assert mission["time_s"] is None
    assert mission["started_at"] is None
    assert stage.planners == []
    assert (await client.get(f"{API}/missions")).json() == [mission]
    assert (await client.get(f"{API}/missions/m1")).json() == mission


@pytest.mark.asyncio
async def test_starting_gives_world_and_planner_their_parameters(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    await flying(client)
    endpoint = "tcp/127.0.0.1:7"
    job = {"mission": "m1", "job": {"p": 1}, "endpoint": None, "decisions": 0}
    assert stage.planners[0].requests == [("prepare", job), ("start", {})]
    assert stage.worlds[0].requests == [("start", {"job": {"w": 1}, "endpoint": endpoint})]


@pytest.mark.asyncio
async def test_starting_twice_starts_once(client: httpx.AsyncClient, stage: Stage) -> None:
    mission = await flying(client)
    again = await client.post(f"{API}/missions/{mission}/start")
    assert again.json()["state"] == "running"
    assert len(stage.planners) == 1


@pytest.mark.asyncio
async def test_one_server_flies_one_mission(client: httpx.AsyncClient) -> None:
    await flying(client)
    second = await created(client)
    error = refused(await client.post(f"{API}/missions/{second}/start"), 409, "mission_live")
    assert error["details"] == {"live_mission": "m1"}
    await client.post(f"{API}/missions/m1/stop")
    assert (await client.post(f"{API}/missions/{second}/start")).status_code == 200


@pytest.mark.asyncio
async def test_hold_pause_and_resume_change_the_state(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    mission = await flying(client)
    for op, state in (("hold", "held"), ("resume", "running"), ("pause", "paused")):
        answer = await client.post(f"{API}/missions/{mission}/{op}")
        assert answer.json()["state"] == state
        assert stage.planners[0].requests[-1] == (op, {"author": "operator"})
        await until(client, f"/missions/{mission}/snapshot", in_state(state))


@pytest.mark.asyncio
@pytest.mark.parametrize("op", ["hold", "pause", "resume"])
async def test_a_mission_that_does_not_fly_cannot_be_steered(
    client: httpx.AsyncClient, op: str
) -> None:
    mission = await created(client)
    error = refused(await client.post(f"{API}/missions/{mission}/{op}"), 409, "wrong_state")
    assert error["details"] == {"state": "created"}


@pytest.mark.asyncio
async def test_stopping_keeps_the_figures_and_ends_for_good(client: httpx.AsyncClient) -> None:
    mission = await flying(client)
    assert (await client.post(f"{API}/missions/{mission}/stop")).json()["state"] == "ended"
    assert (await client.post(f"{API}/missions/{mission}/stop")).json()["state"] == "ended"
    assert (await client.get(f"{API}/missions/{mission}/result")).json()["final"] is True
    refused(await client.post(f"{API}/missions/{mission}/start"), 409, "wrong_state")
    refused(await client.post(f"{API}/missions/{mission}/hold"), 409, "wrong_state")
    snapshot = (await client.get(f"{API}/missions/{mission}/snapshot")).json()
    assert snapshot["state"] == "ended"


@pytest.mark.asyncio
async def test_figures_can_be_asked_for_in_flight(client: httpx.AsyncClient) -> None:
    mission = await created(client)
    refused(await client.get(f"{API}/missions/{mission}/result"), 409, "no_result")
    await client.post(f"{API}/missions/{mission}/start")
    assert (await client.get(f"{API}/missions/{mission}/result")).json()["final"] is False


@pytest.mark.asyncio
async def test_a_live_mission_cannot_be_deleted(client: httpx.AsyncClient) -> None:
    mission = await flying(client)
    refused(await client.delete(f"{API}/missions/{mission}"), 409, "wrong_state")
    await client.post(f"{API}/missions/{mission}/stop")
    assert (await client.delete(f"{API}/missions/{mission}")).status_code == 204
    refused(await client.get(f"{API}/missions/{mission}"), 404, "mission_unknown")


@pytest.mark.asyncio
async def test_a_process_that_dies_fails_the_mission_and_can_be_started_again(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    mission = await flying(client)
    stage.planners[0].crash()
    failed = await until(client, f"/missions/{mission}", lambda m: m["state"] == "failed")
    assert "planner process" in failed["reason"]
    events = (await client.get(f"{API}/missions/{mission}/events")).json()["events"]
    assert events[-1]["kind"] == "alarm"
    assert events[-1]["severity"] == "alarm"
    assert (await client.get(f"{API}/missions/{mission}/snapshot")).json()["state"] == "failed"
    refused(await client.post(f"{API}/missions/{mission}/hold"), 409, "wrong_state")
    again = await client.post(f"{API}/missions/{mission}/start")
    assert again.json()["state"] == "running"
    assert len(stage.planners) == 2
    assert stage.planners[1].requests[0][1]["endpoint"] == "tcp/127.0.0.1:7"
    assert len(stage.worlds) == 1  # the world went on, its vehicles held


@pytest.mark.asyncio
async def test_a_world_that_dies_is_an_alarm_in_plain_words(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    mission = await flying(client)
    stage.worlds[0].crash()
    path = f"/missions/{mission}/alarms"
    told = await until(client, path, lambda page: bool(page["alarms"]))
    (alarm,) = told["alarms"]
    assert (alarm["id"], alarm["title"]) == ("world", "The simulated world has ended")
    assert "simulated world process" in alarm["text"]
    assert (await client.get(f"{API}/missions/{mission}")).json()["state"] == "running"


@pytest.mark.asyncio
async def test_a_start_that_fails_is_told_and_leaves_the_server_free(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    stage.fail_start = True
    mission = await created(client)
    refused(await client.post(f"{API}/missions/{mission}/start"), 503, "start_failed")
    assert (await client.get(f"{API}/missions/{mission}")).json()["state"] == "failed"
    stage.fail_start = False
    await flying(client)


@pytest.mark.asyncio
async def test_a_snapshot_needs_a_flight(client: httpx.AsyncClient) -> None:
    mission = await created(client)
    refused(await client.get(f"{API}/missions/{mission}/snapshot"), 409, "no_snapshot")


@pytest.mark.asyncio
async def test_events_are_numbered_and_come_in_pages(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    mission = await flying(client)
    for _ in range(3):
        await client.post(f"{API}/missions/{mission}/hold")
    first = (await client.get(f"{API}/missions/{mission}/events?limit=2")).json()
    assert [event["seq"] for event in first["events"]] == [1, 2]
    rest = (await client.get(f"{API}/missions/{mission}/events?after={first['next_after']}")).json()
    assert [event["seq"] for event in rest["events"]] == [3]
    none = (await client.get(f"{API}/missions/{mission}/events?after=3")).json()
    assert none == {"events": [], "next_after": 3}


@pytest.mark.asyncio
async def test_a_comment_gets_a_receipt_that_goes_to_applied(client: httpx.AsyncClient) -> None:
    mission = await flying(client)
    text = "The Drone 21 should focus on tracking target 122."
    answer = await client.post(f"{API}/missions/{mission}/comments", json={"text": text})
    assert answer.status_code == 201
    comment = answer.json()
    assert comment["status"] == "received"
    assert comment["text"] == text
    assert comment["author"] == "operator"
    path = f"/missions/{mission}/comments/{comment['id']}"
    applied = await until(client, path, lambda c: c["status"] == "applied")
    assert applied["task"]["verdict"] == "applied"
    assert "122" in applied["task"]["reason"]
    assert (await client.get(f"{API}/missions/{mission}/comments")).json() == [applied]


@pytest.mark.asyncio
async def test_a_comment_is_trimmed_and_bounded(client: httpx.AsyncClient, stage: Stage) -> None:
    mission = await flying(client)
    path = f"{API}/missions/{mission}/comments"
    longest = "ü" * MAX_COMMENT_CHARACTERS
    assert (await client.post(path, json={"text": f"  {longest}  "})).json()["text"] == longest
    for text in (longest + "x", "", "   "):
        error = refused(await client.post(path, json={"text": text}), 422, "invalid_request")
        assert error["details"]["problems"][0]["field"] == "body.text"
    assert [op for op, _ in stage.planners[0].requests].count("comment") == 1


@pytest.mark.asyncio
async def test_too_many_comments_are_refused(client: httpx.AsyncClient) -> None:
    mission = await flying(client)
    path = f"{API}/missions/{mission}/comments"
    for _ in range(32):
        assert (await client.post(path, json={"text": "again"})).status_code == 201
    refused(await client.post(path, json={"text": "again"}), 429, "too_many_comments")


@pytest.mark.asyncio
async def test_unknown_missions_and_comments_are_told(client: httpx.AsyncClient) -> None:
    mission = await flying(client)
    text = {"text": "hello"}
    refused(await client.post(f"{API}/missions/m99/comments", json=text), 404, "mission_unknown")
    refused(await client.get(f"{API}/missions/m99/events"), 404, "mission_unknown")
    refused(await client.get(f"{API}/missions/{mission}/comments/c9"), 404, "comment_unknown")


@pytest.mark.asyncio
async def test_a_comment_for_a_mission_that_does_not_fly_is_refused(
    client: httpx.AsyncClient,
) -> None:
    mission = await created(client)
    answer = await client.post(f"{API}/missions/{mission}/comments", json={"text": "hello"})
    refused(answer, 409, "wrong_state")


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, "body.scenario"),
        ({"scenario": "scripted", "seeds": 1}, "body.seeds"),
        ({"scenario": "scripted", "seed": -1}, "body.seed"),
        ({"scenario": "scripted", "seed": 1e300}, "body.seed"),
        ({"scenario": "scripted", "clock": "sidereal"}, "body.clock"),
        ({"scenario": "../../etc/passwd"}, "body.scenario"),
        ({"scenario": "scripted", "llm": "http://evil.example/v1"}, "body.llm"),
        ([], "body"),
    ],
)
async def test_bad_missions_name_the_field(
    client: httpx.AsyncClient, body: Any, field: str
) -> None:
    answer = await client.post(f"{API}/missions", json=body)
    error = refused(answer, 422, "invalid_request")
    assert any(problem["field"].startswith(field) for problem in error["details"]["problems"])
    assert (await client.get(f"{API}/missions")).json() == []


@pytest.mark.asyncio
async def test_an_unknown_scenario_is_told(client: httpx.AsyncClient) -> None:
    answer = await client.post(f"{API}/missions", json={"scenario": "nowhere"})
    refused(answer, 422, "scenario_unknown")


@pytest.mark.asyncio
async def test_missions_are_bounded(client: httpx.AsyncClient) -> None:
    for _ in range(100):
        await created(client)
    answer = await client.post(f"{API}/missions", json={"scenario": "scripted"})
    refused(answer, 409, "too_many_missions")


@pytest.mark.asyncio
async def test_leaving_the_service_ends_every_process(stage: Stage) -> None:
    async with client_of(stage.app(), stage) as client:
        await flying(client)
        assert stage.planners[0].state == "running"
    assert stage.planners[0].state == "ended"
    assert stage.worlds[0].state == "ended"


@pytest.mark.asyncio
async def test_no_process_takes_a_comment_with_a_nul(client: httpx.AsyncClient) -> None:
    mission = await flying(client)
    said = await client.post(f"{API}/missions/{mission}/comments", json={"text": "a\0b"})
    assert "body.text" in refused(said, 422, "invalid_request")["message"]
    asked = {"comments": [{"time_s": 1.0, "text": "a\0b"}]}
    begun = await client.post(f"{API}/experiments", json=asked)
    assert "text" in refused(begun, 422, "invalid_request")["message"]
