"""The words exchanged with a language model, and the seam where models plug in."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, Protocol


@dataclass(frozen=True, slots=True)
class Message:
    """One turn of the conversation."""

    role: Literal["system", "user", "assistant"]
    content: str


@dataclass(frozen=True, slots=True, eq=False)
class ChatRequest:
    """What is asked. Temperature is always 0."""

    messages: tuple[Message, ...]
    max_tokens: int
    schema: Mapping[str, Any] | None = None
    """JSON schema of the answer, sent where the endpoint understands it."""

    schema_name: str = "answer"


@dataclass(frozen=True, slots=True)
class ChatReply:
    """What came back."""

    text: str
    tokens_in: int
    tokens_out: int
    latency_s: float
    """Wall time of the whole call, retries of the transport included."""

    finish: str = "stop"
    """The endpoint's reason for ending: stop, length, content_filter."""


class ErrorKind(StrEnum):
    """Why there is no reply."""

    TIMEOUT = "timeout"
    CONNECTION = "connection"
    RATE_LIMITED = "rate_limited"
    SERVER = "server"
    REJECTED = "rejected"
    """The endpoint did not accept the request (4xx)."""

    UNAUTHORIZED = "unauthorized"
    TOO_LARGE = "too_large"
    BAD_REPLY = "bad_reply"
    """The endpoint answered something that is not a chat completion."""

    CIRCUIT_OPEN = "circuit_open"
    """Not even asked: the endpoint failed too often lately."""


class ModelError(Exception):
    """Raised when a language model gives no reply. Never carries a key or a prompt."""

    def __init__(self, kind: ErrorKind, words: str, retry_after_s: float | None = None) -> None:
        super().__init__(words)
        self.kind = kind
        self.words = words
        self.retry_after_s = retry_after_s

    @property
    def transient(self) -> bool:
        """Whether the same request may succeed a moment later."""
        return self.kind in (ErrorKind.CONNECTION, ErrorKind.RATE_LIMITED, ErrorKind.SERVER)


class LanguageModel(Protocol):
    """Anything that can be asked: an endpoint over HTTP, recorded answers, a test double."""

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        """Return the model's reply within `timeout_s`.

        Raises:
            ModelError: when there is none.
        """
        ...
