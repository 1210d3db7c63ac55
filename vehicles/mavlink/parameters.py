"""The few parameters the simulated autopilot has, and the parameter protocol."""

import math

from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.protocol import Message, mavlink

_TAKE_OFF_ALTITUDE = {Autopilot.ARDUPILOT: "PILOT_TKOFF_ALT", Autopilot.PX4: "MIS_TAKEOFF_ALT"}
_DEFAULTS = {
    Autopilot.ARDUPILOT: {"GUID_TIMEOUT": 3.0, "PILOT_TKOFF_ALT": 2.5, "SYSID_THISMAV": 1.0},
    Autopilot.PX4: {"COM_OF_LOSS_T": 1.0, "MIS_TAKEOFF_ALT": 2.5, "MPC_XY_VEL_MAX": 10.0},
}


class Parameters:
    """Named numbers that a ground station reads and writes."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._take_off_altitude = _TAKE_OFF_ALTITUDE[autopilot]
        self._values = dict(_DEFAULTS[autopilot])

    @property
    def take_off_altitude_m(self) -> float:
        """Altitude of a take-off that names none, metres."""
        return self._values[self._take_off_altitude]

    def answer(self, message: Message) -> list[Message]:
        """Return the answer to a message of the parameter protocol."""
        kind, names = message.get_type(), list(self._values)
        if kind == "PARAM_REQUEST_LIST":
            return [self._value(name) for name in names]
        if kind == "PARAM_REQUEST_READ":
            if 0 <= message.param_index < len(names):
                return [self._value(names[message.param_index])]
            return [self._value(message.param_id)] if message.param_id in self._values else []
        if kind == "PARAM_SET" and message.param_id in self._values:
            if math.isfinite(message.param_value):
                self._values[message.param_id] = message.param_value
            return [self._value(message.param_id)]
        return []

    def _value(self, name: str) -> Message:
        return mavlink.MAVLink_param_value_message(
            name.encode("ascii"),
            self._values[name],
            mavlink.MAV_PARAM_TYPE_REAL32,
            len(self._values),
            list(self._values).index(name),
        )
