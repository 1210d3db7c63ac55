"""Zenoh: settings, opening, closing, coming back. Real sessions over loopback sockets."""

import asyncio
import json
import socket
import threading
from collections.abc import Iterable
from pathlib import Path
from time import monotonic
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from tests.patience import PATIENCE_S, patience_s
from tests.vehicles.buses import KEYS, LOOPBACK, Reader, reaches, until
from vehicles import zenoh_bus
from vehicles.bus import BusError
from vehicles.inbox import SampleKind
from vehicles.keys import Topic
from vehicles.repetition import MOST
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings, configuration

pytestmark = pytest.mark.sockets

ROUTER = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"mode": ZenohMode.CLIENT, "listen": (LOOPBACK,)}, "client needs an endpoint"),
        ({"mode": ZenohMode.PEER}, "to connect to or to listen on"),
        ({"connect": (LOOPBACK,), "user": "robot"}, "user and password"),
        ({"connect": (LOOPBACK,), "tls_key": "key.pem"}, "certificate and key"),
    ],
)
def test_settings_that_cannot_work_are_refused(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ZenohSettings(**wrong)  # type: ignore[arg-type]


def test_every_setting_reaches_zenoh_and_the_password_no_log(tmp_path: Path) -> None:
    base = tmp_path / "zenoh.json5"
    base.write_text('{access_control: {enabled: false, default_permission: "deny"}}')
    settings = ZenohSettings(
        mode=ZenohMode.ROUTER,
        connect=("tls/127.0.0.1:7447",),
        listen=("tls/127.0.0.1:7448",),
        user="planner",
        password="hush-hush",
        dictionary_file="users.txt",
        tls_root_ca="ca.pem",
        tls_certificate="own.pem",
        tls_key="own.key",
        tls_mutual=True,
        config_file=str(base),
        lease_ms=1500,
    )
    config = configuration(settings, 1000)
    wanted = {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/endpoints": ["tls/127.0.0.1:7447"],
        "listen/endpoints": ["tls/127.0.0.1:7448"],
        "transport/auth/usrpwd/user": "planner",
        "transport/auth/usrpwd/dictionary_file": "users.txt",
        "transport/link/tls/root_ca_certificate": "ca.pem",
        "transport/link/tls/listen_certificate": "own.pem",
        "transport/link/tls/listen_private_key": "own.key",
        "transport/link/tls/connect_certificate": "own.pem",
        "transport/link/tls/connect_private_key": "own.key",
        "transport/link/tls/enable_mtls": True,
        "transport/link/tx/lease": 1500,
        "access_control/default_permission": "deny",
    }
    for key, value in wanted.items():
        assert config.get_json(key) in (value, _json(value)), key
    assert "hush-hush" not in repr(settings)


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


@pytest.mark.asyncio
async def test_a_free_port_is_chosen_and_told() -> None:
    async with ZenohBus(ROUTER, KEYS.delivery) as bus:
        (endpoint,) = bus.endpoints
        assert endpoint.startswith("tcp/127.0.0.1:")
        assert int(endpoint.rsplit(":", 1)[1]) > 0


@pytest.mark.asyncio
async def test_nobody_there_is_said_with_the_cure() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    nobody = ZenohSettings(
        connect=(f"tcp/127.0.0.1:{port}",), user="u", password="p", open_timeout_s=0.3
    )
    with pytest.raises(BusError, match=rf"{port}.*Is the mission running"):
        async with ZenohBus(nobody, KEYS.delivery):
            pass


@pytest.mark.asyncio
async def test_a_taken_port_is_said() -> None:
    async with ZenohBus(ROUTER, KEYS.delivery) as bus:
        again = ZenohSettings(mode=ZenohMode.ROUTER, listen=bus.endpoints)
        with pytest.raises(BusError, match=r"cannot listen on .* Is the port taken\?"):
            async with ZenohBus(again, KEYS.delivery):
                pass


@pytest.mark.asyncio
async def test_a_client_waits_for_a_mission_that_starts_later() -> None:
    async with ZenohBus(ROUTER, KEYS.delivery) as first:
        endpoints = first.endpoints
    client = ZenohBus(ZenohSettings(connect=endpoints, open_timeout_s=None), KEYS.delivery)
    opening = asyncio.ensure_future(client.__aenter__())
    await asyncio.sleep(0.3)
    assert not opening.done()
    async with ZenohBus(ZenohSettings(mode=ZenohMode.ROUTER, listen=endpoints), KEYS.delivery):
        async with asyncio.timeout(PATIENCE_S):
            await opening
        await client.__aexit__(None, None, None)


@pytest.mark.asyncio
async def test_opening_can_be_given_up_and_leaves_no_session() -> None:
    nobody = ZenohSettings(connect=("tcp/127.0.0.1:1",), open_timeout_s=None)
    opening = asyncio.ensure_future(ZenohBus(nobody, KEYS.delivery).__aenter__())
    await asyncio.sleep(0.1)
    opening.cancel()
    started = monotonic()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert monotonic() - started < 3.0 + patience_s()


@pytest.mark.asyncio
async def test_a_session_that_opens_after_it_was_given_up_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun, gate, closed = threading.Event(), threading.Event(), threading.Event()

    class Late:
        def close(self) -> None:
            closed.set()

    def opened(_: object) -> Late:
        begun.set()
        gate.wait(PATIENCE_S)
        return Late()

    monkeypatch.setattr("zenoh.open", opened)
    nobody = ZenohSettings(connect=("tcp/127.0.0.1:1",), open_timeout_s=None)
    opening = asyncio.ensure_future(ZenohBus(nobody, KEYS.delivery).__aenter__())
    await until(begun.is_set)
    for _ in range(3):
        opening.cancel()
        await asyncio.sleep(0)
    gate.set()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert closed.is_set()


class Starved:
    """A session whose first answers about tokens end before they begin."""

    def __init__(self, session: zenoh.Session, empty: int) -> None:
        self._session = session
        self._empty = empty

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def liveliness(self) -> Any:
        true = self._session.liveliness()
        return SimpleNamespace(declare_token=true.declare_token, get=self._ask)

    def _ask(self, key_expr: str, timeout: float) -> Iterable[zenoh.Reply]:
        self._empty -= 1
        return () if self._empty >= 0 else self._session.liveliness().get(key_expr, timeout=timeout)


@pytest.mark.asyncio
@pytest.mark.parametrize(("empty", "found"), [(2, (KEYS.alive(7),)), (3, ())])
async def test_two_empty_answers_hide_nobody(
    monkeypatch: pytest.MonkeyPatch, empty: int, found: tuple[str, ...]
) -> None:
    opened = zenoh.open
    monkeypatch.setattr("zenoh.open", lambda settings: Starved(opened(settings), empty))
    async with ZenohBus(ROUTER, KEYS.delivery) as bus:
        await bus.announce(KEYS.alive(7))
        assert await bus.present(KEYS.alive(None)) == found


@pytest.mark.asyncio
async def test_vehicles_come_back_by_themselves_when_the_mission_restarts() -> None:
    reader, tokens = Reader(), Reader()
    key = KEYS.robot(7, Topic.STATE)
    async with ZenohBus(ROUTER, KEYS.delivery) as first:
        endpoints = first.endpoints
        vehicle = ZenohBus(ZenohSettings(connect=endpoints), KEYS.delivery)
        await vehicle.__aenter__()
        await vehicle.announce(KEYS.alive(7))
    try:
        vehicle.publish(key, b"nobody hears this, and nothing breaks")
        again = ZenohSettings(mode=ZenohMode.ROUTER, listen=endpoints)
        async with ZenohBus(again, KEYS.delivery) as second:
            started = monotonic()
            await second.subscribe(key, reader.inbox)
            await second.watch(KEYS.alive(None), tokens.inbox)
            await reaches(vehicle, reader, key)
            await until(lambda: tokens.take())
            assert monotonic() - started < 3.0 + patience_s()
            assert tokens.take()[0].kind is SampleKind.PUT
    finally:
        await vehicle.__aexit__(None, None, None)


@pytest.mark.asyncio
async def test_a_user_with_a_password_gets_in_and_a_stranger_does_not(tmp_path: Path) -> None:
    users = tmp_path / "users.txt"
    users.write_text("planner:mission\nrobot7:falcon\n")
    router = ZenohSettings(
        mode=ZenohMode.ROUTER,
        listen=(LOOPBACK,),
        user="planner",
        password="mission",
        dictionary_file=str(users),
    )
    reader = Reader()
    key = KEYS.robot(7, Topic.STATE)
    async with ZenohBus(router, KEYS.delivery) as mission:
        await mission.subscribe(key, reader.inbox)
        known = ZenohSettings(connect=mission.endpoints, user="robot7", password="falcon")
        async with ZenohBus(known, KEYS.delivery) as vehicle:
            await reaches(vehicle, reader, key)
        stranger = ZenohSettings(
            connect=mission.endpoints, user="robot7", password="guess", open_timeout_s=0.2
        )
        with pytest.raises(BusError, match="a wrong user or password"):
            async with ZenohBus(stranger, KEYS.delivery):
                pass


@pytest.mark.asyncio
async def test_publishing_never_holds_up_the_loop_and_closing_leaves_no_thread() -> None:
    """Nobody reads, a thousand messages go: the loop is not held up by any of them."""
    before = {thread.name for thread in threading.enumerate()}
    async with ZenohBus(ROUTER, KEYS.delivery) as vehicle:
        worst = 0.0
        for number in range(1000):
            topic = Topic.EVENTS if number % 10 == 0 else Topic.STATE
            started = monotonic()
            vehicle.publish(KEYS.robot(7, topic), b"x" * 300)
            worst = max(worst, monotonic() - started)
        assert worst < 4.0, "a put that blocks would take five seconds"
        assert vehicle.dropped == 0
    left = {thread.name for thread in threading.enumerate()} - before
    assert not {name for name in left if name.startswith("zenoh-writer")}


@pytest.mark.asyncio
async def test_an_event_for_which_there_is_no_room_is_dropped_counted_and_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(zenoh_bus, "MAX_WAITING", 0)
    key = KEYS.robot(7, Topic.EVENTS)
    async with ZenohBus(ROUTER, KEYS.delivery) as vehicle:
        for _ in range(100):
            vehicle.publish(key, b"x")
        assert vehicle.dropped == 100
    assert 1 <= caplog.text.count(f"an event on {key} is dropped") <= MOST
