"""Which language model advises a mission: a built-in one, nobody, or any endpoint."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from urllib.parse import urlsplit

from pydantic import SecretStr

from llm.chat import LanguageModel
from llm.client import ChatClient, ModelProfile
from server.settings import Settings

MOCK = "mock"
NOBODY = "none"
EXACT = "exact"
"""No model: our own assignment solver in the task model's place."""
_CHOICES = "choose mock, exact, none or an http(s) address"
_NOT_BUILT = {
    "local": "the embedded model is not built yet",
}


class ModelUnavailable(Exception):
    """Raised when a chosen model cannot be had; the message says why and what to do."""


def checked_choice(choice: str) -> str:
    """Return the choice if it is mock, exact, none, or an http(s) address.

    Raises ModelUnavailable otherwise.
    """
    if choice in _NOT_BUILT:
        raise ModelUnavailable(
            f"--llm {choice}: {_NOT_BUILT[choice]}; use mock, exact, none or a URL"
        )
    if choice in {MOCK, NOBODY, EXACT} or _is_address(choice):
        return choice
    raise ModelUnavailable(
        f"--llm {choice[:80]!r}: expected mock, exact, none or an http(s) address"
    )


@asynccontextmanager
async def open_model(choice: str, settings: Settings) -> AsyncIterator[LanguageModel | None]:
    """Open the chosen model for as long as the block runs; None where no model is asked.

    An address is that of an OpenAI-compatible API, up to and including its version; model
    name and key come from the settings.

    Raises ModelUnavailable for anything else.
    """
    choice = checked_choice(choice)
    if choice in {NOBODY, EXACT}:
        yield None
    elif choice == MOCK:
        # The mock is a server by nature: only those who use it pay for importing it.
        from llm.mock.app import in_process_client

        async with in_process_client() as client:
            yield client
    else:
        profile = ModelProfile(
            base_url=choice,
            model=settings.llm_model,
            api_key=settings.llm_api_key or SecretStr(""),
        )
        async with ChatClient(profile) as client:
            yield client


def _is_address(choice: str) -> bool:
    parts = urlsplit(choice)
    return parts.scheme in {"http", "https"} and bool(parts.hostname)
