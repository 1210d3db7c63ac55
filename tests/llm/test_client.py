import base64
import email.utils
import logging
import time
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from pydantic import SecretStr

from llm.chat import ErrorKind
from llm.client import ChatClient, ModelProfile
from llm.mock.app import in_process_client
from llm.mock.behaviours import Behaviour, Mode
from llm.prompts import PromptView, task_request
from tests.llm.builders import LIMITS, hardware
from tests.llm.endpoints import (
    ASKED,
    SECRET,
    Answer,
    Endpoint,
    Sleeper,
    client_of,
    completion,
    error_of,
    failing,
    ok,
)
from tests.patience import PATIENCE_S


@pytest.mark.asyncio
async def test_a_request_says_what_it_must() -> None:
    endpoint = Endpoint(ok())
    async with client_of(endpoint) as client:
        reply = await client.complete(ASKED, 5.0)
    assert (reply.text, reply.tokens_in, reply.tokens_out, reply.finish) == ("hi", 7, 3, "stop")
    assert reply.latency_s > 0.0
    request = endpoint.requests[0]
    assert str(request.url) == "http://model.test/v1/chat/completions"
    assert request.headers["authorization"] == f"Bearer {SECRET}"
    body = endpoint.bodies[0]
    assert body["temperature"] == 0
    assert body["stream"] is False
    assert body["max_tokens"] == 50
    assert body["messages"] == [{"role": "user", "content": "Hello there."}]
    schema = body["response_format"]["json_schema"]
    assert schema == {"name": "answer", "strict": True, "schema": {"type": "object"}}


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (completion("x"), "x"),
        (completion("", refusal="I cannot."), "I cannot."),
        ({"choices": [{"message": {"content": [{"type": "text", "text": "a"}, {"text": "b"}]}}]},
         "ab"),
        ({"choices": [{"message": {"content": None}}]}, ""),
    ],
)  # fmt: skip
@pytest.mark.asyncio
async def test_replies_in_every_shape(body: dict[str, Any], text: str) -> None:
    async with client_of(Endpoint(ok(body))) as client:
        reply = await client.complete(ASKED, 5.0)
    assert reply.text == text
    assert reply.tokens_in > 0


@pytest.mark.parametrize(
    "answer",
    [
        lambda _: httpx.Response(200, text="<html>"),
        lambda _: httpx.Response(200, json=[]),
        lambda _: httpx.Response(200, json={"choices": []}),
        lambda _: httpx.Response(200, json={"choices": [{"message": "x"}]}),
        lambda _: httpx.Response(200, content=b"[" * 100_000),
        lambda _: httpx.Response(200, content=b"\xff\xfe"),
    ],
)
@pytest.mark.asyncio
async def test_what_is_no_chat_completion_is_an_error(answer: Answer) -> None:
    async with client_of(Endpoint(answer)) as client:
        error = await error_of(client)
    assert error.kind is ErrorKind.BAD_REPLY


@pytest.mark.parametrize(
    ("status", "kind", "requests"),
    [
        (429, ErrorKind.RATE_LIMITED, 3),
        (500, ErrorKind.SERVER, 3),
        (503, ErrorKind.SERVER, 3),
        (401, ErrorKind.UNAUTHORIZED, 1),
        (403, ErrorKind.UNAUTHORIZED, 1),
        (404, ErrorKind.REJECTED, 1),
        (418, ErrorKind.REJECTED, 1),
    ],
)
@pytest.mark.asyncio
async def test_only_passing_failures_are_retried(
    status: int, kind: ErrorKind, requests: int
) -> None:
    endpoint = Endpoint(failing(status))
    async with client_of(endpoint) as client:
        error = await error_of(client)
    assert error.kind is kind
    assert str(status) in str(error)
    assert len(endpoint.requests) == requests
    assert (client.usage.calls, client.usage.requests) == (1, requests)


