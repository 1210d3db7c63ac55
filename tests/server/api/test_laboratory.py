"""How experiments are run: below the live mission, and never on its bus."""

import sys
from pathlib import Path

import pytest

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
    made = await laboratory.begin(Campaign("scaling", ("--seeds", "2"), 6), "ada")
    await eventually(lambda: made.state is Progress.DONE)
    assert made.result is not None
    assert "FALCONER_ENGINE" in made.result["settings"]
    assert not [name for name in made.result["settings"] if "ZENOH" in name or "RECORD" in name]
    assert made.result["nice"] == 10
    assert made.result["asked"][:3] == ["scaling", "--seeds", "2"]
    assert "--scenario" not in made.result["asked"]
    assert made.done == 6
    await laboratory.close()
