"""An autopilot's side of a link, for tests that speak to a codec or a session."""

from vehicles.mavlink.codec import AUTOPILOT, Codec
from vehicles.mavlink.protocol import Message, mavlink
from vehicles.mavlink.signing import SigningKey


class Speaker:
    """Encodes messages as an autopilot (or anybody else) sends them."""

    def __init__(
        self, system: int = 7, component: int = AUTOPILOT, key: SigningKey | None = None
    ) -> None:
        self._codec = Codec(system, component, None, key)

    def say(self, message: Message, now_s: float = 0.0) -> bytes:
        return self._codec.encode(message, now_s)


def heartbeat(mode: int = 4, armed: bool = True, identity: int = 3, status: int = 4) -> Message:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if armed:
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return mavlink.MAVLink_heartbeat_message(2, identity, base, mode, status, 3)


def local_position(
    boot_ms: int = 1000,
    ned: tuple[float, float, float] = (0.0, 0.0, -2.0),
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Message:
    return mavlink.MAVLink_local_position_ned_message(boot_ms, *ned, *velocity)


def text(words: str, severity: int = 4) -> Message:
    return mavlink.MAVLink_statustext_message(severity, words.encode("utf-8"))
