"""`falconer doctor`, as people call it."""

import json
import os
import socket
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
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
