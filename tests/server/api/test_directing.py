"""Steering in person over HTTP: what reaches the mission, what is refused before it does."""

from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
import pytest_asyncio
from structlog.testing import capture_logs

from server.live.fanout import Messages
from tests.server.api.serving import Stage, client_of

MISSION = "/api/v1/missions/m1"
WEIGHTS = {"tracking": 20.0, "control": 0.05, "sensing": 50.0, "communication": 50.0}
ZONE = {"kind": "sensing", "mean": [1.0, 2.0], "covariance": [[0.5, 0.1], [0.1, 0.5]]}
PIN = {"robot": 21, "target": 122}

STEERING: list[tuple[str, str, dict[str, Any] | None, str, dict[str, Any]]] = [
    ("PUT", "assignment", {"assignment": {"21": [121]}}, "assignment", {}),
    ("PUT", "weights", WEIGHTS, "weights", {"weights": [20.0, 0.05, 50.0, 50.0]}),
    ("PUT", "capacities", {"capacities": {"21": 3}}, "capacities", {"capacities": {"21": 3}}),
    ("PUT", "pins/keep", PIN, "pin", {"id": "keep", "forbids": False, "ttl_s": None}),
    ("DELETE", "pins/keep", None, "unpin", {"id": "keep"}),
    ("POST", "zones", ZONE, "zone", {"mean": (1.0, 2.0), "margin": None}),
    ("PUT", "zones/h1", {"severity": 2.0}, "zone_change", {"id": "h1", "severity": 2.0}),
    ("DELETE", "zones/h1", None, "zone_erase", {"id": "h1"}),
    ("POST", "approvals/d1", {"approve": True}, "approval", {"id": "d1", "approve": True}),
]