@pytest.mark.asyncio
async def test_a_retry_may_succeed_and_is_accounted_for() -> None:
    endpoint, sleeper = Endpoint(failing(500), failing(429), ok()), Sleeper()
    async with client_of(endpoint, sleeper, backoff_s=1.0) as client:
        reply = await client.complete(ASKED, 60.0)
        assert reply.text == "hi"
        await client.complete(ASKED, 60.0)
    assert len(sleeper.pauses) == 2
    assert 0.5 <= sleeper.pauses[0] <= 1.5, "jitter around the first pause"
    assert 1.0 <= sleeper.pauses[1] <= 3.0, "jitter around twice that"
    usage = client.usage
    assert (usage.calls, usage.requests, usage.failures) == (2, 4, 0)
    assert (usage.tokens_in, usage.tokens_out) == (14, 6)


@pytest.mark.asyncio
async def test_retry_after_in_seconds_is_honoured() -> None:
    sleeper = Sleeper()
    async with client_of(Endpoint(failing(429, retry_after="2.5"), ok()), sleeper) as client:
        await client.complete(ASKED, 60.0)
    assert sleeper.pauses == [2.5]


@pytest.mark.asyncio
async def test_retry_after_as_a_date_is_honoured() -> None:
    began_s = time.time()
    date = email.utils.formatdate(began_s + 10.0, usegmt=True)
    sleeper = Sleeper()
    async with client_of(Endpoint(failing(503, retry_after=date), ok()), sleeper) as client:
        await client.complete(ASKED, 60.0)
    # A date has whole seconds.
    assert 9.0 - (time.time() - began_s) < sleeper.pauses[0] <= 10.0


@pytest.mark.parametrize("value", ["soon", "nan", "-5", "inf", ""])
@pytest.mark.asyncio
async def test_a_senseless_retry_after_does_no_harm(value: str) -> None:
    sleeper = Sleeper()
    async with client_of(Endpoint(failing(429, retry_after=value), ok()), sleeper) as client:
        await client.complete(ASKED, 60.0)
    assert 0.0 <= sleeper.pauses[0] < 1.0


@pytest.mark.asyncio
async def test_a_pause_beyond_the_deadline_is_not_begun() -> None:
    endpoint, sleeper = Endpoint(failing(429, retry_after="30")), Sleeper()
    async with client_of(endpoint, sleeper) as client:
        error = await error_of(client, timeout_s=5.0)
    assert error.kind is ErrorKind.RATE_LIMITED
    assert error.retry_after_s == 30.0
    assert sleeper.pauses == []


@pytest.mark.asyncio
async def test_too_large_a_reply_is_broken_off() -> None:
    sent = 0

    async def pieces() -> AsyncIterator[bytes]:
        nonlocal sent
        while True:
            sent += 1000
            yield b" " * 1000

    endpoint = Endpoint(lambda _: httpx.Response(200, content=pieces()))
    async with client_of(endpoint, largest_reply_bytes=5000) as client:
        error = await error_of(client)
    assert error.kind is ErrorKind.TOO_LARGE
    assert sent <= 7000


@pytest.mark.asyncio
async def test_a_compressed_reply_is_refused() -> None:
    async def pieces() -> AsyncIterator[bytes]:
        yield b"x" * 10

    headers = {"content-encoding": "gzip"}
    endpoint = Endpoint(lambda _: httpx.Response(200, content=pieces(), headers=headers))
    async with client_of(endpoint) as client:
        assert (await error_of(client)).kind is ErrorKind.BAD_REPLY


# ------------------------------------------------------------------ secrets


