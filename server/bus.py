"""A party's place on the bus, as the settings say."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from server.settings import Settings, SettingsError
from vehicles.zenoh_access import AccessRules
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

LOOPBACK = ZenohSettings(mode=ZenohMode.ROUTER, listen=("tcp/127.0.0.1:0",))
"""A bus of its own, for vehicles that are simulated beside the planner."""


def planner_bus(settings: Settings, team: str, robot_ids: Iterable[int]) -> ZenohSettings:
    """Return the planner's session: a router where it listens, a client of another router.

    Raises SettingsError when half of a pair (user and password, certificate and key) is missing.
    """
    connect, listen = _endpoints(settings)
    if not connect and not listen:
        return LOOPBACK
    if listen:
        return router_bus(settings, team, robot_ids)
    return vehicle_bus(settings)


def router_bus(settings: Settings, team: str, robot_ids: Iterable[int]) -> ZenohSettings:
    """Return the session of a router that listens for a team, with the team's access rules.

    The rules hold where parties can be told apart (a file of users, mutual TLS), unless the
    settings say `open` or Zenoh's own file says more.

    Raises SettingsError when half of a pair is missing or there is nothing to listen on.
    """
    connect, listen = _endpoints(settings)
    if not listen:
        raise SettingsError("FALCONER_ZENOH_LISTEN: a router needs an endpoint to listen on")
    bus = _secured(settings, ZenohMode.ROUTER, connect, listen)
    if not bus.proofs or settings.zenoh_access == "open" or bus.config_file is not None:
        return bus
    return replace(bus, access=AccessRules(team, tuple(robot_ids)))


def vehicle_bus(settings: Settings) -> ZenohSettings:
    """Return a vehicle's session: always a client.

    Raises SettingsError when the settings name nothing to connect to, or half of a pair is missing.
    """
    connect, _ = _endpoints(settings)
    return _secured(settings, ZenohMode.CLIENT, connect, ())


def _endpoints(settings: Settings) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return _listed(settings.zenoh_connect), _listed(settings.zenoh_listen)


def _listed(endpoints: str | None) -> tuple[str, ...]:
    """Return the endpoints between commas."""
    parts = (part.strip() for part in (endpoints or "").split(","))
    return tuple(part for part in parts if part)


def _secured(
    settings: Settings, mode: ZenohMode, connect: tuple[str, ...], listen: tuple[str, ...]
) -> ZenohSettings:
    password = settings.zenoh_password
    try:
        bus = ZenohSettings(
            mode=mode,
            connect=connect,
            listen=listen,
            user=settings.zenoh_user,
            password=None if password is None else password.get_secret_value(),
            dictionary_file=_text(settings.zenoh_users_file) if listen else None,
            tls_root_ca=_text(settings.zenoh_tls_root_ca),
            tls_certificate=_text(settings.zenoh_tls_certificate),
            tls_key=_text(settings.zenoh_tls_key),
            tls_mutual=settings.zenoh_tls_mutual and bool(listen),
            config_file=_text(settings.zenoh_config_file),
        )
    except ValueError as error:
        raise SettingsError(f"FALCONER_ZENOH_*: {error}") from error
    for file in bus.files:
        if not Path(file).is_file():
            raise SettingsError(f"FALCONER_ZENOH_*: there is no file {file}")
    return bus


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
