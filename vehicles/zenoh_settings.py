"""How a party reaches the others over Zenoh.

Everything is explicit: no multicast, no gossip, endpoints as given. The mission's session is a
router (vehicles on it reach it, not each other, unless the configuration file allows it), the
vehicles' sessions are clients.
"""

import json
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import zenoh


class ZenohMode(StrEnum):
    """A session's place in the network."""

    PEER = "peer"
    CLIENT = "client"
    ROUTER = "router"


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """One session's configuration.

    Raises:
        ValueError: A client has nothing to connect to, another party neither that nor anything
            to listen on, or half of a pair is missing.
    """

    mode: ZenohMode = ZenohMode.CLIENT
    connect: tuple[str, ...] = ()
    """Endpoints such as tcp/127.0.0.1:7447 or tls/host:7447."""

    listen: tuple[str, ...] = ()
    """Endpoints to listen on; port 0 takes a free one."""

    user: str | None = None
    password: str | None = field(default=None, repr=False)
    dictionary_file: str | None = None
    """user:password lines that a listening party accepts."""

    tls_root_ca: str | None = None
    """Path of the certificate that signs the others'."""

    tls_certificate: str | None = None
    tls_key: str | None = None
    """Paths of this party's own certificate and key, listening or connecting."""

    tls_mutual: bool = False
    """Listening: ask for the others' certificates too."""

    config_file: str | None = None
    """A Zenoh file for everything else (access control); the above comes on top."""

    lease_ms: int = 1000
    """A link silent for so long is dead."""

    open_timeout_s: float | None = 10.0
    """How long opening waits for the first connection; None for ever."""

    def __post_init__(self) -> None:
        if self.mode is ZenohMode.CLIENT and not self.connect:
            raise ValueError("a Zenoh client needs an endpoint to connect to")
        if not self.connect and not self.listen:
            raise ValueError("a Zenoh session needs an endpoint to connect to or to listen on")
        for one, other, words in (
            (self.user, self.password, "user and password"),
            (self.tls_certificate, self.tls_key, "certificate and key"),
        ):
            if (one is None) != (other is None):
                raise ValueError(f"Zenoh {words} must be given together")

    @property
    def has_free_port(self) -> bool:
        """Whether a port is still to be chosen by the system."""
        return any(endpoint.split("?")[0].endswith(":0") for endpoint in self.listen)


def configuration(settings: ZenohSettings, connect_timeout_ms: int) -> zenoh.Config:
    """Return a session's configuration.

    Raises:
        zenoh.ZError: The configuration file or a value is not one Zenoh understands.
    """
    config = (
        zenoh.Config()
        if settings.config_file is None
        else zenoh.Config.from_file(settings.config_file)
    )
    for key, value in _entries(settings, connect_timeout_ms).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _entries(settings: ZenohSettings, connect_timeout_ms: int) -> dict[str, Any]:
    retry = {"period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5}
    entries: dict[str, Any] = {
        "mode": settings.mode.value,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/endpoints": list(settings.connect),
        "connect/timeout_ms": connect_timeout_ms,
        "connect/retry": retry,
        "listen/endpoints": list(settings.listen),
        "transport/link/tx/lease": settings.lease_ms,
    }
    if settings.has_free_port:
        # The admin space is the only place where the port that was chosen can be read.
        entries["adminspace/enabled"] = True
    given = {
        "transport/auth/usrpwd/user": settings.user,
        "transport/auth/usrpwd/password": settings.password,
        "transport/auth/usrpwd/dictionary_file": settings.dictionary_file,
        "transport/link/tls/root_ca_certificate": settings.tls_root_ca,
        "transport/link/tls/listen_certificate": settings.tls_certificate,
        "transport/link/tls/listen_private_key": settings.tls_key,
    }
    if settings.tls_mutual:
        entries["transport/link/tls/enable_mtls"] = True
    if settings.connect:
        given["transport/link/tls/connect_certificate"] = settings.tls_certificate
        given["transport/link/tls/connect_private_key"] = settings.tls_key
    return entries | {key: value for key, value in given.items() if value is not None}
