import asyncio
from typing import Any

import pytest

from llm.local import worker
from llm.styles import PromptStyle
from server.models import ModelUnavailable, checked_choice, manner_of, open_model
from server.settings import Settings


@pytest.fixture
def uninstalled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "model_file", lambda: None)


@pytest.mark.parametrize("choice", ["mock", "local", "exact", "none", "https://host.test/v1"])
def test_what_may_be_chosen(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "missing", lambda: None)
    assert checked_choice(choice) == choice


@pytest.mark.parametrize(
    "choice",
    [
        "",
        "Mock",
        "ftp://host",
        "http://",
        "http://h:70000/v1",
        "http://[::1/v1",
        "file:///etc/passwd",
    ],
)
def test_what_may_not_be_chosen(choice: str) -> None:
    with pytest.raises(ModelUnavailable, match="expected mock, local, exact, none or an http"):
        checked_choice(choice)


def test_an_address_holds_no_password() -> None:
    with pytest.raises(ModelUnavailable, match="FALCONER_LLM_API_KEY") as caught:
        checked_choice("https://ada:very-secret@host.test/v1")
    assert "very-secret" not in str(caught.value)


@pytest.mark.usefixtures("uninstalled")
def test_without_the_embedded_model_the_cure_is_told_at_once() -> None:
    with pytest.raises(ModelUnavailable, match=r"--llm local: .*make setup-local"):
        checked_choice("local")


@pytest.mark.parametrize(
    ("choice", "timeout_s", "style"),
    [
        ("mock", 8.0, PromptStyle.FULL),
        ("https://host.test/v1", 8.0, PromptStyle.FULL),
        ("http://127.0.0.1:8080/v1", 30.0, PromptStyle.FULL),
        ("http://localhost:8080/v1", 30.0, PromptStyle.FULL),
        ("http://[::1]:8080/v1", 30.0, PromptStyle.FULL),
        ("local", 30.0, PromptStyle.COMPACT),
    ],
)
def test_a_model_on_this_machine_gets_more_time(
    choice: str, timeout_s: float, style: PromptStyle
) -> None:
    manner = manner_of(choice)
    assert (manner.timeout_s, manner.style) == (timeout_s, style)


def test_nobody_is_asked_where_no_model_is_chosen() -> None:
    async def opened() -> list[Any]:
        found = []
        for choice in ("none", "exact"):
            async with open_model(choice, Settings()) as model:
                found.append(model)
        return found

    assert asyncio.run(opened()) == [None, None]


def test_the_embedded_model_is_not_started_before_it_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(worker, "missing", lambda: None)
    said: list[str] = []

    async def opened() -> None:
        async with open_model("local", Settings(), said.append) as model:
            assert model is not None

    asyncio.run(opened())
    assert said == []
