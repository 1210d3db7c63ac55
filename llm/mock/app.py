"""The mock's HTTP side: the OpenAI-compatible routes, and one to change its behaviour.

In one process it is reached through the ASGI transport (`in_process_client`), over TCP by
`serve`. Either way nothing but the text of the prompt goes in.
"""

import asyncio
import secrets
from collections.abc import AsyncIterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field, SecretStr

from llm.client import ChatClient, ModelProfile
from llm.mock import action_rules, task_rules
from llm.mock.behaviours import Behaviour, Mode, spoiled
from llm.mock.deciding import Decision, write
from llm.mock.reading import Reading, read
from llm.tokens import estimate_tokens

MODEL = "falconer-mock"
BEHAVIOUR_HEADER = "X-Mock-Behaviour"
"""A mode for one request."""

NOTHING_UNDERSTOOD = "I do not understand what is asked."
_ENDLESS = b" " * 65_536


class ChatMessage(BaseModel):
    """One turn of a chat completion request."""

    role: str
    content: str


class ChatBody(BaseModel):
    """A chat completion request, as far as the mock minds it."""

    model_config = ConfigDict(extra="allow")

    model: str
    messages: list[ChatMessage] = Field(min_length=1)
    max_tokens: int | None = Field(default=None, ge=1)
    max_completion_tokens: int | None = Field(default=None, ge=1)
    stream: bool = False
    response_format: dict[str, Any] | None = None


class BehaviourBody(BaseModel):
    """A change of behaviour; what is left out goes back to its default."""

    mode: Mode = Mode.SOUND
    times: int | None = Field(default=None, ge=1)
    delay_s: float = Field(default=5.0, ge=0.0)
    retry_after_s: float | None = Field(default=None, ge=0.0)


@dataclass(eq=False)
class MockModel:
    """The rule model and the state of its misbehaviour."""

    behaviour: Behaviour

    def mode_for(self, header: str | None) -> Mode:
        """Return how to behave towards one request, and count it."""
        if header is not None:
            try:
                return Mode(header)
            except ValueError:
                raise HTTPException(400, f"no such behaviour: {header[:40]}") from None
        mode, times = self.behaviour.mode, self.behaviour.times
        if mode is Mode.SOUND or times is None:
            return mode
        if times <= 0:
            return Mode.SOUND
        self.behaviour = replace(self.behaviour, times=times - 1)
        return mode

    def answer(self, body: ChatBody, mode: Mode) -> str:
        """Return the text of an answer."""
        reading = read([(message.role, message.content) for message in body.messages])
        decision = decide(reading)
        if decision is None:
            return NOTHING_UNDERSTOOD
        if mode in (Mode.SOUND, Mode.SLOW, Mode.STALL):
            return write(decision, reading)
        return spoiled(mode, decision, reading)


def decide(reading: Reading) -> Decision | None:
    """Reason by the rules of the loop that asks; None where the prompt is none of ours."""
    if reading.loop == "task" and reading.robots:
        return task_rules.decide(reading)
    if reading.loop == "action" and len(reading.weights) == len(reading.bounds) == 4:
        return action_rules.decide(reading)
    return None


def create_app(behaviour: Behaviour = Behaviour()) -> FastAPI:  # noqa: B008 - immutable
    """Return the mock as an ASGI application."""
    app = FastAPI(title="Falconer mock language model", docs_url=None, redoc_url=None)
    model = MockModel(behaviour)

    @app.exception_handler(HTTPException)
    async def _error(request: Request, error: HTTPException) -> JSONResponse:
        body = {"error": {"message": str(error.detail), "type": "mock_error", "code": None}}
        return JSONResponse(body, error.status_code, headers=error.headers)

    @app.get("/v1/models")
    async def models() -> dict[str, object]:
        """List the one model there is."""
        return {"object": "list", "data": [{"id": MODEL, "object": "model", "owned_by": "mock"}]}

    @app.get("/mock/behaviour")
    async def behaviour_now() -> dict[str, object]:
        """Tell how the mock behaves now."""
        shown = asdict(model.behaviour)
        shown.pop("key")
        return shown

    @app.put("/mock/behaviour")
    async def set_behaviour(body: BehaviourBody) -> dict[str, object]:
        """Make the mock behave differently from now on."""
        model.behaviour = replace(model.behaviour, **body.model_dump())
        return await behaviour_now()

    @app.post("/v1/chat/completions")
    async def complete(body: ChatBody, request: Request) -> Response:
        """Answer a prompt."""
        _admit(body, request, model.behaviour)
        mode = model.mode_for(request.headers.get(BEHAVIOUR_HEADER))
        return await _respond(model, body, mode)

    return app


