"""The field set-up of docs/deploy.md: its certificates, settings, units and backup as they are."""

import asyncio
import os
import re
import sqlite3
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from server.bus import router_bus, vehicle_bus
from server.cli import app
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.scenarios import library
from server.settings import Settings, load_settings, variable
from tests.house.inventory import parse
from tests.vehicles.buses import Reader, reaches, until
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_access import Proof
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "deploy.md").read_text("utf-8")
SETUP = library.load("hardware").mission_setup()
KEYS = TeamKeys(SETUP.team)
HERE = "tls/127.0.0.1"


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Work in an empty folder, with none of our variables in the environment."""
    for name in Settings.model_fields:
        monkeypatch.delenv(variable(name), raising=False)
    monkeypatch.chdir(tmp_path)


def certificates() -> str:
    """Return the page's shell commands, after those of the bus's page that they build on."""
    bus = (DOCS / "bus.md").read_text("utf-8")
    (made,) = [b for b in re.findall(r"```sh\n(.*?)```", bus, re.DOTALL) if "openssl" in b]
    (issued,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    authority, _, _ = made.partition("issue planner")
    return f"{authority}{issued}"


def environment(name: str) -> dict[str, str]:
    """Return what an environment file of the page sets."""
    block = re.search(rf"`{name}\.env`.*?```ini\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    return dict(re.findall(r"^(FALCONER_\w+)=(.*)$", block[1], re.MULTILINE))


async def done(commands: str, folder: Path, **more: str) -> str:
    """Run shell commands; return what they said."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    process = await asyncio.create_subprocess_exec(
        *("sh", "-e", "-c", commands),
        cwd=folder,
        env={**os.environ, "PATH": path, **more},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    said, _ = await process.communicate()
    assert process.returncode == 0, said.decode()
    return said.decode()


def settings(name: str, folder: Path, **places: str) -> Settings:
    """Return what a program of the page is told, its files here and its addresses of this machine.

    The places are those to listen on and to connect to.
    """
    with pytest.MonkeyPatch.context() as patch:
        for key, value in environment(name).items():
            patch.setenv(key, value.replace("/etc/falconer", str(folder)))
        for part, place in places.items():
            assert f"FALCONER_ZENOH_{part}" in environment(name)
            patch.setenv(f"FALCONER_ZENOH_{part}", place)
        return load_settings()


@asynccontextmanager
async def routed(name: str, folder: Path, **places: str) -> AsyncIterator[ZenohBus]:
    """Run a router of the page."""
    told = settings(name, folder, LISTEN=f"{HERE}:0", **places)
    bus = router_bus(told, SETUP.team, SETUP.robot_ids)
    assert bus.proofs == (Proof.CERTIFICATE,)
    assert bus.access is not None
    async with ZenohBus(bus, KEYS.delivery) as router:
        yield router


def joined(name: str, folder: Path, router: ZenohBus) -> ZenohBus:
    """Return a session of a program of the page at a router."""
    told: ZenohSettings = vehicle_bus(settings(name, folder, CONNECT=router.endpoints[0]))
    return ZenohBus(told, KEYS.delivery)


@pytest.mark.process
@pytest.mark.asyncio
async def test_certificates_and_settings_join_two_sites_and_keep_each_to_its_own(
    tmp_path: Path,
) -> None:
    await done(certificates(), tmp_path)
    states, setpoints, tokens = Reader(), Reader(), Reader()
    async with (
        routed("base", tmp_path) as base,
        routed("site", tmp_path, CONNECT=base.endpoints[0]) as site,
        joined("server", tmp_path, base) as planner,
        joined("robot21", tmp_path, site) as vehicle,
    ):
        await planner.subscribe(KEYS.robot(None, Topic.STATE), states.inbox)
        await planner.watch(KEYS.alive(None), tokens.inbox)
        await vehicle.subscribe(KEYS.robot(21, Topic.SETPOINT), setpoints.inbox)
        await site.subscribe(KEYS.robot(26, Topic.SETPOINT), setpoints.inbox)
        await vehicle.announce(KEYS.alive(26))
        await vehicle.announce(KEYS.alive(21))
        await until(lambda: tokens.take())
        await reaches(vehicle, states, KEYS.robot(21, Topic.STATE))
        vehicle.publish(KEYS.robot(26, Topic.STATE), b"forged")
        vehicle.publish(KEYS.robot(26, Topic.SETPOINT), b"forged")
        states.samples.clear()
        await reaches(planner, setpoints, KEYS.robot(21, Topic.SETPOINT))
        await reaches(vehicle, states, KEYS.robot(21, Topic.STATE))
    assert {sample.key for sample in states.take()} == {KEYS.robot(21, Topic.STATE)}
    assert {sample.key for sample in tokens.take()} == {KEYS.alive(21)}
    assert b"forged" not in {sample.payload for sample in setpoints.take()}


def test_every_settings_file_is_one(tmp_path: Path) -> None:
    files = re.findall(r"^`(\w+)\.env`", PAGE, re.MULTILINE)
    assert files == ["base", "server", "site", "robot21"]
    for name in files:
        assert settings(name, tmp_path).zenoh_tls_key is not None
    server = settings("server", tmp_path)
    assert server.zenoh_listen is None
    tokens = (server.admin_token, server.operator_token, server.viewer_token)
    assert len({token.get_secret_value() for token in tokens if token is not None}) == 3


def test_every_unit_starts_a_command_that_there_is() -> None:
    starts = re.findall(r"(?:ExecStart=|\| `)/srv/falconer/\.venv/bin/falconer ([^`\n]+)", PAGE)
    assert len(starts) == 4
    for line in starts:
        parse(app, line.split())


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_backup_is_taken_while_the_journal_is_written_and_is_whole(tmp_path: Path) -> None:
    journal, copy = tmp_path / "journal.db", tmp_path / "copy.db"
    async with DatabaseJournal(Store(f"sqlite:///{journal}")):
        (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
        (tmp_path / "backup.py").write_text(program, "utf-8")
        await done(f"python backup.py {journal} {copy}", tmp_path)
        address = f"sqlite:///{copy}"
        said = await done("falconer doctor --journal", tmp_path, FALCONER_DATABASE_URL=address)
    assert "head" in said
    with sqlite3.connect(copy) as copied:
        assert copied.execute("pragma integrity_check").fetchone() == ("ok",)
