"""The client of any OpenAI-compatible chat endpoint (hosted, vLLM, Ollama, llama.cpp).

One call has one total time-out, which bounds connecting, retries and reading alike. The
key stands in one header and nowhere else: not in a repr, an error, a log line.
"""

import asyncio
import ipaddress
import json
import random
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from email.utils import parsedate_to_datetime
from http import HTTPStatus
from types import TracebackType
from typing import Any, Self

import httpx
import tenacity
from pydantic import SecretStr

from llm.breaker import Breaker
from llm.chat import ChatReply, ChatRequest, ErrorKind, LanguageModel, Message, ModelError
from llm.dialect import AnswerFormat, Dialect
from llm.tokens import estimate_tokens
from llm.words import writable

__all__ = [
    "ChatClient",
    "ChatReply",
    "ChatRequest",
    "ErrorKind",
    "LanguageModel",
    "Message",
    "ModelError",
    "ModelProfile",
    "Usage",
]

LARGEST_PORT = 65_535
LONGEST_ERROR = 200
"""Characters of an endpoint's own error text that are passed on."""


@dataclass(frozen=True, slots=True)
class ModelProfile:
    """Where a model is and how patient to be with it."""

    base_url: str = field(repr=False)
    """Up to and including the version, e.g. https://host/v1."""

    model: str
    api_key: SecretStr = field(default_factory=lambda: SecretStr(""), repr=False)
    connect_timeout_s: float = 3.0
    read_timeout_s: float = 30.0
    """Longest silence between two pieces of a reply; the total is given per call."""

    largest_reply_bytes: int = 262_144
    attempts: int = 3
    """Requests per call while the failures are transient."""

    backoff_s: float = 0.25
    """Mean of the first pause; it doubles each time."""

    headers: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    dialect: Dialect = field(default_factory=Dialect)


@dataclass(frozen=True, slots=True)
class Usage:
    """What the calls of one client have cost so far."""

    calls: int = 0
    requests: int = 0
    failures: int = 0
    tokens_in: int = 0
    tokens_out: int = 0


