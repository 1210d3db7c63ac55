"""`falconer doctor`, as people call it."""

import asyncio
import json
import os
import socket
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from fastapi import FastAPI

from llm.mock import app as mock
from llm.mock.behaviours import Behaviour, Mode
from tests.patience import PATIENCE_S
from tests.server.api.serving import served
from tests.server.journal.keeping import address, event, journal_at


def doctor(folder: Path, *arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    environment |= {"FALCONER_DATABASE_URL": address(folder), **settings}
    command = [sys.executable, "-m", "server.cli", "doctor", *arguments]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=environment,
        check=False,
        cwd=Path(__file__).parents[3],
    )


async def written(folder: Path) -> None:
    async with journal_at(address(folder)) as journal:
        for number in range(1, 11):
            journal.post(event("event", number))


@pytest.mark.asyncio
async def test_a_whole_journal_and_a_changed_one(tmp_path: Path) -> None:
    await written(tmp_path)
    good = doctor(tmp_path, "--journal", "--json")
    assert good.returncode == 0, good.stderr
    answer = json.loads(good.stdout)
    assert (answer["sound"], answer["entries"], answer["head"]["seq"]) == (True, 12, 12)
    connection = sqlite3.connect(tmp_path / "journal.db")
    connection.execute("DROP TRIGGER journal_no_update")
    connection.execute("UPDATE journal SET author = 'nobody' WHERE seq = 5")
    connection.commit()
    connection.close()
    bad = doctor(tmp_path, "--journal")
    assert bad.returncode == 1
    assert "NOT whole" in bad.stdout
    assert "entry 5 was changed" in bad.stdout


def test_no_journal_is_told_in_one_sentence(tmp_path: Path) -> None:
    none = doctor(tmp_path, "--journal")
    assert none.returncode == 2
    assert "there is no journal" in none.stderr
    assert "Traceback" not in none.stderr


@pytest.mark.asyncio
async def test_what_works_and_what_does_not(tmp_path: Path) -> None:
    await written(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        found = doctor(
            tmp_path, "--json", "--port", port, FALCONER_LLM_BASE_URL="http://127.0.0.1:9/v1"
        )
    assert found.returncode == 1, found.stderr
    answer = json.loads(found.stdout)
    health = {finding["name"]: finding["health"] for finding in answer["findings"]}
    assert answer["sound"] is False
    assert (health["address"], health["model"]) == ("poor", "bad")
    assert (health["python"], health["journal"], health["disk"]) == ("good", "good", "good")


def test_a_table_for_people(tmp_path: Path) -> None:
    found = doctor(tmp_path, "--port", "0")
    assert found.returncode == 0, found.stdout
    assert "optimizer" in found.stdout
    assert "none yet" in found.stdout


async def model_found(folder: Path, app: FastAPI, **settings: str) -> tuple[int, str, str]:
    """Return the exit code, and how doctor finds the model of an endpoint."""
    async with served(app) as address:
        address = f"http://{address}/v1"
        found = await asyncio.to_thread(
            doctor, folder, "--json", "--port", "0", FALCONER_LLM_BASE_URL=address, **settings
        )
    model = next(f for f in json.loads(found.stdout)["findings"] if f["name"] == "model")
    return found.returncode, model["health"], model["text"]


def strict() -> FastAPI:
    """An endpoint that lists one model, and answers for no other."""
    app = FastAPI()

    @app.get("/v1/models")
    async def models() -> dict[str, object]:
        return {"data": [{"id": "the-one"}]}

    @app.post("/v1/chat/completions", status_code=404)
    async def complete() -> dict[str, object]:
        return {"error": {"message": "no such model"}}

    return app


@pytest.mark.asyncio
async def test_a_model_that_is_listed_is_good(tmp_path: Path) -> None:
    code, health, text = await model_found(
        tmp_path, mock.create_app(), FALCONER_LLM_MODEL=mock.MODEL
    )
    assert (code, health) == (0, "good")
    assert "list" not in text


@pytest.mark.asyncio
async def test_a_model_that_is_not_listed_and_answers_is_good(tmp_path: Path) -> None:
    code, health, text = await model_found(tmp_path, mock.create_app())
    assert (code, health) == (0, "good")
    assert "not on its list, but it answers" in text


@pytest.mark.asyncio
async def test_a_model_that_the_endpoint_does_not_have_does_not_work(tmp_path: Path) -> None:
    code, health, text = await model_found(tmp_path, strict())
    assert (code, health) == (1, "bad")
    assert "the model default, which nobody has set, gives no answer" in text
    assert "lists the-one" in text
    assert "FALCONER_LLM_MODEL" in text
    code, health, text = await model_found(tmp_path, strict(), FALCONER_LLM_MODEL="other")
    assert (code, health) == (1, "bad")
    assert "the model other gives no answer" in text


@pytest.mark.asyncio
async def test_a_model_that_is_asked_too_often_works_at_another_time(tmp_path: Path) -> None:
    busy = mock.create_app(Behaviour(mode=Mode.FAIL_429))
    assert (await model_found(tmp_path, busy))[:2] == (0, "poor")
