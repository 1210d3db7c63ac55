"""`falconer vehicle`: one clear sentence for what cannot work; orders over real processes."""

import asyncio
import signal
import socket
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.fleet import FALCONER, Fleet, Running, free_port
from server.cli.app import app
from server.cli.errors import UsageError
from tests.faults.commands import falconer
from tests.patience import PATIENCE_S
from tests.vehicles.buses import LOOPBACK
from vehicles.keys import TeamKeys
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

LINK = ("--connect", "udpin:127.0.0.1:0")
MAVLINK = ("vehicle", "mavlink", "--robot", "21")
AUTOPILOT = ("vehicle", "sim-autopilot")


def refusal(arguments: tuple[str, ...]) -> str:
    """Return why a command line is refused before anything is started."""
    result = CliRunner().invoke(app, list(arguments))
    if isinstance(result.exception, UsageError):
        return str(result.exception)
    assert result.exit_code == 2, result.exception
    return result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*MAVLINK, "--connect", "tcp:127.0.0.1:5760"), "udpin:HOST:PORT or udpout:HOST:PORT"),
        ((*MAVLINK, "--connect", "udpin:127.0.0.1:99999"), "is no endpoint"),
        ((*MAVLINK, "--connect", "udpout:127.0.0.1:0"), "a port to speak to is needed"),
        ((*MAVLINK, *LINK, "--scenario", "demo"), "the robots of demo are 0, 1, 2, 3"),
        ((*MAVLINK, *LINK, "--datum", "47,8", "--local-frame", "0,0,0,0"), "give one"),
        ((*MAVLINK, *LINK, "--datum", "95,8"), "latitude within 89"),
        ((*MAVLINK, *LINK, "--datum", "47"), "expected 2 or 3 numbers"),
        ((*MAVLINK, *LINK, "--datum", "47,x"), "expected 2 or 3 numbers"),
        ((*MAVLINK, *LINK, "--local-frame", "0,0,nan,0"), "expected 4 numbers"),
        ((*MAVLINK, *LINK, "--autopilot", "betaflight"), "--autopilot"),
        ((*MAVLINK, *LINK, "--system", "256"), "--system"),
        ((*MAVLINK, *LINK, "--speed-limit", "nan"), "--speed-limit"),
        ((*MAVLINK, *LINK, "--takeoff-altitude", "nan"), "--takeoff-altitude"),
        ((*MAVLINK, *LINK, "--autonomous", "inf"), "--autonomous"),
        ((*MAVLINK, *LINK, "--team", "a/b"), "team name"),
        ((*MAVLINK, *LINK, "--signing-key", "no-such-key"), "cannot read the signing key"),
        ((*AUTOPILOT, "--refuse", "WARP"), "its modes are ALT_HOLD, AUTO, BRAKE"),
        ((*AUTOPILOT, "--home", "1"), "expected 2 numbers"),
        ((*AUTOPILOT, "--battery", "nan"), "--battery"),
        ((*AUTOPILOT, "--signing-key", "no-such-key"), "cannot read the signing key"),
        (("vehicle", "order", "dance", "--robot", "21"), "ORDER"),
        (("vehicle", "sim", "hardware", "--robot", "7"), "the robots of hardware are 21, 26"),
        (("sim", "hardware", "--external", "99"), "the world's robots are 21, 26"),
    ],
)
def test_what_cannot_work_is_one_clear_sentence(arguments: tuple[str, ...], words: str) -> None:
    assert words in " ".join(refusal(arguments).replace("│", " ").split())


