"""MAVLink 2 signing: key files and the clock of signatures.

A signature carries a timestamp in units of 10 microseconds since 2015 that must only grow. The
wall clock is read once, when the link starts; from then on the monotonic clock counts, so that a
clock set back in flight does not make every further message look like a replay.
"""

import re
import stat
import time
from dataclasses import dataclass, field
from pathlib import Path

from vehicles.mavlink.protocol import mavlink

KEY_BYTES = 32
EPOCH_2015_S = 1_420_070_400
TICKS_PER_S = 100_000
_HEX_KEY = re.compile(rb"[0-9a-fA-F]{64}")


class SigningError(ValueError):
    """Raised when a signing key cannot be used."""


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The secret both ends of a link share, and when this end started."""

    secret: bytes = field(repr=False)
    started_wall_s: float
    """Seconds since 1970 by the wall clock when the link started."""

    started_s: float
    """The same moment on the monotonic clock."""

    link_id: int = 0

    def timestamp(self, now_s: float) -> int:
        """Return the signature timestamp of a moment of the monotonic clock."""
        wall_s = self.started_wall_s + max(now_s - self.started_s, 0.0)
        return int(max(wall_s - EPOCH_2015_S, 0.0) * TICKS_PER_S)


def read_key(path: Path) -> bytes:
    """Return the 32 bytes of a key file: raw, or 64 hexadecimal digits.

    Raises:
        SigningError: The file cannot be read, others than its owner may read it, or it holds no
            key.
    """
    try:
        readable = path.stat().st_mode & (stat.S_IRGRP | stat.S_IROTH)
        content = path.read_bytes()
    except OSError as error:
        raise SigningError(f"cannot read the signing key {path}: {error.strerror}") from error
    if readable:
        raise SigningError(f"others may read the signing key {path}: chmod 600 it")
    if len(content) == KEY_BYTES:
        return content
    if _HEX_KEY.fullmatch(content.strip()):
        return bytes.fromhex(content.strip().decode("ascii"))
    raise SigningError(f"the signing key {path} is neither 32 bytes nor 64 hexadecimal digits")


def signing_key(path: Path | None) -> SigningKey | None:
    """Return the key of a file as of now, None without a file.

    Raises:
        SigningError: The file does not serve.
    """
    return None if path is None else SigningKey(read_key(path), time.time(), time.monotonic())


class Parser(mavlink.MAVLink):  # type: ignore[misc]
    """pymavlink's codec, whose memory of timestamps only genuine frames can move.

    The original notes a frame's timestamp before it has checked the signature, so that one forged
    frame from the far future would silence the genuine sender for good.
    """

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        """Tell whether a frame is signed with our key and newer than those before it."""
        stream = (msgbuf[-13], srcSystem, srcComponent)
        before = self.signing.stream_timestamps.get(stream)
        genuine = bool(super().check_signature(msgbuf, srcSystem, srcComponent))
        if not genuine and before is None:
            self.signing.stream_timestamps.pop(stream, None)
        elif not genuine:
            self.signing.stream_timestamps[stream] = before
        return genuine
