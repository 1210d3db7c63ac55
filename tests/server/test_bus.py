"""The bus's settings, and the worked example of its page: certificates, rules, refusals."""

import asyncio
import re
from dataclasses import replace
from pathlib import Path

import pytest

from server.bus import LOOPBACK, planner_bus, router_bus, vehicle_bus
from server.scenarios import library
from server.settings import Settings, SettingsError, load_settings, variable
from tests.vehicles.buses import Reader, reaches, until
from vehicles.bus import BusError
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_access import AccessRules, Proof
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "bus.md").read_text("utf-8")


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Work in an empty folder, with none of our variables in the environment."""
    for name in Settings.model_fields:
        monkeypatch.delenv(variable(name), raising=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_planner_without_a_bus_has_its_own() -> None:
    assert planner_bus(load_settings(), "red", (21,)) == LOOPBACK


def test_every_setting_reaches_the_session(
    nothing_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ca.pem", "own.pem", "own.key", "users.txt"):
        (nothing_set / name).touch()
    values = {
        "LISTEN": "tls/127.0.0.1:7447, tcp/127.0.0.1:7448",
        "CONNECT": "tls/192.0.2.1:7447",
        "USER": "planner",
        "PASSWORD": "hush-hush",
        "TLS_ROOT_CA": "ca.pem",
        "TLS_CERTIFICATE": "own.pem",
        "TLS_KEY": "own.key",
        "TLS_MUTUAL": "true",
        "USERS_FILE": "users.txt",
    }
    for name, value in values.items():
        monkeypatch.setenv(f"FALCONER_ZENOH_{name}", value)
    bus = planner_bus(load_settings(), "red", (21, 26))
    assert bus == ZenohSettings(
        mode=ZenohMode.ROUTER,
        connect=("tls/192.0.2.1:7447",),
        listen=("tls/127.0.0.1:7447", "tcp/127.0.0.1:7448"),
        user="planner",
        password="hush-hush",
        dictionary_file="users.txt",
        tls_root_ca="ca.pem",
        tls_certificate="own.pem",
        tls_key="own.key",
        tls_mutual=True,
        access=AccessRules("red", (21, 26)),
    )
    assert bus.proofs == (Proof.USER, Proof.CERTIFICATE)
    vehicle = vehicle_bus(load_settings())
    assert (vehicle.mode, vehicle.listen, vehicle.access) == (ZenohMode.CLIENT, (), None)
    assert (vehicle.user, vehicle.tls_mutual) == ("planner", False)
    monkeypatch.setenv("FALCONER_ZENOH_ACCESS", "open")
    assert planner_bus(load_settings(), "red", (21, 26)).access is None


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"USER": "planner"}, "user and password must be given together"),
        ({"TLS_KEY": "x.key"}, "certificate and key must be given together"),
        ({"TLS_MUTUAL": "true"}, "mutual TLS needs"),
        ({"USERS_FILE": "nobody.txt"}, "there is no file nobody.txt"),
        ({"ACCESS": "sometimes"}, "FALCONER_ZENOH_ACCESS: must be 'team' or 'open'"),
    ],
)
def test_settings_that_cannot_work_are_named(
    monkeypatch: pytest.MonkeyPatch, values: dict[str, str], words: str
) -> None:
    monkeypatch.setenv("FALCONER_ZENOH_LISTEN", "tcp/127.0.0.1:0")
    for name, value in values.items():
        monkeypatch.setenv(f"FALCONER_ZENOH_{name}", value)
    with pytest.raises(SettingsError, match=words):
        planner_bus(load_settings(), "red", (21,))


def test_who_has_nowhere_to_go_is_told() -> None:
    with pytest.raises(SettingsError, match="needs an endpoint to connect to"):
        vehicle_bus(load_settings())
    with pytest.raises(SettingsError, match="needs an endpoint to listen on"):
        router_bus(load_settings(), "red", ())


# ---------------------------------------------------------------- the worked example


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def environment(text: str) -> dict[str, str]:
    return dict(re.findall(r"^(FALCONER_\w+)=(.*)$", text, re.MULTILINE))


async def certified(folder: Path) -> None:
    """Run the page's shell commands in a folder."""
    (script,) = [block for block in blocks("sh") if "openssl" in block]
    process = await asyncio.create_subprocess_exec(
        *("sh", "-e", "-c", script),
        cwd=folder,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    said, _ = await process.communicate()
    assert process.returncode == 0, f"OpenSSL 3 is needed: {said.decode()}"


@pytest.mark.process
@pytest.mark.asyncio
async def test_the_worked_example_works(nothing_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    await certified(nothing_set)
    planner_says, vehicle_says = (environment(block) for block in blocks("ini"))
    setup = library.load("hardware").mission_setup()
    keys = TeamKeys(setup.team)

    for name, value in planner_says.items():
        monkeypatch.setenv(name, value.replace(":7447", ":0"))
    settings = planner_bus(load_settings(), setup.team, setup.robot_ids)
    states, setpoints, tokens = Reader(), Reader(), Reader()
    async with ZenohBus(settings, keys.delivery) as planner:
        await planner.subscribe(keys.robot(None, Topic.STATE), states.inbox)
        await planner.watch(keys.alive(None), tokens.inbox)
        for name in planner_says:
            monkeypatch.delenv(name)
        for name, value in vehicle_says.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setenv("FALCONER_ZENOH_CONNECT", planner.endpoints[0])
        robot21 = vehicle_bus(load_settings())
        async with ZenohBus(robot21, keys.delivery) as vehicle:
            await vehicle.subscribe(keys.robot(21, Topic.SETPOINT), setpoints.inbox)
            await vehicle.announce(keys.alive(26))
            await vehicle.announce(keys.alive(21))
            vehicle.publish(keys.robot(26, Topic.STATE), b"forged")
            await reaches(vehicle, states, keys.robot(21, Topic.STATE))
            await reaches(planner, setpoints, keys.robot(21, Topic.SETPOINT))
            await until(lambda: tokens.take())
        assert {sample.key for sample in states.take()} == {keys.robot(21, Topic.STATE)}
        assert {sample.key for sample in tokens.take()} == {keys.alive(21)}
        stranger = replace(robot21, tls_certificate=None, tls_key=None, open_timeout_s=0.1)
        with pytest.raises(BusError, match="may ask for a certificate of ours"):
            async with ZenohBus(stranger, keys.delivery):
                pass
