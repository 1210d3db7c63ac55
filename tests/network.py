"""Keeps tests off the real network.

An audit hook sees every connection and name look-up of Python's sockets, whatever library makes
it. It cannot be removed again, which is what a whole test run wants.
"""

import ipaddress
import socket
import sys
from typing import Any

LOCAL_NAMES = frozenset({"", "localhost", "ip6-localhost"})


class NetworkBlockedError(RuntimeError):
    """Raised when a test reaches for an address beyond this machine."""


def is_local(host: object) -> bool:
    """Tell whether a host, as given to the socket module, stays on this machine."""
    if host is None:
        return True
    name = host.decode("idna") if isinstance(host, bytes) else str(host)
    if name in LOCAL_NAMES:
        return True
    try:
        address = ipaddress.ip_address(name.split("%")[0])
    except ValueError:
        return False
    return address.is_loopback or address.is_unspecified


def block_network() -> None:
    """Refuse, from now on and in this process, every connection that leaves the machine."""
    sys.addaudithook(_refuse_remote)


def _refuse_remote(event: str, arguments: tuple[Any, ...]) -> None:
    if event in {"socket.connect", "socket.sendto"}:
        connection, address = arguments
        if connection.family in {socket.AF_INET, socket.AF_INET6} and not is_local(address[0]):
            raise NetworkBlockedError(f"tests may not connect to {address[0]}")
    elif event == "socket.getaddrinfo" and not is_local(arguments[0]):
        raise NetworkBlockedError(f"tests may not look up {arguments[0]}")
