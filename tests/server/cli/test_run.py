"""`falconer run --lockstep` as people call it: one JSON object, or one clear sentence."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S


def falconer(
    *arguments: str, cwd: Path | None = None, timeout_s: float = PATIENCE_S
) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    command = [sys.executable, "-m", "server.cli", *arguments]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        cwd=cwd,
        env=environment,
        check=False,
    )


def test_json_on_stdout_progress_on_stderr(tmp_path: Path) -> None:
    done = falconer(
        "run", "ablation", "--lockstep", "--llm", "none", "--steps", "5", "--seed", "3",
        "--json", "--out", str(tmp_path),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["seed"], result["steps"]) == (3, 5)
    assert json.loads((tmp_path / "result.json").read_text()) == result


def test_a_comment_and_its_answer_are_told() -> None:
    done = falconer(
        "run", "ablation", "--lockstep", "--steps", "70",
        "--comment", "30:The drone 0 should focus on tracking target 1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "applied" in done.stderr
    assert "beta = 0" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "no-such-scenario", "--lockstep"), "no scenario of that name"),
        (("run", "ablation", "--lockstep", "--comment", "now:hold"), "--comment"),
        (("run", "ablation", "--lockstep", "--comment", "nan:hold"), "--comment"),
        (("run", "ablation", "--lockstep", "--comment", "1:" + "x" * 3000), "2000"),
        (("run", "ablation", "--lockstep", "--llm", "ftp://host"), "--llm"),
        (("run", "ablation", "--lockstep", "--llm-latency", "-1"), "--llm-latency"),
        (("run", "ablation", "--lockstep", "--steps", "0"), "--steps"),
        (("run", "ablation", "--lockstep", "--engine", "forces"), "--engine"),
        (("run", "ablation", "--lockstep", "--out", "/dev/null/x"), "--out /dev/null/x"),
        (("replay", "flight.mcap", "--fork-at", "nan"), "--fork-at"),
        (("mock-llm", "--delay-s", "inf"), "--delay-s"),
        (("script", "script.yaml", "--server", "127.0.0.1:8000"), "--server"),
        (("launch",), "launch"),
    ],
)
def test_bad_input_is_one_clear_sentence_and_exit_code_2(
    arguments: tuple[str, ...], words: str
) -> None:
    done = falconer(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_a_scenario_file_with_a_nan_names_the_field(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text("name: bad\nrobots: [{id: 1, position: [.nan, 0.0], capacity: 1}]\n")
    done = falconer("run", str(file), "--lockstep")
    assert done.returncode == 2
    assert "robots[0].position[0]" in done.stderr


def test_help_names_every_option() -> None:
    done = falconer("run", "--help")
    assert done.returncode == 0
    for option in ("--llm", "--gate", "--lockstep", "--seed", "--steps", "--engine", "--comment"):
        assert option in done.stdout


@pytest.mark.parametrize("command", [("run", "demo"), ("serve",)])
def test_a_port_that_is_taken_is_one_clear_sentence(command: tuple[str, ...]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = falconer(*command, "--port", port)
    assert done.returncode == 2
    assert f"cannot listen on 127.0.0.1:{port}" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_model_that_never_answers_validly_is_told_of() -> None:
    done = falconer(
        "run", "ablation", "--lockstep", "--steps", "5", "--llm", "http://127.0.0.1:9/v1"
    )
    assert done.returncode == 0
    assert "no answer of the task model was valid" in done.stderr


@pytest.mark.process
def test_the_embedded_language_model_advises_a_mission_without_a_network() -> None:
    done = falconer(
        "run", "hardware", "--lockstep", "--llm", "local", "--llm-latency", "0", "--steps", "3",
        "--json", timeout_s=180.0,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "starting the embedded language model" in done.stderr
    result = json.loads(done.stdout)
    for loop in (result["task_llm"], result["action_llm"]):
        assert loop["calls"] == 1
        assert loop["mean_tokens_in"] > 300
        assert loop["mean_tokens_out"] > 20
    assert result["directives"]["beta"] == 0


def test_a_recorded_run_is_verified_reported_and_never_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "flight.mcap"
    flown = falconer(
        "run", "ablation", "--lockstep", "--steps", "10", "--engine", "sqp",
        "--record", str(file), "--json",
    )  # fmt: skip
    assert flown.returncode == 0, flown.stderr
    done = falconer("replay", str(file), "--verify", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["ticks"] == 10
    done = falconer("report", str(file))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "flight-report" / "report.html").is_file()
    again = falconer(
        "run", "ablation", "--lockstep", "--steps", "10", "--record", str(file), "--engine", "sqp"
    )
    assert again.returncode == 2
    assert "exists already" in again.stderr


def test_a_recording_that_is_none_is_told_in_a_sentence(tmp_path: Path) -> None:
    done = falconer("replay", str(tmp_path / "nothing.mcap"), "--verify")
    assert done.returncode == 2
    assert done.stderr.strip().endswith("nothing.mcap: No such file or directory")