@dataclass(eq=False)
class ChatClient:
    """A language model behind HTTP. Connects on first use; close it after the last."""

    profile: ModelProfile
    transport: httpx.AsyncBaseTransport | None = field(default=None, repr=False)
    breaker: Breaker = field(default_factory=Breaker, repr=False)
    sleep: Callable[[float], Awaitable[None]] = field(default=asyncio.sleep, repr=False)
    jitter: random.Random = field(default_factory=random.Random, repr=False)
    usage: Usage = field(default_factory=Usage, init=False)
    _dialect: Dialect | None = field(default=None, init=False, repr=False)
    _http: httpx.AsyncClient | None = field(default=None, init=False, repr=False)

    @property
    def answer_format(self) -> AnswerFormat:
        """How strictly the endpoint can be held to a schema, as far as is known."""
        return (self._dialect or self.profile.dialect).answer_format

    async def __aenter__(self) -> Self:
        """Return the client itself; nothing is connected yet."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the connections."""
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connections. The client may be used again afterwards."""
        if self._http is not None:
            http, self._http = self._http, None
            await http.aclose()

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        """Ask, with retries where they help, for at most `timeout_s` in total.

        Raises:
            ModelError: when there is no reply.
        """
        self.breaker.check()
        started = time.monotonic()
        deadline = asyncio.get_running_loop().time() + timeout_s
        self.usage = replace(self.usage, calls=self.usage.calls + 1)
        try:
            async with asyncio.timeout(timeout_s):
                reply = await self._patiently(request, deadline)
        except (TimeoutError, ModelError) as error:
            failure = error if isinstance(error, ModelError) else _too_slow(timeout_s)
            self._failed(failure)
            raise failure from None
        self.breaker.succeeded()
        self.usage = replace(
            self.usage,
            tokens_in=self.usage.tokens_in + reply.tokens_in,
            tokens_out=self.usage.tokens_out + reply.tokens_out,
        )
        return replace(reply, latency_s=time.monotonic() - started)

    def _failed(self, error: ModelError) -> None:
        self.usage = replace(self.usage, failures=self.usage.failures + 1)
        if error.transient or error.kind is ErrorKind.TIMEOUT:
            self.breaker.failed()
        else:
            # The endpoint is alive, it only did not like this request.
            self.breaker.succeeded()

    async def _patiently(self, request: ChatRequest, deadline: float) -> ChatReply:
        """Repeat while failures are transient and the pause still fits before `deadline`."""

        def pause(state: tenacity.RetryCallState) -> float:
            error = state.outcome.exception() if state.outcome is not None else None
            if isinstance(error, ModelError) and error.retry_after_s is not None:
                return error.retry_after_s
            mean_s = self.profile.backoff_s * 2.0 ** (state.attempt_number - 1)
            return mean_s * self.jitter.uniform(0.5, 1.5)

        def too_late(state: tenacity.RetryCallState) -> bool:
            return asyncio.get_running_loop().time() + state.upcoming_sleep >= deadline

        attempts = tenacity.AsyncRetrying(
            retry=tenacity.retry_if_exception(
                lambda error: isinstance(error, ModelError) and error.transient
            ),
            wait=pause,
            stop=lambda state: state.attempt_number >= self.profile.attempts or too_late(state),
            sleep=self.sleep,
            reraise=True,
        )
        return await attempts(self._once, request)

    async def _once(self, request: ChatRequest) -> ChatReply:
        """Send one request, in simpler dialects where the endpoint does not understand."""
        dialect: Dialect | None = self._dialect or self.profile.dialect
        while dialect is not None:
            status, headers, content = await self._post(dialect.body(self.profile.model, request))
            if status == HTTPStatus.OK:
                reply = _reply(content, request)
                self._dialect = dialect
                return reply
            error = self._refusal(status, headers, content)
            words = content[:4000].decode("utf-8", "replace")
            dialect = dialect.after_refusal(status, words, request)
        raise error

    async def _post(self, body: dict[str, Any]) -> tuple[int, httpx.Headers, bytes]:
        self.usage = replace(self.usage, requests=self.usage.requests + 1)
        chunks = bytearray()
        try:
            http = self._connected()
            async with http.stream("POST", "chat/completions", json=body) as response:
                async for chunk in response.aiter_raw():
                    chunks += chunk
                    if len(chunks) > self.profile.largest_reply_bytes:
                        raise ModelError(
                            ErrorKind.TOO_LARGE,
                            f"the reply exceeds {self.profile.largest_reply_bytes} bytes",
                        )
        except httpx.TimeoutException as error:
            kind = (
                ErrorKind.CONNECTION
                if isinstance(error, httpx.ConnectTimeout | httpx.PoolTimeout)
                else ErrorKind.TIMEOUT
            )
            raise ModelError(kind, f"the model was silent ({type(error).__name__})") from None
        except (httpx.TransportError, httpx.InvalidURL) as error:
            # The library's own words may hold the address, and with it credentials.
            words = f"the model cannot be reached ({type(error).__name__})"
            raise ModelError(ErrorKind.CONNECTION, words) from None
        encoding = response.headers.get("content-encoding", "identity")
        if encoding != "identity":
            raise ModelError(ErrorKind.BAD_REPLY, "the reply is compressed, which was not asked")
        return response.status_code, response.headers, bytes(chunks)

    def _connected(self) -> httpx.AsyncClient:
        if self._http is None:
            key = self.profile.api_key.get_secret_value()
            headers = {"Accept": "application/json", "Accept-Encoding": "identity"}
            headers.update(self.profile.headers)
            if key:
                headers["Authorization"] = f"Bearer {key}"
            if not all(value.isascii() for value in headers.values()):
                words = "the key or a header holds characters that no header may hold"
                raise ModelError(ErrorKind.REJECTED, words)
            # Credentials in the address would stand in the log of whoever logs requests.
            url = httpx.URL(self.profile.base_url.rstrip("/") + "/")
            if url.port is not None and not 0 < url.port <= LARGEST_PORT:
                raise httpx.InvalidURL("no such port")
            named = bool(url.username or url.password)
            base_url = url.copy_with(username=None, password=None)
            self._http = httpx.AsyncClient(
                base_url=base_url,
                headers=headers,
                auth=(url.username, url.password) if named and not key else None,
                transport=self.transport,
                timeout=httpx.Timeout(
                    self.profile.read_timeout_s, connect=self.profile.connect_timeout_s
                ),
                # A model on this machine is never asked through a proxy.
                trust_env=not _is_loopback(url.host),
                follow_redirects=False,
            )
        return self._http

    def _refusal(self, status: int, headers: httpx.Headers, content: bytes) -> ModelError:
        words = f"the endpoint answered {status}: {_error_text(content)}"
        for secret in (
            self.profile.api_key.get_secret_value(),
            httpx.URL(self.profile.base_url).password,
        ):
            words = words.replace(secret, "[key]") if secret else words
        if status == HTTPStatus.TOO_MANY_REQUESTS:
            return ModelError(ErrorKind.RATE_LIMITED, words, _retry_after_s(headers))
        if status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
            return ModelError(ErrorKind.UNAUTHORIZED, words)
        if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            return ModelError(ErrorKind.SERVER, words, _retry_after_s(headers))
        return ModelError(ErrorKind.REJECTED, words)


def _too_slow(timeout_s: float) -> ModelError:
    return ModelError(ErrorKind.TIMEOUT, f"the model gave no answer within {timeout_s:g} s")


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _retry_after_s(headers: httpx.Headers) -> float | None:
    """Return the pause an endpoint asks for: seconds or an HTTP date."""
    value = headers.get("retry-after", "").strip()
    if not value:
        return None
    try:
        seconds = float(value)
    except ValueError:
        try:
            seconds = parsedate_to_datetime(value).timestamp() - time.time()
        except ValueError:
            return None
    return max(0.0, seconds) if seconds < float("inf") else None


def _error_text(content: bytes) -> str:
    """Return the message of an error body in one short line."""
    text = content[:4000].decode("utf-8", "replace")
    try:
        body = json.loads(text)
        error = body.get("error", body)
        text = str(error.get("message", text) if isinstance(error, dict) else error)
    except (ValueError, AttributeError):
        text = text.strip() or "no reason given"
    return writable(" ".join(text.split())[:LONGEST_ERROR])


def _reply(content: bytes, request: ChatRequest) -> ChatReply:
    """Read a chat completion.

    Raises:
        ModelError: when it is none.
    """
    try:
        body = json.loads(content)
        choice = body["choices"][0]
        message = choice["message"]
        text = _text(message.get("content")) or _text(message.get("refusal"))
        finish = str(choice.get("finish_reason") or "stop")
        usage = body.get("usage") or {}
        tokens_in = usage.get("prompt_tokens")
        tokens_out = usage.get("completion_tokens")
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise ModelError(ErrorKind.BAD_REPLY, "the reply is not a chat completion") from None
    if not isinstance(tokens_in, int):
        tokens_in = sum(estimate_tokens(m.content) for m in request.messages)
    if not isinstance(tokens_out, int):
        tokens_out = estimate_tokens(text)
    return ChatReply(text, tokens_in, tokens_out, latency_s=0.0, finish=finish)


def _text(content: object) -> str:
    """Return the text of a message that is a string or a list of parts."""
    if isinstance(content, str):
        return content
    if isinstance(content, list):
        parts = [part.get("text", "") for part in content if isinstance(part, dict)]
        return "".join(part for part in parts if isinstance(part, str))
    return ""
