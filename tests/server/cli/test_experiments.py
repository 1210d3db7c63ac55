"""`falconer experiment` as people call it, break it off and call it again."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from server.cli import main
from tests.patience import PATIENCE_S
from tests.server.cli.test_run import falconer

TINY = ("experiment", "ablation", "--seeds", "2", "--steps", "4", "--jobs", "1")


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Undo a shell's "ignore Ctrl-C" for background jobs: children would inherit it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def _runs(folder: Path) -> dict[str, float]:
    return {path.name: path.stat().st_mtime_ns for path in (folder / "runs").glob("*.json")}


def test_tables_figure_and_json_and_nothing_is_flown_twice(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = falconer(*TINY, "--out", str(out), "--json")
    assert first.returncode == 0, first.stderr
    result = json.loads(first.stdout)
    assert [row["row"] for row in result["tables"]["means"]] == [
        "without",
        "exact",
        "llm-mock",
        "llm-mock-human",
    ]
    assert json.loads((out / "result.json").read_text()) == result
    assert {path.name for path in out.glob("*.*")} >= {
        "report.md",
        "means.csv",
        "differences.csv",
        "attribution.csv",
        "ablation.png",
    }
    flown = _runs(out)
    again = falconer(*TINY, "--out", str(out))
    assert again.returncode == 0, again.stderr
    assert _runs(out) == flown
    assert "rule model" in again.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--scenario", "nowhere"), "no scenario of that name"),
        (("--llm", "ftp://host"), "--llm"),
        (("--comment", "soon:now"), "--comment"),
        (("--scheduler", "tcp://127.0.0.1:9"), "127.0.0.1:9"),
        (("--scheduler", "somewhere"), "HOST:PORT"),
        (("--out", "/dev/null/x"), "--out"),
    ],
)
def test_bad_input_is_one_clear_sentence_and_exit_code_2(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["falconer", *TINY, *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr()
    assert ended.value.code == 2
    assert words in told.err
    assert told.out == ""


@pytest.mark.process
@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL], ids=["ctrl-c", "killed"])
def test_broken_off_it_leaves_what_is_finished_and_no_process(
    tmp_path: Path, end: signal.Signals
) -> None:
    with _begun(tmp_path) as running:
        _wait(lambda: len(_runs(tmp_path)) >= 3)
        assert len(_group(running.pid)) >= 3, "the command and its two workers"
        if end is signal.SIGINT:
            os.killpg(running.pid, end)  # as a terminal does: everybody gets it
        else:
            running.kill()
        code, told = _ended(running)
    assert code == (130 if end is signal.SIGINT else -signal.SIGKILL)
    assert "Traceback" not in told
    _wait(lambda: not _group(running.pid))
    kept = _runs(tmp_path)
    assert 3 <= len(kept) < 200
    for name in kept:
        assert json.loads((tmp_path / "runs" / name).read_text())["result"]["steps"] == 20
    again = falconer(
        "experiment",
        "ablation",
        "--seeds",
        "1",
        "--steps",
        "20",
        "--jobs",
        "1",
        "--out",
        str(tmp_path),
    )
    assert again.returncode == 0, again.stderr
    assert kept.items() <= _runs(tmp_path).items()


@pytest.mark.process
@pytest.mark.usefixtures("interruptible")
def test_broken_off_while_its_workers_begin_it_ends_without_a_word_of_theirs(
    tmp_path: Path,
) -> None:
    """A worker imports for a second, and is no less of the group that gets Ctrl-C."""
    with _begun(tmp_path) as running:
        _wait(lambda: any(_imports(pid) for pid in _group(running.pid)), 0.005)
        os.killpg(running.pid, signal.SIGINT)
        code, told = _ended(running)
    assert code == 130
    assert "Traceback" not in told
    _wait(lambda: not _group(running.pid))


def _begun(folder: Path) -> subprocess.Popen[bytes]:
    """Begin a long experiment with two workers, in a session of its own."""
    command = [
        sys.executable, "-m", "server.cli", "experiment", "ablation",
        "--seeds", "40", "--steps", "20", "--jobs", "2", "--out", str(folder),
    ]  # fmt: skip
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, env=environment, start_new_session=True
    )


def _ended(running: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Wait for the end; return the exit code, and what the command and its workers have said."""
    told = running.stderr.read().decode() if running.stderr else ""
    return running.wait(PATIENCE_S), told


def _imports(pid: int) -> bool:
    """Tell whether a process is a worker that has begun to import what it needs."""
    with suppress(OSError):  # it may just have ended
        worker = "loky_posix" in Path(f"/proc/{pid}/cmdline").read_text()
        return worker and "numpy" in Path(f"/proc/{pid}/maps").read_text()
    return False


def _group(leader: int) -> list[int]:
    """Return the living processes of a session (zombies do not live)."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == leader and fields[0] != "Z":
                found.append(int(entry.name))
    return found


def _wait(ready: Callable[[], bool], step_s: float = 0.1) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not ready():
        assert time.monotonic() < deadline, "it takes too long"
        time.sleep(step_s)


@pytest.mark.parametrize(
    ("arguments", "table"),
    [
        (("scaling", "--largest", "2", "--seeds", "1", "--steps", "10"), "scaling"),
        (("reasoning", "--seeds", "1", "--jobs", "1"), "summary"),
    ],
    ids=["scaling", "reasoning"],
)
def test_the_other_experiments_print_their_tables(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: tuple[str, ...],
    table: str,
) -> None:
    out = tmp_path / "out"
    command = ["falconer", "experiment", *arguments, "--out", str(out), "--json"]
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    result = json.loads(capsys.readouterr().out)
    assert result["tables"][table]
    assert (out / f"{table}.csv").read_text().count("\n") == 1 + len(result["tables"][table])
    assert (out / f"{arguments[0]}.png").stat().st_size > 10_000


@pytest.mark.parametrize("llm", ["exact", "none"])
def test_who_is_no_model_cannot_be_measured_as_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], llm: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["falconer", "experiment", "reasoning", "--llm", llm])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert f"--llm {llm}" in capsys.readouterr().err