def _admit(body: ChatBody, request: Request, behaviour: Behaviour) -> None:
    """Refuse what the behaviour does not allow.

    Raises:
        HTTPException: with the status a real endpoint would answer.
    """
    if behaviour.key is not None:
        given = request.headers.get("Authorization", "")
        if not secrets.compare_digest(given.encode(), f"Bearer {behaviour.key}".encode()):
            raise HTTPException(401, "Incorrect API key provided.")
    if body.stream:
        raise HTTPException(400, "stream is not supported")
    wanted = (body.response_format or {}).get("type", "text")
    if wanted not in ("text", *behaviour.formats):
        raise HTTPException(400, f"response_format {wanted!s:.40} is not supported")


async def _respond(model: MockModel, body: ChatBody, mode: Mode) -> Response:
    behaviour = model.behaviour
    if mode in (Mode.FAIL_429, Mode.FAIL_500):
        headers = {}
        if behaviour.retry_after_s is not None:
            headers["Retry-After"] = f"{behaviour.retry_after_s:g}"
        status = 429 if mode is Mode.FAIL_429 else 500
        raise HTTPException(status, "told to fail", headers=headers)
    if mode is Mode.SLOW:
        await asyncio.sleep(behaviour.delay_s)
    if mode is Mode.NOT_JSON:
        return Response("<html>Bad gateway</html>", media_type="text/html")
    if mode is Mode.HUGE:
        return StreamingResponse(_endless(), media_type="application/json")
    # In a thread: whoever shares the event loop with the mock keeps its time.
    text = await asyncio.to_thread(model.answer, body, mode)
    completion = _completion(body, text)
    if mode is Mode.STALL:
        whole = JSONResponse(completion).body
        half = bytes(whole)[: len(whole) // 2]
        return StreamingResponse(_stalled(half, behaviour.delay_s), media_type="application/json")
    return JSONResponse(completion)


async def _endless() -> AsyncIterator[bytes]:
    # Finite, so that a transport that buffers whole replies comes to an end too.
    for _ in range(64):
        yield _ENDLESS
        await asyncio.sleep(0)


async def _stalled(half: bytes, silence_s: float) -> AsyncIterator[bytes]:
    yield half
    await asyncio.sleep(silence_s)


def _completion(body: ChatBody, text: str) -> dict[str, object]:
    """Wrap a text as a chat completion, cut off at the token limit asked for."""
    finish = "stop"
    limit = body.max_completion_tokens or body.max_tokens
    if limit is not None and estimate_tokens(text) > limit:
        finish, text = "length", _first_tokens(text, limit)
    tokens_in = sum(estimate_tokens(message.content) for message in body.messages)
    tokens_out = estimate_tokens(text)
    return {
        "id": "chatcmpl-mock",
        "object": "chat.completion",
        "created": 0,
        "model": MODEL,
        "choices": [
            {
                "index": 0,
                "message": {"role": "assistant", "content": text},
                "finish_reason": finish,
            }
        ],
        "usage": {
            "prompt_tokens": tokens_in,
            "completion_tokens": tokens_out,
            "total_tokens": tokens_in + tokens_out,
        },
    }


def _first_tokens(text: str, limit: int) -> str:
    """Return the longest beginning of a text within a token limit, by bisection."""
    shortest, longest = 0, len(text)
    while shortest < longest:
        middle = (shortest + longest + 1) // 2
        if estimate_tokens(text[:middle]) <= limit:
            shortest = middle
        else:
            longest = middle - 1
    return text[:shortest]


def in_process_client(
    behaviour: Behaviour = Behaviour(),  # noqa: B008 - immutable
    profile: ModelProfile | None = None,
) -> ChatClient:
    """Return a client of a mock of its own, without any socket.

    The ASGI transport knows no read time-out; the client's total time-out holds all the same.
    """
    app = create_app(behaviour)
    profile = profile or ModelProfile(
        base_url="http://mock.invalid/v1",
        model=MODEL,
        api_key=SecretStr(behaviour.key or ""),
    )
    return ChatClient(profile, transport=httpx.ASGITransport(app=app))


def serve(host: str, port: int, behaviour: Behaviour = Behaviour()) -> None:  # noqa: B008
    """Serve the mock over TCP until interrupted."""
    config = uvicorn.Config(create_app(behaviour), host=host, port=port, log_level="warning")
    uvicorn.Server(config).run()
