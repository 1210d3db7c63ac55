"""What a start imports: the heavy libraries only where they are used."""

import subprocess
import sys

import pytest

from server.cli.commands import PLACES, Commands

TELL = "import sys; print('\\n'.join(sys.modules))"


def imported(*modules: str) -> set[str]:
    """Everything that a fresh interpreter has imported after these modules."""
    told = subprocess.run(
        [sys.executable, "-c", f"import {', '.join(modules)}; {TELL}"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(told.stdout.split())


def test_the_command_line_alone_is_light() -> None:
    found = imported("server.cli.app")
    assert "typer" in found
    assert not {"numpy", "pydantic", "fastapi", "sqlalchemy"} & found
    assert not {place for place, _ in PLACES.values()} & found


def test_what_runs_before_the_processes_are_started_knows_no_web_and_no_science() -> None:
    found = imported("server.cli.run", "server.cli.live", "server.api.definitions")
    assert "numpy" in found
    heavy = {"fastapi", "uvicorn", "sqlalchemy", "scipy", "numba", "casadi", "matplotlib"}
    assert not (heavy | {"nicegui", "viser", "pymavlink", "joblib", "mcap"}) & found


def test_the_web_side_and_the_console_leave_the_numerics_to_the_planner() -> None:
    found = imported("server.cli.site", "console.page")
    assert {"fastapi", "nicegui", "viser"} <= found
    assert not {"scipy", "numba", "casadi", "matplotlib", "pymavlink", "joblib", "httpx"} & found
    assert not {"server.mission.core", "solver.planner", "vehicles.agent"} & found


@pytest.mark.parametrize("name", list(PLACES))
def test_every_command_is_found_by_its_name(name: str) -> None:
    command = Commands()[name]
    assert command.name == name
    assert command.help
    options = {option for parameter in command.params for option in parameter.opts}
    assert "--install-completion" not in options


def test_there_is_no_other_command() -> None:
    commands = Commands()
    assert "fly" not in commands
    with pytest.raises(KeyError):
        commands["fly"]
    assert list(commands) == list(PLACES)
    assert len(commands) == len(PLACES)
