"""A machine without Numba: the product starts, flies with `sqp`, and says what it cannot do."""

import json
import os
import subprocess
import sys

WITHOUT = (
    "import sys; sys.modules['numba'] = None; sys.modules['llvmlite'] = None; "
    "from server.cli import main; sys.argv[0] = 'falconer'; main()"
)


def falconer(*arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    return subprocess.run(
        [sys.executable, "-c", WITHOUT, *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env={**environment, **settings},
        check=False,
    )


def test_it_flies_with_the_engine_that_is_there() -> None:
    run = ("run", "hardware", "--lockstep", "--llm", "none", "--steps", "6", "--json")
    by_itself = falconer(*run)
    assert by_itself.returncode == 0, by_itself.stderr
    chosen = falconer(*run, FALCONER_ENGINE="sqp")
    assert chosen.returncode == 0, chosen.stderr
    found, asked = json.loads(by_itself.stdout), json.loads(chosen.stdout)
    assert found["optimizer"]["ticks"] == 6
    assert found["optimizer"]["rungs"]["brake"] == 0
    assert found["accumulated_trace"] == asked["accumulated_trace"]


def test_the_engine_that_is_not_there_is_refused_in_one_sentence() -> None:
    done = falconer("run", "hardware", "--lockstep", "--llm", "none", "--engine", "fast")
    assert done.returncode == 2
    assert done.stdout == ""
    assert "engine 'fast' cannot run here" in done.stderr
    assert "numba" in done.stderr
    assert "Traceback" not in done.stderr
