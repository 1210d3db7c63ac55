"""Which numbers of a message can be true.

Only messages listed here are read at all. NaN lies inside no range.
"""

from collections.abc import Mapping
from math import pi

from vehicles.mavlink.protocol import Message

Ranges = Mapping[str, tuple[float, float]]

_ANGLE = (-2.0 * pi, 2.0 * pi)
_RATE = (-200.0, 200.0)
_LENGTH = (-1e6, 1e6)
_SPEED = (-1e3, 1e3)
_SIGHT = (-200.0, 200.0)
_LATITUDE = (-900_000_000, 900_000_000)
_LONGITUDE = (-1_800_000_000, 1_800_000_000)
_ALTITUDE_MM = (-1_000_000, 100_000_000)

PLAUSIBLE: Mapping[str, Ranges] = {
    "HEARTBEAT": {"system_status": (0, 8)},
    "SYS_STATUS": {"battery_remaining": (-1, 100)},
    "EXTENDED_SYS_STATE": {"landed_state": (0, 4)},
    "LOCAL_POSITION_NED": {
        **dict.fromkeys(("x", "y", "z"), _LENGTH),
        **dict.fromkeys(("vx", "vy", "vz"), _SPEED),
    },
    "GLOBAL_POSITION_INT": {"lat": _LATITUDE, "lon": _LONGITUDE, "alt": _ALTITUDE_MM},
    "ATTITUDE": {
        **dict.fromkeys(("roll", "pitch", "yaw"), _ANGLE),
        **dict.fromkeys(("rollspeed", "pitchspeed", "yawspeed"), _RATE),
    },
    "GPS_GLOBAL_ORIGIN": {
        "latitude": _LATITUDE,
        "longitude": _LONGITUDE,
        "altitude": _ALTITUDE_MM,
    },
    "HOME_POSITION": {
        "latitude": _LATITUDE,
        "longitude": _LONGITUDE,
        "altitude": _ALTITUDE_MM,
        **dict.fromkeys(("x", "y", "z"), _LENGTH),
    },
    "BATTERY_STATUS": {"battery_remaining": (-1, 100), "charge_state": (0, 7)},
    "FENCE_STATUS": {"breach_status": (0, 1)},
    "STATUSTEXT": {"severity": (0, 7)},
    "COMMAND_ACK": {"result": (0, 9)},
    "LANDING_TARGET": dict.fromkeys(("x", "y", "z"), _SIGHT),
}
"""Message name to field to its least and greatest plausible value."""


def plausible(message: Message) -> bool:
    """Tell whether every number we would read of a message lies in its range."""
    ranges = PLAUSIBLE.get(message.get_type(), {})
    return all(low <= getattr(message, name) <= high for name, (low, high) in ranges.items())
