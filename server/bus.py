"""A party's place on the bus, as the settings say."""

from dataclasses import replace
from pathlib import Path

from server.settings import Settings
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

LOOPBACK = ZenohSettings(mode=ZenohMode.ROUTER, listen=("tcp/127.0.0.1:0",))
"""A bus of its own, for vehicles that are simulated beside the planner."""


def planner_bus(settings: Settings) -> ZenohSettings:
    """Return the planner's session: a router where it listens, a client of another router.

    Raises ValueError when half of a pair (user and password, certificate and key) is missing.
    """
    connect, listen = _endpoints(settings)
    if not connect and not listen:
        return LOOPBACK
    mode = ZenohMode.ROUTER if listen else ZenohMode.CLIENT
    return _secured(ZenohSettings(mode=mode, connect=connect, listen=listen), settings)


def vehicle_bus(settings: Settings) -> ZenohSettings:
    """Return a vehicle's session: always a client.

    Raises ValueError when the settings name nothing to connect to.
    """
    connect, _ = _endpoints(settings)
    return _secured(ZenohSettings(connect=connect), settings)


def _endpoints(settings: Settings) -> tuple[tuple[str, ...], tuple[str, ...]]:
    connect = () if settings.zenoh_connect is None else (settings.zenoh_connect,)
    listen = () if settings.zenoh_listen is None else (settings.zenoh_listen,)
    return connect, listen


def _secured(bus: ZenohSettings, settings: Settings) -> ZenohSettings:
    password = settings.zenoh_password
    return replace(
        bus,
        user=settings.zenoh_user,
        password=None if password is None else password.get_secret_value(),
        tls_root_ca=_text(settings.zenoh_tls_root_ca),
        tls_certificate=_text(settings.zenoh_tls_certificate),
        tls_key=_text(settings.zenoh_tls_key),
        config_file=_text(settings.zenoh_config_file),
    )


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