def test_a_key_that_others_may_read_is_refused(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_bytes(bytes(32))
    key.chmod(0o644)
    assert "chmod 600" in refusal((*MAVLINK, *LINK, "--signing-key", str(key)))
    key.chmod(0o600)
    key.write_bytes(b"short")
    assert "neither 32 bytes nor 64" in refusal((*MAVLINK, *LINK, "--signing-key", str(key)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tags: {0: [0, 0, 1]}", "tags: Dictionary should have at least 2 items"),
        ("tags: {0: [0, 0, 1], 300: [1, 1, 1]}", "tags.300"),
        ("tags: {0: [0, 0, 1], 1: [1, 1]}", "tags.1"),
        ("tags: {0: [0, 0, 1], 1: [1, 1, .nan]}", "tags.1.2"),
        ("tags: {0: [0, 0, 1], 0: [1, 1, 1]}", "twice"),
        ("places: {}", "tags"),
        ("{tags: {0: [0, 0, 1], 1: [1, 1, 1]}, targets: {300: 4}}", "targets.300"),
        ("{tags: {0: [0, 0, 1], 1: [1, 1, 1]}, targets: {1: 4}}", "tag 1 hangs somewhere and is"),
        ("[", "tags.yaml"),
    ],
)
def test_a_file_of_tags_that_does_not_do_is_told_by_field(
    tmp_path: Path, text: str, words: str
) -> None:
    file = tmp_path / "tags.yaml"
    file.write_text(text)
    assert words in " ".join(refusal((*MAVLINK, *LINK, "--tags", str(file))).split())


def test_tags_stand_in_for_a_datum(tmp_path: Path) -> None:
    both = (*MAVLINK, *LINK, "--tags", str(tmp_path), "--datum", "47,8")
    assert "give one" in refusal(both)
    file = tmp_path / "tags.yaml"
    file.write_text("{tags: {0: [0, 0, 1], 1: [1, 1, 1]}, targets: {50: 4}}")
    world = (*MAVLINK, *LINK, "--tags", str(file), "--senses", "world")
    assert "--senses must be none" in " ".join(refusal(world).split())
    missing = (*MAVLINK, *LINK, "--tags", str(tmp_path / "nowhere.yaml"))
    assert "nowhere.yaml" in refusal(missing)


@pytest.mark.parametrize("command", [MAVLINK, AUTOPILOT])
def test_a_port_that_is_taken_is_said_at_once(command: tuple[str, ...]) -> None:
    """Even where nobody answers on the bus yet."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        engine = ("--engine", "ipopt") if command is MAVLINK else ()
        assert f"cannot open {link}" in refusal((*command, "--connect", link, *engine))


async def interrupted(running: Running) -> int:
    """Press Ctrl-C; return the exit code once it has ended in order, however long that takes."""
    running.send(signal.SIGINT)
    async with asyncio.timeout(PATIENCE_S):
        await running.process.wait()
    return await running.end()


@pytest.mark.process
@pytest.mark.asyncio
async def test_orders_are_carried_out_and_refused_with_no_planner_about() -> None:
    keys = TeamKeys("falcons")
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))
    link = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    async with ZenohBus(router, keys.delivery) as bus, Fleet() as fleet:
        order = ("--robot", "21", "--zenoh-connect", bus.endpoints[0])
        code, words = await falconer("vehicle", "order", "hold", *order)
        assert (code, words.strip()) == (1, "falconer: robot 21 of team falcons is not on the bus")
        vehicle = await fleet.start(
            "vehicle", (*FALCONER, *AUTOPILOT, "--connect", f"udpin:{link}"), "at udpin"
        )
        flown = ("--connect", f"udpout:{link}", "--zenoh-connect", bus.endpoints[0])
        bridge = await fleet.start(
            "bridge", (*FALCONER, *MAVLINK, *flown, "--allow-takeoff"), "the autopilot is heard"
        )
        await bridge.until_said("robot 21 of team falcons: announced")
        for name, wanted, said in (
            ("land", 1, "refuses: land: it is on the ground"),
            ("take_off", 0, "robot 21: in the air"),
            ("land", 0, "robot 21: landed"),
        ):
            code, words = await falconer("vehicle", "order", name, *order)
            assert code == wanted, f"{words}\n{bridge.log}"
            assert said in words
        for running in (bridge, vehicle):
            assert await interrupted(running) == 0
            assert "Traceback" not in running.log
        assert "setpoints taken, 0 ignored" in vehicle.log


@pytest.mark.process
@pytest.mark.asyncio
async def test_an_interrupt_ends_a_bridge_that_waits_for_the_bus() -> None:
    bus = f"tcp/127.0.0.1:{free_port()}"
    async with Fleet() as fleet:
        command = (*FALCONER, *MAVLINK, *LINK, "--zenoh-connect", bus)
        bridge = await fleet.start("bridge", command, "listening for a vehicle")
        await asyncio.sleep(0.5)
        assert await interrupted(bridge) == 0
        assert "waiting for the bus at" in bridge.log
        assert "Traceback" not in bridge.log
