"""Endpoints that answer, fail and stall as a test wants them to."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

import httpx
import pytest
from pydantic import SecretStr

from llm.chat import ChatRequest, LanguageModel, Message, ModelError
from llm.client import ChatClient, ModelProfile

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
        # A client on a busy machine may give up before it has asked.
        with suppress(ConnectionError, asyncio.IncompleteReadError):
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
