"""Why a Zenoh session could not be opened, in words that name the cure.

Zenoh says "timeout" for everything: nobody listens, a wrong password, a certificate that is not
trusted. Whether anybody listens can be told by knocking, so it is told.
"""

import asyncio
import contextlib
import re
from enum import StrEnum

import zenoh

from vehicles.zenoh_settings import ZenohSettings

KNOCK_S = 1.0
"""How long an endpoint may take to accept a bare connection."""

_SOURCE = re.compile(r" at [^ ]*\.rs:\d+\.*")
"""Where in Zenoh's own source an error arose: of no use to anybody here."""

_ENDPOINT = re.compile(r"(?:tcp|tls)/(?:\[(?P<v6>[^\]]+)\]|(?P<host>[^:/?#]+)):(?P<port>\d{1,5})\b")


class Knock(StrEnum):
    """What became of a bare connection."""

    ANSWERED = "answered"
    SILENT = "silent"
    UNKNOWN = "unknown"
    """The protocol has no bare connections."""


async def refusal(settings: ZenohSettings, error: zenoh.ZError) -> str:
    """Return what is wrong, where, and what to look at."""
    told = _SOURCE.sub("", str(error)).strip().rstrip(".!")
    if not settings.connect:
        where = ", ".join(settings.listen)
        words = f"cannot listen on {where}: {told}. Is the port taken?"
        if settings.files:
            words += f" Are {', '.join(settings.files)} what they should be?"
        return words
    where = ", ".join(settings.connect)
    knocks = [await knock(endpoint) for endpoint in settings.connect]
    if Knock.ANSWERED in knocks:
        return f"something answers at {where} but does not let us in: {_suspects(settings)}"
    words = f"nothing answers at {where}: {told}. Is the mission running there?"
    if settings.user is not None and Knock.UNKNOWN in knocks:
        words += " A wrong user or password looks the same."
    return words


async def knock(endpoint: str) -> Knock:
    """Return whether anything accepts a connection at an endpoint."""
    found = _ENDPOINT.match(endpoint)
    if found is None or not 0 < int(found["port"]) < 2**16:
        return Knock.UNKNOWN
    try:
        async with asyncio.timeout(KNOCK_S):
            _, writer = await asyncio.open_connection(found["v6"] or found["host"], found["port"])
    except (OSError, TimeoutError):
        return Knock.SILENT
    writer.close()
    with contextlib.suppress(OSError):
        await writer.wait_closed()
    return Knock.ANSWERED


def _suspects(settings: ZenohSettings) -> str:
    """Return what may be wrong, the likeliest first; Zenoh does not say which it is."""
    secure = any(endpoint.startswith(("tls/", "quic/")) for endpoint in settings.connect)
    suspects = []
    if settings.user is None:
        suspects.append("it may ask for a user and password, and none are set")
    else:
        suspects.append("a wrong user or password shows as nothing else")
    if secure:
        suspects.append(
            "its certificate is not signed by our root authority or does not name this host"
        )
        if settings.tls_certificate is None:
            suspects.append("it may ask for a certificate of ours")
        else:
            suspects.append("our certificate is not one it trusts")
    else:
        suspects.append("it may speak TLS only (tls/ instead of tcp/)")
    suspects.append("it may be no Zenoh party at all")
    return "; ".join(suspects)
