import asyncio
import email.utils
import json
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

import httpx
import pytest
from pydantic import SecretStr

from llm.breaker import Breaker
from llm.chat import ChatRequest, ErrorKind, LanguageModel, Message, ModelError
from llm.client import ChatClient, ModelProfile
from llm.dialect import AnswerFormat, Dialect
from llm.mock.app import in_process_client
from llm.mock.behaviours import Behaviour, Mode
from llm.prompts import PromptView, task_request
from tests.llm.builders import LIMITS, hardware

SECRET = "sk-very-secret-0123456789"
ASKED = ChatRequest((Message("user", "Hello there."),), 50, {"type": "object"})
Answer = Callable[[httpx.Request], httpx.Response]


def completion(text: str = "hi", **message: Any) -> dict[str, Any]:
    return {
        "choices": [{"message": {"content": text, **message}, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 7, "completion_tokens": 3},
    }


class Sleeper:
    """Takes note of pauses instead of taking them."""

    def __init__(self) -> None:
        self.pauses: list[float] = []

    async def __call__(self, seconds: float) -> None:
        self.pauses.append(seconds)


class Endpoint:
    """Answers by a list of functions, the last one for ever; keeps what it was asked."""

    def __init__(self, *answers: Answer) -> None:
        self.answers = list(answers)
        self.requests: list[httpx.Request] = []

    async def __call__(self, request: httpx.Request) -> httpx.Response:
        self.requests.append(request)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        response = answer(request)
        if not hasattr(response, "_content"):
            return response

        async def pieces() -> AsyncIterator[bytes]:
            yield response.content

        return httpx.Response(response.status_code, headers=response.headers, content=pieces())

    @property
    def bodies(self) -> list[dict[str, Any]]:
        return [json.loads(request.content) for request in self.requests]


def ok(body: object = None, **headers: str) -> Answer:
    return lambda _: httpx.Response(200, json=body or completion(), headers=headers)


def failing(status: int, message: str = "no", **headers: str) -> Answer:
    body = {"error": {"message": message}}
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return lambda _: httpx.Response(status, json=body, headers=named)


def client_of(endpoint: Endpoint, sleeper: Sleeper | None = None, **changes: Any) -> ChatClient:
    profile = ModelProfile("http://model.test/v1", "m", SecretStr(SECRET))
    return ChatClient(
        replace(profile, **changes),
        transport=httpx.MockTransport(endpoint),
        sleep=sleeper or Sleeper(),
    )


async def error_of(client: LanguageModel, timeout_s: float = 5.0) -> ModelError:
    with pytest.raises(ModelError) as caught:
        await client.complete(ASKED, timeout_s)
    return caught.value


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
    date = email.utils.formatdate(time.time() + 10.0, usegmt=True)
    sleeper = Sleeper()
    async with client_of(Endpoint(failing(503, retry_after=date), ok()), sleeper) as client:
        await client.complete(ASKED, 60.0)
    assert 8.0 < sleeper.pauses[0] <= 10.0


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
async def test_the_weaker_formats_are_found_and_remembered() -> None:
    refuse = failing(400, "response_format json_schema is not supported")
    endpoint = Endpoint(refuse, refuse, ok())
    async with client_of(endpoint) as client:
        await client.complete(ASKED, 5.0)
        await client.complete(ASKED, 5.0)
    assert client.answer_format is AnswerFormat.NONE
    kinds = [body.get("response_format", {}).get("type") for body in endpoint.bodies]
    assert kinds == ["json_schema", "json_object", None, None]


@pytest.mark.asyncio
async def test_a_request_wrong_in_itself_teaches_nothing_about_formats() -> None:
    endpoint = Endpoint(failing(400, "context too long"))
    async with client_of(endpoint) as client:
        error = await error_of(client)
        assert error.kind is ErrorKind.REJECTED
        assert client.answer_format is AnswerFormat.JSON_SCHEMA
    assert len(endpoint.requests) == 3


@pytest.mark.asyncio
async def test_other_fields_of_the_dialect_are_found_too() -> None:
    endpoint = Endpoint(
        failing(400, "Unsupported parameter: use max_completion_tokens instead"),
        failing(400, "Unsupported value: temperature does not support 0"),
        ok(),
    )
    async with client_of(endpoint) as client:
        await client.complete(ASKED, 5.0)
    last = endpoint.bodies[-1]
    assert last["max_completion_tokens"] == 50
    assert "max_tokens" not in last
    assert "temperature" not in last
    assert last["response_format"]["type"] == "json_schema"


def test_without_a_schema_no_format_is_sent() -> None:
    body = Dialect().body("m", replace(ASKED, schema=None))
    assert "response_format" not in body


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
        shown += [record.getMessage() for record in caplog.records if record.name != "httpx"]
    assert error.kind is ErrorKind.UNAUTHORIZED
    assert "Incorrect API key" in str(error)
    assert not [text for text in shown if SECRET in text]


@pytest.mark.asyncio
async def test_the_key_is_not_in_the_log_of_an_ordinary_call(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.DEBUG)
    async with client_of(Endpoint(ok())) as client:
        await client.complete(ASKED, 5.0)
    assert SECRET not in caplog.text


# ------------------------------------------------------------------ circuit breaker


@pytest.mark.asyncio
async def test_an_endpoint_that_keeps_failing_is_left_alone() -> None:
    now = 0.0
    breaker = Breaker(threshold=2, cool_down_s=30.0, clock=lambda: now)
    endpoint = Endpoint(failing(500))
    client = client_of(endpoint, attempts=1)
    client.breaker = breaker
    async with client:
        assert (await error_of(client)).kind is ErrorKind.SERVER
        assert (await error_of(client)).kind is ErrorKind.SERVER
        error = await error_of(client)
        assert error.kind is ErrorKind.CIRCUIT_OPEN
        assert error.retry_after_s == pytest.approx(30.0)
        assert len(endpoint.requests) == 2
        now = 31.0
        assert (await error_of(client)).kind is ErrorKind.SERVER, "one probe"
        assert (await error_of(client)).kind is ErrorKind.CIRCUIT_OPEN
        now = 62.0
        endpoint.answers = [ok()]
        await client.complete(ASKED, 5.0)
        await client.complete(ASKED, 5.0)


@pytest.mark.asyncio
async def test_a_request_the_endpoint_dislikes_does_not_open_the_circuit() -> None:
    client = client_of(Endpoint(failing(404)))
    client.breaker = Breaker(threshold=1)
    async with client:
        assert (await error_of(client)).kind is ErrorKind.REJECTED
        assert (await error_of(client)).kind is ErrorKind.REJECTED


# ------------------------------------------------------------------ the mock, misbehaving


@pytest.mark.parametrize(
    ("behaviour", "kind"),
    [
        (Behaviour(Mode.FAIL_429), ErrorKind.RATE_LIMITED),
        (Behaviour(Mode.FAIL_500), ErrorKind.SERVER),
        (Behaviour(Mode.SLOW, delay_s=60.0), ErrorKind.TIMEOUT),
        (Behaviour(Mode.STALL, delay_s=60.0), ErrorKind.TIMEOUT),
        (Behaviour(Mode.HUGE), ErrorKind.TOO_LARGE),
        (Behaviour(Mode.NOT_JSON), ErrorKind.BAD_REPLY),
        (Behaviour(key="right"), ErrorKind.UNAUTHORIZED),
    ],
)
@pytest.mark.asyncio
async def test_the_mock_can_fail_in_every_way(behaviour: Behaviour, kind: ErrorKind) -> None:
    profile = ModelProfile("http://mock.invalid/v1", "m", SecretStr("wrong"), backoff_s=0.001)
    async with in_process_client(behaviour, profile) as client:
        started = time.perf_counter()
        error = await error_of(client, timeout_s=0.3)
    assert error.kind is kind
    assert time.perf_counter() - started < 1.0


@pytest.mark.asyncio
async def test_the_mock_recovers_after_as_many_failures_as_it_was_told() -> None:
    request = task_request(PromptView(hardware().snapshot(), LIMITS))
    async with in_process_client(Behaviour(Mode.FAIL_500, times=2, retry_after_s=0.0)) as client:
        reply = await client.complete(request, 5.0)
    assert '"assignment"' in reply.text
    assert client.usage.requests == 3


@pytest.mark.parametrize(
    ("formats", "found"),
    [
        (("json_schema", "json_object"), AnswerFormat.JSON_SCHEMA),
        (("json_object",), AnswerFormat.JSON_OBJECT),
        ((), AnswerFormat.NONE),
    ],
)
@pytest.mark.asyncio
async def test_the_mocks_formats_are_detected(
    formats: tuple[str, ...], found: AnswerFormat
) -> None:
    async with in_process_client(Behaviour(formats=formats)) as client:
        await client.complete(ASKED, 5.0)
        assert client.answer_format is found


# ------------------------------------------------------------------ raw sockets


@dataclass
class RawServer:
    url: str
    asked: asyncio.Event
    gone: asyncio.Event

    def client(self, **changes: Any) -> ChatClient:
        return ChatClient(replace(ModelProfile(self.url, "m"), **changes))


@asynccontextmanager
async def raw_server(*pieces: bytes) -> AsyncIterator["RawServer"]:
    """Send some bytes, then nothing, until the client goes away."""
    asked, gone = asyncio.Event(), asyncio.Event()
    handling: set[asyncio.Task[None]] = set()

    async def handle(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            await reader.readuntil(b"\r\n\r\n")
            asked.set()
            for piece in pieces:
                writer.write(piece)
                await writer.drain()
            while await reader.read(65536):
                continue
        gone.set()
        writer.close()
        with suppress(ConnectionError):
            await writer.wait_closed()

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        handling.add(asyncio.create_task(handle(reader, writer)))

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    host, port = server.sockets[0].getsockname()[:2]
    try:
        yield RawServer(f"http://{host}:{port}/v1", asked, gone)
    finally:
        server.close()
        await asyncio.gather(*handling)


HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 1000\r\n\r\n"


@pytest.mark.parametrize("pieces", [(), (b"HTTP/1.1 200",), (HEAD,), (HEAD, b'{"choices": [')])
@pytest.mark.asyncio
async def test_a_stalling_socket_meets_the_total_time_out(pieces: tuple[bytes, ...]) -> None:
    async with raw_server(*pieces) as server, server.client() as client:
        started = time.perf_counter()
        error = await error_of(client, timeout_s=0.2)
        assert error.kind is ErrorKind.TIMEOUT
        assert time.perf_counter() - started < 0.5
        await asyncio.wait_for(server.gone.wait(), 1.0)


@pytest.mark.asyncio
async def test_silence_meets_the_read_time_out() -> None:
    async with raw_server(HEAD) as server, server.client(read_timeout_s=0.1) as client:
        error = await error_of(client, timeout_s=5.0)
    assert error.kind is ErrorKind.TIMEOUT
    assert "silent" in str(error)


@pytest.mark.asyncio
async def test_a_call_is_cancelled_at_once() -> None:
    async with raw_server(HEAD, b"{") as server, server.client() as client:
        call = asyncio.create_task(client.complete(ASKED, 30.0))
        await asyncio.wait_for(server.asked.wait(), 5.0)
        started = time.perf_counter()
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        assert time.perf_counter() - started < 0.1
        await asyncio.wait_for(server.gone.wait(), 1.0)


@pytest.mark.asyncio
async def test_nobody_there_is_a_connection_error() -> None:
    server = await asyncio.start_server(lambda _r, _w: None, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    server.close()
    await server.wait_closed()
    profile = ModelProfile(f"http://127.0.0.1:{port}/v1", "m", backoff_s=0.001)
    async with ChatClient(profile) as client:
        error = await error_of(client)
    assert error.kind is ErrorKind.CONNECTION
    assert client.usage.requests == 3


@pytest.mark.asyncio
async def test_garbage_on_the_socket_is_a_connection_error() -> None:
    nonsense = b"\x00\x01 nonsense\r\n\r\n"
    async with raw_server(nonsense) as server, server.client(attempts=1) as client:
        assert (await error_of(client)).kind is ErrorKind.CONNECTION
