"""Which language model advises a mission: a built-in one, nobody, or any endpoint."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from pydantic import SecretStr

from llm.chat import LanguageModel
from llm.local import worker
from llm.styles import PromptStyle
from server.errors import BadInput
from server.settings import Settings, without_secret

MOCK = "mock"
LOCAL = "local"
"""The language model that runs on this machine, in a process of its own."""

NOBODY = "none"
EXACT = "exact"
"""No model: our own assignment solver in the task model's place."""

HOSTED_TIMEOUT_S: Final = 8.0
LOCAL_TIMEOUT_S: Final = 30.0
"""A model on this machine shares its processor with us."""

LOCAL_HOSTS: Final = frozenset({"127.0.0.1", "localhost", "::1"})
_BUILT_IN: Final = (MOCK, LOCAL, EXACT, NOBODY)


class ModelUnavailable(BadInput):
    """Raised when a chosen model cannot be had; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Manner:
    """How a model is asked."""

    timeout_s: float = HOSTED_TIMEOUT_S
    """Longest time of one try, real or virtual."""

    style: PromptStyle = PromptStyle.FULL


def manner_of(choice: str) -> Manner:
    """Return how the chosen model is to be asked: patiently on this machine, and briefly."""
    if choice == LOCAL:
        return Manner(LOCAL_TIMEOUT_S, PromptStyle.COMPACT)
    if urlsplit(choice).hostname in LOCAL_HOSTS:
        return Manner(LOCAL_TIMEOUT_S)
    return Manner()


def checked_choice(choice: str) -> str:
    """Return the choice if it is mock, local, exact, none, or an http(s) address.

    Raises ModelUnavailable otherwise, and where the embedded model is not installed.
    """
    if choice == LOCAL and (missing := worker.missing()):
        raise ModelUnavailable(f"--llm local: {missing}")
    if choice in _BUILT_IN:
        return choice
    if is_address(choice):
        try:
            return without_secret(choice)
        except ValueError as error:
            raise ModelUnavailable(f"--llm: the address {error}") from None
    raise ModelUnavailable(
        f"--llm {choice[:80]!r}: expected mock, local, exact, none or an http(s) address"
    )


def is_address(choice: str) -> bool:
    """Tell whether it is an http(s) address with a host."""
    try:
        parts = urlsplit(choice)
        return parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False


def named_model(choice: str, settings: Settings) -> str:
    """Return the words by which results tell who advised: the choice, and the model there."""
    return f"{choice} {settings.llm_model}" if is_address(choice) else choice


def _silent(_: str) -> None:
    """Tell nobody."""


@asynccontextmanager
async def open_model(
    choice: str,
    settings: Settings,
    progress: Callable[[str], None] = _silent,
    niceness: int = 10,
) -> AsyncIterator[LanguageModel | None]:
    """Open the chosen model for as long as the block runs; None where no model is asked.

    An address is that of an OpenAI-compatible API, up to and including its version; model
    name and key come from the settings. `progress` is told, in a line, what takes its time;
    `niceness` is how far a model in a process of ours steps back from everything else.

    Raises ModelUnavailable for anything else.
    """
    # Only who opens a model pays for importing its client, and the mock is a server by nature.
    choice = checked_choice(choice)
    if choice in {NOBODY, EXACT}:
        yield None
    elif choice == LOCAL:
        from llm.local.model import LocalModel

        async with LocalModel(progress=progress, niceness=niceness) as model:
            yield model
    elif choice == MOCK:
        from llm.mock.app import in_process_client

        async with in_process_client() as client:
            yield client
    else:
        from llm.client import ChatClient, ModelProfile

        profile = ModelProfile(
            base_url=choice,
            model=settings.llm_model,
            api_key=settings.llm_api_key or SecretStr(""),
        )
        async with ChatClient(profile) as client:
            yield client