INVALID: list[tuple[str, str, dict[str, Any], str]] = [
    ("PUT", "weights", {"tracking": 1.0}, "control"),
    ("PUT", "weights", WEIGHTS | {"tracking": "20"}, "tracking"),
    ("PUT", "weights", WEIGHTS | {"more": 1.0}, "more"),
    ("PUT", "assignment", {"assignment": {"twenty": [1]}}, "twenty"),
    ("PUT", "assignment", {"assignment": {"21": [1.5]}}, "21"),
    ("PUT", "capacities", {"capacities": {"21": -1}}, "21"),
    ("PUT", "capacities", {"capacities": {}}, "capacities"),
    ("PUT", "pins/keep", PIN | {"ttl_s": 0.0}, "ttl_s"),
    ("PUT", "pins/keep", PIN | {"forbids": "yes"}, "forbids"),
    ("POST", "zones", ZONE | {"kind": "gravity"}, "kind"),
    ("POST", "zones", ZONE | {"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "covariance"),
    ("POST", "zones", ZONE | {"covariance": [[1.0, 0.5], [0.1, 1.0]]}, "covariance"),
    ("POST", "zones", ZONE | {"mean": [1e9, 0.0]}, "mean"),
    ("POST", "zones", ZONE | {"risk": 0.9}, "risk"),
    ("PUT", "zones/h1", {}, "severity"),
    ("POST", "approvals/d1", {"approve": "certainly"}, "approve"),
]


@pytest.fixture
def stage() -> Stage:
    return Stage()


@pytest_asyncio.fixture
async def client(stage: Stage) -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(stage.app(), stage) as client:
        await client.post("/api/v1/missions", json={"scenario": "scripted"})
        yield client


@pytest.mark.asyncio
@pytest.mark.parametrize(("method", "path", "body", "what", "asked"), STEERING)
async def test_what_people_ask_reaches_the_mission_with_their_name(
    client: httpx.AsyncClient,
    stage: Stage,
    method: str,
    path: str,
    body: dict[str, Any] | None,
    what: str,
    asked: dict[str, Any],
) -> None:
    await client.post(f"{MISSION}/start")
    answer = await client.request(method, f"{MISSION}/{path}", json=body)
    assert answer.status_code == (201 if (method, path) == ("POST", "zones") else 200)
    assert answer.json()["decision"]["status"] == "adopted"
    op, params = next(r for r in stage.planners[0].requests[::-1] if r[0] == "override")
    assert (op, params["what"], params["author"]) == ("override", what, "operator")
    assert params["asked"].items() >= asked.items()


@pytest.mark.asyncio
@pytest.mark.parametrize(("method", "path", "body", "field"), INVALID)
async def test_a_body_that_does_not_fit_is_refused_by_the_name_of_its_field(
    client: httpx.AsyncClient,
    stage: Stage,
    method: str,
    path: str,
    body: dict[str, Any],
    field: str,
) -> None:
    await client.post(f"{MISSION}/start")
    answer = await client.request(method, f"{MISSION}/{path}", json=body)
    assert answer.status_code == 422
    error = answer.json()["error"]
    assert error["code"] == "invalid_request"
    assert field in str(error["details"]["problems"])
    assert [op for op, _ in stage.planners[0].requests] == ["prepare", "start"]


@pytest.mark.asyncio
async def test_a_number_that_is_none_is_refused(client: httpx.AsyncClient) -> None:
    await client.post(f"{MISSION}/start")
    body = '{"tracking": NaN, "control": 1.0, "sensing": 1.0, "communication": 1.0}'
    answer = await client.put(
        f"{MISSION}/weights", content=body, headers={"content-type": "application/json"}
    )
    assert answer.status_code == 422


@pytest.mark.asyncio
async def test_what_verification_refuses_is_told_with_every_violation(
    client: httpx.AsyncClient,
) -> None:
    await client.post(f"{MISSION}/start")
    answer = await client.put(f"{MISSION}/weights", json=WEIGHTS | {"tracking": 1000.0})
    assert answer.status_code == 422
    error = answer.json()["error"]
    assert error["code"] == "override_refused"
    assert error["details"]["field"] == "weights"
    assert "between 1 and 100" in error["details"]["violations"][0]


@pytest.mark.asyncio
async def test_a_pin_that_is_not_there_is_not_found(client: httpx.AsyncClient) -> None:
    await client.post(f"{MISSION}/start")
    answer = await client.delete(f"{MISSION}/pins/nobody")
    assert (answer.status_code, answer.json()["error"]["code"]) == (404, "pin_unknown")


@pytest.mark.asyncio
@pytest.mark.parametrize(("method", "path", "body", "what", "asked"), STEERING)
async def test_a_mission_that_does_not_fly_cannot_be_directed(
    client: httpx.AsyncClient,
    method: str,
    path: str,
    body: dict[str, Any] | None,
    what: str,
    asked: dict[str, Any],
) -> None:
    answer = await client.request(method, f"{MISSION}/{path}", json=body)
    assert (answer.status_code, answer.json()["error"]["code"]) == (409, "wrong_state")
    other = await client.request(method, f"/api/v1/missions/m9/{path}", json=body)
    assert (other.status_code, other.json()["error"]["code"]) == (404, "mission_unknown")


@pytest.mark.asyncio
async def test_decisions_are_paged_and_one_comes_with_its_prompts(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    await client.post(f"{MISSION}/start")
    with stage.service.frames("m1") as outbox:
        for _ in range(3):
            await client.put(f"{MISSION}/weights", json=WEIGHTS)
        told = [(await anext(Messages(outbox)))["type"] for _ in range(3)]
    assert set(told) <= {"event", "snapshot"}
    first = (await client.get(f"{MISSION}/decisions", params={"limit": 2})).json()
    assert [card["id"] for card in first["decisions"]] == ["d1", "d2"]
    params = {"after": first["next_after"]}
    second = (await client.get(f"{MISSION}/decisions", params=params)).json()
    assert [card["id"] for card in second["decisions"]] == ["d3"]
    assert "exchange" not in second["decisions"][0]
    one = (await client.get(f"{MISSION}/decisions/d2")).json()
    assert one["exchange"] == [{"prompt": "?"}]
    missing = await client.get(f"{MISSION}/decisions/d9")
    assert (missing.status_code, missing.json()["error"]["code"]) == (404, "decision_unknown")


@pytest.mark.asyncio
async def test_the_log_says_what_a_decision_changed(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    await client.post(f"{MISSION}/start")
    with capture_logs() as logged:
        await client.put(f"{MISSION}/weights", json=WEIGHTS)
        told = await client.get(f"{MISSION}/decisions")
    (card,) = told.json()["decisions"]
    (line,) = [entry for entry in logged if entry["event"] == "decision"]
    assert line["decision"] == card["id"]
    assert (line["mission"], line["status"], line["said"]) == ("m1", "adopted", "Adopted.")
