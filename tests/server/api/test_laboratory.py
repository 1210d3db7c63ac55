"""How experiments are run: below the live mission, and never on its bus."""

import sys
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from server.api.laboratory import Campaign, Laboratory, Progress
from tests.server.waiting import eventually

SPY = """
import json, os, sys, time
for _ in range(1000):
    if os.nice(0) > 0: break
    time.sleep(0.01)
known = sorted(name for name in os.environ if name.startswith("FALCONER_"))
print(json.dumps({"settings": known, "nice": os.nice(0), "asked": sys.argv[1:]}))
"""


@pytest.mark.asyncio
async def test_an_experiment_flies_apart_from_the_live_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FALCONER_ZENOH_CONNECT", "tcp/127.0.0.1:7447")
    monkeypatch.setenv("FALCONER_RECORDINGS", "/somewhere")
    monkeypatch.setenv("FALCONER_ENGINE", "sqp")
    laboratory = Laboratory(tmp_path, (sys.executable, "-c", SPY))
    made = laboratory.begin(Campaign("scaling", ("--seeds", "2"), 6), "ada")
    await eventually(lambda: made.state is Progress.DONE)
    assert made.result is not None
    assert "FALCONER_ENGINE" in made.result["settings"]
    assert not [name for name in made.result["settings"] if "ZENOH" in name or "RECORD" in name]
    assert made.result["nice"] == 10
    assert made.result["asked"][:3] == ["scaling", "--seeds", "2"]
    assert "--scenario" not in made.result["asked"]
    assert made.done == 6
    await laboratory.close()


SLOW = """
import pathlib, sys, time
out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1]) / "runs"
out.mkdir(parents=True)
for number in range(3):
    (out / f"{number}.json").touch()
time.sleep(1000)
"""


def slow(folder: Path) -> Laboratory:
    return Laboratory(folder, (sys.executable, "-c", SLOW))


@pytest.mark.asyncio
async def test_runs_are_counted_while_they_are_done(tmp_path: Path) -> None:
    laboratory = slow(tmp_path)
    made = laboratory.begin(Campaign("scaling", (), 6), "ada")
    await eventually(lambda: made.done == 3)
    assert made.state is Progress.RUNNING
    stopped = await laboratory.stop(made.id)
    assert (stopped.state, stopped.done) == (Progress.STOPPED, 3)


@pytest.mark.asyncio
async def test_one_that_is_stopped_before_its_turn_never_begins(tmp_path: Path) -> None:
    laboratory = slow(tmp_path)
    first = laboratory.begin(Campaign("scaling", (), 6), "ada")
    second = laboratory.begin(Campaign("scaling", (), 6, {"name": "own"}), "ada")
    assert (await laboratory.stop(second.id)).state is Progress.STOPPED
    await eventually(lambda: first.done == 3)
    assert not second.folder.exists()
    third = laboratory.begin(Campaign("scaling", (), 6, {"name": "own"}), "ada")
    await laboratory.close()
    assert [e.state for e in laboratory.all()] == [Progress.STOPPED] * 3
    assert not third.folder.exists()


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("command", "arguments", "words"),
    [
        (("/no/such/command",), (), "No such file"),
        ((sys.executable, "-c", SLOW), ("--comment", "1:\0"), "null byte"),
    ],
)
async def test_one_that_cannot_be_begun_has_failed_and_lets_the_next_one_on(
    tmp_path: Path, command: tuple[str, ...], arguments: tuple[str, ...], words: str
) -> None:
    laboratory = Laboratory(tmp_path, command)
    with capture_logs():
        for _ in range(2):
            made = laboratory.begin(Campaign("scaling", arguments, 6), "ada")
            await eventually(lambda made=made: made.state is Progress.FAILED)  # type: ignore[misc]
            assert words in made.error


@pytest.mark.asyncio
async def test_a_folder_that_cannot_be_made_fails_it(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    laboratory = slow(tmp_path / "file")
    with capture_logs():
        made = laboratory.begin(Campaign("ablation", (), 6, "demo"), "ada")
        await eventually(lambda: made.state is Progress.FAILED)
    assert "Not a directory" in made.error
