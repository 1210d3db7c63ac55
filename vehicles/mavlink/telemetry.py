"""What an autopilot has told of its vehicle, newest word first."""

from collections import deque
from dataclasses import dataclass, field

from vehicles.mavlink.frames import Vector, flipped, heading_of_yaw
from vehicles.mavlink.protocol import Message, mavlink

MAX_TEXTS = 32
"""Texts kept until they are taken; a flood of them pushes out the oldest."""

REBOOT_MS = 5_000
"""Time since boot running backwards by more is a reboot, by less a late datagram."""

_GROUNDED = mavlink.MAV_LANDED_STATE_ON_GROUND
_LOW_CHARGE = frozenset(
    {
        mavlink.MAV_BATTERY_CHARGE_STATE_LOW,
        mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL,
        mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
        mavlink.MAV_BATTERY_CHARGE_STATE_FAILED,
    }
)


@dataclass(frozen=True, slots=True)
class StatusText:
    """A line the autopilot says to people."""

    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""

    text: str
    at_s: float


@dataclass(slots=True)
class Telemetry:
    """The vehicle as last heard; times are the receiver's monotonic seconds, None for never.

    `receive` takes checked messages only. Vectors are in the vehicle's local ENU frame.
    """

    heard_s: float | None = None
    heartbeat_s: float | None = None
    mode: int | None = None
    armed: bool = False
    critical: bool = False
    """The autopilot calls its own state critical or worse."""

    landed: bool | None = None
    """None where it does not say; a disarmed vehicle counts as landed."""

    position_s: float | None = None
    position: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    boot_ms: int = 0
    attitude_s: float | None = None
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    """Anticlockwise from east."""

    battery: float | None = None
    battery_low: bool = False
    """The autopilot calls the battery low or worse."""

    fence_breached: bool = False
    global_ms: int = 0
    global_place: Vector | None = None
    """Latitude (deg), longitude (deg), altitude above mean sea level (m)."""

    origin: Vector | None = None
    """Latitude, longitude, altitude of the local frame's origin."""

    home: tuple[Vector, Vector] | None = None
    """Latitude, longitude, altitude of home, and home in the local ENU frame."""

    texts: deque[StatusText] = field(default_factory=lambda: deque(maxlen=MAX_TEXTS))

    @property
    def airborne(self) -> bool:
        """Whether it flies, as far as it says."""
        return self.armed and not self.landed

    def position_at(self, now_s: float) -> Vector:
        """Return where it is now if it has kept its last velocity."""
        age_s = 0.0 if self.position_s is None else now_s - self.position_s
        x, y, z = (p + v * age_s for p, v in zip(self.position, self.velocity, strict=True))
        return (x, y, z)

    def receive(self, message: Message, now_s: float) -> None:
        """Take one sound and plausible message; kinds that tell us nothing are ignored."""
        self.heard_s = now_s
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._heartbeat(message, now_s)
        elif kind == "LOCAL_POSITION_NED":
            self._local_position(message, now_s)
        elif kind == "ATTITUDE":
            self.attitude_s = now_s
            self.roll_rad, self.pitch_rad = message.roll, message.pitch
            self.yaw_rad = heading_of_yaw(message.yaw)
        elif kind == "EXTENDED_SYS_STATE":
            state = message.landed_state
            self.landed = None if state == 0 else state == _GROUNDED
        elif kind == "STATUSTEXT":
            self.texts.append(StatusText(message.severity, _printable(message.text), now_s))
        else:
            self._receive_rare(kind, message)

    def _receive_rare(self, kind: str, message: Message) -> None:
        if kind == "SYS_STATUS":
            left = message.battery_remaining
            self.battery = None if left < 0 else left / 100.0
        elif kind == "BATTERY_STATUS" and message.id == 0:
            self.battery_low = message.charge_state in _LOW_CHARGE
        elif kind == "FENCE_STATUS":
            self.fence_breached = bool(message.breach_status)
        elif kind == "GLOBAL_POSITION_INT":
            self.global_ms = message.time_boot_ms
            self.global_place = _place(message.lat, message.lon, message.alt)
        elif kind == "GPS_GLOBAL_ORIGIN":
            self.origin = _place(message.latitude, message.longitude, message.altitude)
        elif kind == "HOME_POSITION":
            place = _place(message.latitude, message.longitude, message.altitude)
            self.home = (place, flipped((message.x, message.y, message.z)))

    def _heartbeat(self, message: Message, now_s: float) -> None:
        self.heartbeat_s = now_s
        self.mode = message.custom_mode
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.critical = message.system_status in (
            mavlink.MAV_STATE_CRITICAL,
            mavlink.MAV_STATE_EMERGENCY,
        )

    def _local_position(self, message: Message, now_s: float) -> None:
        behind_ms = self.boot_ms - message.time_boot_ms
        if self.position_s is not None and 0 < behind_ms < REBOOT_MS:
            return
        self.position_s, self.boot_ms = now_s, message.time_boot_ms
        self.position = flipped((message.x, message.y, message.z))
        self.velocity = flipped((message.vx, message.vy, message.vz))


def _place(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> Vector:
    return (latitude_e7 / 1e7, longitude_e7 / 1e7, altitude_mm / 1e3)


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)
