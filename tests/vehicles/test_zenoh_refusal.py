"""A session that does not open: the error tells nobody there from not let in."""

import asyncio
import logging
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio

from tests.vehicles.buses import KEYS, LOOPBACK, until
from vehicles import zenoh_bus
from vehicles.bus import BusError
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_refusal import Knock, knock
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

pytestmark = pytest.mark.sockets


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
    return port


@pytest_asyncio.fixture
async def guarded(tmp_path: Path) -> AsyncIterator[str]:
    """A router that wants a user and a password."""
    users = tmp_path / "users.txt"
    users.write_text("robot7:falcon\n")
    settings = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,), dictionary_file=str(users))
    async with ZenohBus(settings, KEYS.delivery) as bus:
        yield bus.endpoints[0]


async def refusal_of(settings: ZenohSettings) -> str:
    with pytest.raises(BusError) as caught:
        async with ZenohBus(settings, KEYS.delivery):
            pass
    return str(caught.value)


@pytest.mark.asyncio
async def test_a_wrong_password_is_named_first(guarded: str) -> None:
    wrong = ZenohSettings(
        connect=(guarded,), user="robot7", password="hush-hush", open_timeout_s=0.1
    )
    said = await refusal_of(wrong)
    assert said.startswith(f"something answers at {guarded} but does not let us in: a wrong user")
    assert "hush-hush" not in said


@pytest.mark.asyncio
async def test_a_missing_password_is_named(guarded: str) -> None:
    said = await refusal_of(ZenohSettings(connect=(guarded,), open_timeout_s=0.1))
    assert "it may ask for a user and password, and none are set" in said
    assert "TLS only" in said


@pytest.mark.asyncio
async def test_nobody_there_is_not_blamed_on_the_password() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    said = await refusal_of(
        ZenohSettings(connect=(where,), user="a", password="b", open_timeout_s=0.1)
    )
    assert said.startswith(f"nothing answers at {where}")
    assert "Is the mission running there?" in said
    assert "password" not in said
    assert ".rs" not in said, "where in Zenoh's source it arose helps nobody"


@pytest.mark.asyncio
async def test_files_are_named_when_listening_fails(tmp_path: Path) -> None:
    settings = ZenohSettings(
        mode=ZenohMode.ROUTER,
        listen=("tls/127.0.0.1:0",),
        tls_certificate=str(tmp_path / "no.pem"),
        tls_key=str(tmp_path / "no.key"),
    )
    said = await refusal_of(settings)
    assert "cannot listen on tls/127.0.0.1:0" in said
    assert "no.pem" in said


@pytest.mark.asyncio
async def test_waiting_for_ever_is_not_waiting_in_silence(
    guarded: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(zenoh_bus, "TELL_AFTER_S", 0.0)
    waiting = ZenohSettings(connect=(guarded,), user="a", password="b", open_timeout_s=None)
    with caplog.at_level(logging.WARNING):
        opening = asyncio.ensure_future(ZenohBus(waiting, KEYS.delivery).__aenter__())
        await until(lambda: caplog.messages)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
    assert caplog.messages == [
        message for message in caplog.messages if message.startswith("still waiting: something")
    ]
    assert len(caplog.messages) == 1


@pytest.mark.asyncio
async def test_an_endpoint_open_to_other_machines_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    users = tmp_path / "users.txt"
    users.write_text("robot7:falcon\n")
    open_to_all = ZenohSettings(mode=ZenohMode.ROUTER, listen=("tcp/0.0.0.0:7447",))
    assert open_to_all.is_exposed
    asked = ZenohSettings(
        mode=ZenohMode.ROUTER, listen=("tcp/0.0.0.0:7447",), dictionary_file=str(users)
    )
    assert not asked.is_exposed
    async with ZenohBus(ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,)), KEYS.delivery):
        assert "may fly this team" not in caplog.text


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        ("quic/127.0.0.1:7447", Knock.UNKNOWN),
        ("tcp/127.0.0.1:99999", Knock.UNKNOWN),
        ("nonsense", Knock.UNKNOWN),
        ("tcp/127.0.0.1:{free}", Knock.SILENT),
        ("tls/[::1]:{free}", Knock.SILENT),
    ],
)
@pytest.mark.asyncio
async def test_knocking(endpoint: str, expected: Knock) -> None:
    assert await knock(endpoint.format(free=free_port())) is expected


@pytest.mark.asyncio
async def test_somebody_who_answers_is_heard(guarded: str) -> None:
    assert await knock(guarded) is Knock.ANSWERED
