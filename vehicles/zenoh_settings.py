"""How a party reaches the others over Zenoh.

Everything is explicit: no multicast, no gossip, endpoints as given. The mission's session is a
router (vehicles on it reach it, not each other, unless the configuration file allows it), the
vehicles' sessions are clients.
"""

import json
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import zenoh

from vehicles.zenoh_access import AccessRules, Proof, access_control


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

    access: AccessRules | None = None
    """Listening: who may say and hear what; takes a dictionary file or mutual TLS."""

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
        if self.tls_mutual and (self.tls_root_ca is None or self.tls_certificate is None):
            raise ValueError(
                "mutual TLS needs the authority's certificate, and a certificate and key of our own"
            )
        if self.access is not None and not self.proofs:
            raise ValueError("access rules need users or certificates to tell parties apart")

    @property
    def files(self) -> tuple[str, ...]:
        """Every file it names."""
        named = (
            self.dictionary_file,
            self.tls_root_ca,
            self.tls_certificate,
            self.tls_key,
            self.config_file,
        )
        return tuple(file for file in named if file is not None)

    @property
    def is_exposed(self) -> bool:
        """Whether anybody on another machine may come in and say anything."""
        inside = ("127.", "localhost", "[::1]")
        hosts = [endpoint.partition("/")[2] for endpoint in self.listen]
        return not self.proofs and any(not host.startswith(inside) for host in hosts)

    @property
    def proofs(self) -> tuple[Proof, ...]:
        """How parties show this one who they are."""
        by_user = () if self.dictionary_file is None else (Proof.USER,)
        return (*by_user, Proof.CERTIFICATE) if self.tls_mutual else by_user

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


def described(settings: ZenohSettings) -> str:
    """Return a session's configuration as JSON that zenohd reads, its password left out."""
    tree: dict[str, Any] = {}
    for key, value in _entries(replace(settings, user=None, password=None), -1).items():
        *path, last = key.split("/")
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return json.dumps(tree, indent=2)


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
    if settings.access is not None:
        entries["access_control"] = access_control(settings.access, settings.proofs)
    # Zenoh shows its own certificate only where this is set, and asks for the others' then too.
    shows = settings.tls_certificate is not None and not settings.listen
    if settings.tls_mutual or shows:
        entries["transport/link/tls/enable_mtls"] = True
    if settings.connect:
        given["transport/link/tls/connect_certificate"] = settings.tls_certificate
        given["transport/link/tls/connect_private_key"] = settings.tls_key
    return entries | {key: value for key, value in given.items() if value is not None}
