"""How often one client may ask, and what is never counted."""

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from server.api.models import MissionRequest
from server.api.rate import LEAST_BURST, MAX_CLIENTS, Buckets
from tests.server.api.fortress import API, OPERATOR, OURS, TOKENS, VIEWER, bearer, fort
from tests.server.api.serving import Stage, served

RATE_HZ = 0.1
"""So slow that a busy machine does not ask more slowly."""

AT_ONCE = round(LEAST_BURST)


def test_a_bucket_fills_again_with_time() -> None:
    clock = [100.0]
    buckets = Buckets(2.0, now=lambda: clock[0])
    assert [buckets.wait_s("a") for _ in range(10)] == [0.0] * 10
    assert buckets.wait_s("a") == pytest.approx(0.5)
    assert buckets.wait_s("b") == 0.0  # another client does not wait
    clock[0] += 0.25
    assert buckets.wait_s("a") == pytest.approx(0.25)
    clock[0] += 0.25
    assert buckets.wait_s("a") == 0.0
    assert buckets.wait_s("a") == pytest.approx(0.5)
    clock[0] += 1e6  # and never holds more than its most
    assert sum(buckets.wait_s("a") == 0.0 for _ in range(100)) == 10


def test_the_clients_remembered_are_bounded() -> None:
    buckets = Buckets(RATE_HZ, now=lambda: 0.0)
    for _ in range(AT_ONCE):
        assert buckets.wait_s("first") == 0.0
    assert buckets.wait_s("first") > 0.0
    for number in range(MAX_CLIENTS):
        buckets.wait_s(f"client {number}")
    assert buckets.wait_s("first") == 0.0  # forgotten, and so new


@pytest.mark.asyncio
async def test_who_asks_too_often_waits_alone_and_may_always_hold() -> None:
    async with fort(request_rate=RATE_HZ) as fortress:
        operator, client = bearer(OPERATOR), fortress.client
        for _ in range(1000):  # a slow machine fills the bucket meanwhile
            refused = await client.get(f"{API}/missions", headers=operator)
            if refused.status_code != 200:
                break
        assert refused.status_code == 429
        error = refused.json()["error"]
        assert error["code"] == "too_many_requests"
        assert error["details"] == {"retry_after_s": int(refused.headers["retry-after"])}
        assert 1 <= error["details"]["retry_after_s"] <= 1.0 / RATE_HZ
        assert (await client.get(f"{API}/missions", headers=bearer(VIEWER))).status_code == 200
        for _ in range(3 * AT_ONCE):
            held = await client.post(f"{API}/missions/m1/hold", headers=operator)
            assert held.json()["state"] == "held"
        assert (await client.get("/healthz")).status_code == 200
        stopped = await client.post(f"{API}/missions/m1/stop", headers=operator)
        assert stopped.json()["state"] == "ended"


@pytest.mark.asyncio
async def test_a_browsers_session_is_a_client_of_its_own() -> None:
    async with fort(request_rate=RATE_HZ) as fortress:
        client = fortress.client
        statuses: list[int] = []
        await fortress.log_in(OPERATOR)
        first = dict(client.cookies)
        while len(statuses) < 1000 and 429 not in statuses:
            statuses.append((await client.get(f"{API}/missions")).status_code)
        assert statuses[-1] == 429
        client.cookies.clear()
        again = await client.post(f"{API}/session", json={"token": OPERATOR}, headers=OURS)
        assert again.status_code == 201
        assert dict(client.cookies) != first
        assert (await client.get(f"{API}/missions")).status_code == 200


@pytest.mark.asyncio
async def test_opening_streams_is_counted_too() -> None:
    stage = Stage()
    async with served(stage.app(**TOKENS, request_rate=RATE_HZ)) as address:
        await stage.service.create(MissionRequest(scenario="scripted"), "test")
        url = f"ws://{address}{API}/missions/m1/stream"
        statuses: list[int] = []
        while len(statuses) < 1000 and 429 not in statuses:
            try:
                async with connect(url, additional_headers=bearer(OPERATOR)):
                    statuses.append(101)
            except InvalidStatus as refused:
                statuses.append(refused.response.status_code)
        assert statuses[0] == 101
        assert statuses[-1] == 429