@pytest.mark.asyncio
async def test_the_key_shows_nowhere(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    echo = failing(401, f"Incorrect API key provided: {SECRET}.")
    profile = ModelProfile(f"http://user:{SECRET}@model.test/v1", "m", SecretStr(SECRET))
    transport = httpx.MockTransport(Endpoint(echo))
    async with ChatClient(profile, transport=transport) as client:
        error = await error_of(client)
        shown = [repr(profile), repr(client), str(error), repr(error), repr(error.__cause__)]
        shown += [record.getMessage() for record in caplog.records]
    assert error.kind is ErrorKind.UNAUTHORIZED
    assert "Incorrect API key" in str(error)
    assert not [text for text in shown if SECRET in text]


@pytest.mark.asyncio
async def test_credentials_in_the_address_are_sent_but_never_shown(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.DEBUG)
    endpoint = Endpoint(ok(), failing(400, f"who is user:{SECRET}?"))
    profile = ModelProfile(f"http://user:{SECRET}@model.test/v1", "m")
    async with ChatClient(profile, transport=httpx.MockTransport(endpoint)) as client:
        await client.complete(ASKED, 5.0)
        error = await error_of(client)
    basic = base64.b64encode(f"user:{SECRET}".encode()).decode()
    assert endpoint.requests[0].headers["authorization"] == f"Basic {basic}"
    assert "who is user:[key]?" in str(error)
    assert "POST" in caplog.text, "there is a log to look at"
    assert SECRET not in caplog.text + str(endpoint.requests[0].url) + repr(client)


@pytest.mark.parametrize("address", ["http://[::1/v1", "http://127.0.0.1:70000/v1", "http:///v1"])
@pytest.mark.asyncio
async def test_an_address_that_is_none_is_a_connection_error(address: str) -> None:
    async with ChatClient(ModelProfile(address, "m", attempts=1)) as client:
        assert (await error_of(client)).kind is ErrorKind.CONNECTION


@pytest.mark.asyncio
async def test_a_key_that_no_header_can_hold_is_said_to_be_one_and_not_shown() -> None:
    profile = ModelProfile("http://model.test/v1", "m", SecretStr(f"{SECRET}\u2019"))
    endpoint = Endpoint(ok())
    async with ChatClient(profile, transport=httpx.MockTransport(endpoint)) as client:
        error = await error_of(client)
    assert error.kind is ErrorKind.REJECTED
    assert "no header may hold" in str(error)
    assert SECRET not in f"{error!r} {error.__cause__!r} {error.__context__!r}"
    assert endpoint.requests == []


@pytest.mark.asyncio
async def test_the_key_is_not_in_the_log_of_an_ordinary_call(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.DEBUG)
    async with client_of(Endpoint(ok())) as client:
        await client.complete(ASKED, 5.0)
    assert SECRET not in caplog.text


# ------------------------------------------------------------------ the mock, misbehaving


@pytest.mark.parametrize(
    ("behaviour", "kind"),
    [
        (Behaviour(Mode.FAIL_429), ErrorKind.RATE_LIMITED),
        (Behaviour(Mode.FAIL_500), ErrorKind.SERVER),
        (Behaviour(Mode.SLOW, delay_s=3600.0), ErrorKind.TIMEOUT),
        (Behaviour(Mode.STALL, delay_s=3600.0), ErrorKind.TIMEOUT),
        (Behaviour(Mode.HUGE), ErrorKind.TOO_LARGE),
        (Behaviour(Mode.NOT_JSON), ErrorKind.BAD_REPLY),
        (Behaviour(key="right"), ErrorKind.UNAUTHORIZED),
    ],
)
@pytest.mark.asyncio
async def test_the_mock_can_fail_in_every_way(behaviour: Behaviour, kind: ErrorKind) -> None:
    profile = ModelProfile("http://mock.invalid/v1", "m", SecretStr("wrong"), backoff_s=0.001)
    async with in_process_client(behaviour, profile) as client:
        error = await error_of(client, 0.3 if kind is ErrorKind.TIMEOUT else PATIENCE_S)
    assert error.kind is kind


@pytest.mark.asyncio
async def test_the_mock_recovers_after_as_many_failures_as_it_was_told() -> None:
    request = task_request(PromptView(hardware().snapshot(), LIMITS))
    async with in_process_client(Behaviour(Mode.FAIL_500, times=2, retry_after_s=0.0)) as client:
        reply = await client.complete(request, 5.0)
    assert '"assignment"' in reply.text
    assert client.usage.requests == 3
