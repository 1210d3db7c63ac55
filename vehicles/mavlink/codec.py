"""Datagrams to messages and back; what is not sound stays outside and is counted."""

from dataclasses import dataclass

from vehicles.mavlink.protocol import Message, mavlink
from vehicles.mavlink.signing import Parser, SigningKey

MAX_DATAGRAM = 4096
"""Bytes; a longer datagram is no MAVLink sender's and is refused unread."""

_FRAME_HEADER = 8
"""What pymavlink expects before it has seen a frame's length."""


@dataclass(slots=True)
class Counts:
    """How many frames came in, and why some went no further."""

    accepted: int = 0
    bad: int = 0
    """Wrong checksum, wrong or missing signature, replay, or no MAVLink at all."""

    unknown: int = 0
    """Not of the dialect: their checksum cannot even be checked."""

    foreign: int = 0
    """From another system than the one we fly."""

    oversized: int = 0
    truncated: int = 0
    implausible: int = 0
    """NaN or out of range."""


class Codec:
    """One end of a link as another party of the same or another system.

    Args:
        system: Our system id.
        component: Our component id.
        peer: System id of the only sender listened to, None for any.
        key: For signing; unsigned messages are refused then.
    """

    def __init__(
        self, system: int, component: int, peer: int | None, key: SigningKey | None
    ) -> None:
        self.counts = Counts()
        self.stranger: int | None = None
        """The first other system that was heard on the link."""

        self._peer = peer
        self._key = key
        self._parser = Parser(None, system, component)
        self._parser.robust_parsing = True
        if key is not None:
            self._parser.signing.secret_key = key.secret
            self._parser.signing.link_id = key.link_id
            self._parser.signing.sign_outgoing = True

    def decode(self, datagram: bytes, now_s: float) -> list[Message]:
        """Return the sound messages of a datagram; never raises.

        A datagram holds whole frames, so what is left of one is dropped rather than glued to the
        next.
        """
        if len(datagram) > MAX_DATAGRAM:
            self.counts.oversized += 1
            return []
        self._set_clock(now_s)
        messages = self._parser.parse_buffer(datagram) or []
        if self._parser.buf_len():
            self.counts.truncated += 1
            self._parser.buf = bytearray()
            self._parser.buf_index = 0
        self._parser.expected_length = _FRAME_HEADER
        return [message for message in messages if self._is_sound(message)]

    def encode(self, message: Message, now_s: float) -> bytes:
        """Return the frame of a message, with the next sequence number and signature."""
        self._set_clock(now_s)
        frame: bytes = message.pack(self._parser)
        self._parser.seq = (self._parser.seq + 1) % 256
        return frame

    def _set_clock(self, now_s: float) -> None:
        if self._key is not None:
            signing = self._parser.signing
            signing.timestamp = max(signing.timestamp, self._key.timestamp(now_s))

    def _is_sound(self, message: Message) -> bool:
        kind = message.get_type()
        if kind == "BAD_DATA":
            self.counts.bad += 1
            return False
        if kind.startswith("UNKNOWN"):
            self.counts.unknown += 1
            return False
        if self._peer is not None and message.get_srcSystem() != self._peer:
            self.counts.foreign += 1
            if self.stranger is None:
                self.stranger = message.get_srcSystem()
            return False
        self.counts.accepted += 1
        return True


AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
"""Component id of an autopilot."""

COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
"""Component id of an onboard computer, which is what we are."""
