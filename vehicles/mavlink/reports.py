"""What the simulated autopilot tells of itself, message by message."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from vehicles.mavlink.flight import Flight
from vehicles.mavlink.frames import Datum, flipped
from vehicles.mavlink.protocol import Message, mavlink

_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)
_CELLS, _EMPTY_V, _FULL_V = 4, 3.5, 4.2
_NO_CELL = 65535
_SOFTWARE = 1 << 24
_PROTOCOL = 3
_EAST = 9000
"""Heading of the nose, in hundredths of a degree: it always looks east."""


class Reporter:
    """Builds the messages of one vehicle.

    Args:
        origin: Where its local frame lies.
    """

    def __init__(self, origin: Datum) -> None:
        self._origin = origin

    def report(self, kind: int, flight: Flight, boot_ms: int) -> Message:
        """Return the message of an id of `REPORTS` as things are."""
        return REPORTS[kind].build(self, flight, boot_ms)

    def heartbeat(self, flight: Flight, boot_ms: int) -> Message:
        """Say who and in what state it is."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if flight.armed:
            base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        state = mavlink.MAV_STATE_STANDBY if flight.landed else mavlink.MAV_STATE_ACTIVE
        if flight.battery <= flight.settings.battery_failsafe:
            state = mavlink.MAV_STATE_CRITICAL
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            flight.settings.dialect.identities[0],
            base,
            flight.mode,
            state,
            _PROTOCOL,
        )

    def local_position(self, flight: Flight, boot_ms: int) -> Message:
        """Tell where it is from its origin."""
        return mavlink.MAVLink_local_position_ned_message(
            boot_ms, *flipped(flight.body.position), *flipped(flight.body.velocity)
        )

    def global_position(self, flight: Flight, boot_ms: int) -> Message:
        """Tell where it is on Earth."""
        latitude, longitude, altitude = self._origin.geodetic(flight.body.position)
        height = flight.body.position[2] - flight.settings.home[2]
        north, east, down = (round(100.0 * v) for v in flipped(flight.body.velocity))
        return mavlink.MAVLink_global_position_int_message(
            boot_ms,
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(altitude * 1e3),
            round(height * 1e3),
            north,
            east,
            down,
            _EAST,
        )

    def attitude(self, flight: Flight, boot_ms: int) -> Message:
        """Tell how it is tilted."""
        body = flight.body
        return mavlink.MAVLink_attitude_message(
            boot_ms, body.roll_rad, body.pitch_rad, math.pi / 2.0, 0.0, 0.0, 0.0
        )

    def status(self, flight: Flight, boot_ms: int) -> Message:
        """Tell how its sensors and its battery are."""
        millivolts = round(1000.0 * _CELLS * _cell_v(flight))
        return mavlink.MAVLink_sys_status_message(
            *(_SENSORS,) * 3, 250, millivolts, -1, round(100.0 * flight.battery), *(0,) * 6
        )

    def battery(self, flight: Flight, boot_ms: int) -> Message:
        """Tell how its battery is."""
        cells = [round(1000.0 * _cell_v(flight))] * _CELLS + [_NO_CELL] * (10 - _CELLS)
        low = flight.battery <= flight.settings.battery_failsafe
        charge = (
            mavlink.MAV_BATTERY_CHARGE_STATE_LOW if low else mavlink.MAV_BATTERY_CHARGE_STATE_OK
        )
        return mavlink.MAVLink_battery_status_message(
            0,
            mavlink.MAV_BATTERY_FUNCTION_ALL,
            mavlink.MAV_BATTERY_TYPE_LIPO,
            2500,
            cells,
            *(-1,) * 3,
            round(100.0 * flight.battery),
            0,
            charge,
        )

    def extended_state(self, flight: Flight, boot_ms: int) -> Message:
        """Tell whether it is in the air."""
        landed = (
            mavlink.MAV_LANDED_STATE_ON_GROUND if flight.landed else mavlink.MAV_LANDED_STATE_IN_AIR
        )
        return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, landed)

    def fence(self, flight: Flight, boot_ms: int) -> Message:
        """Tell whether it is beyond its fence."""
        breached = flight.fence_breached
        kind = mavlink.FENCE_BREACH_BOUNDARY if breached else mavlink.FENCE_BREACH_NONE
        return mavlink.MAVLink_fence_status_message(int(breached), int(breached), kind, boot_ms)

    def satellites(self, flight: Flight, boot_ms: int) -> Message:
        """Tell what its satellite receiver says."""
        latitude, longitude, altitude = self._origin.geodetic(flight.body.position)
        speed = round(100.0 * math.hypot(*flight.body.velocity[:2]))
        return mavlink.MAVLink_gps_raw_int_message(
            boot_ms * 1000,
            mavlink.GPS_FIX_TYPE_3D_FIX,
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(altitude * 1e3),
            80,
            120,
            speed,
            _EAST,
            14,
        )

    def origin(self, flight: Flight, boot_ms: int) -> Message:
        """Tell where its local frame lies."""
        place = self._origin
        return mavlink.MAVLink_gps_global_origin_message(
            round(place.latitude_deg * 1e7),
            round(place.longitude_deg * 1e7),
            round(place.altitude_m * 1e3),
            boot_ms * 1000,
        )

    def home(self, flight: Flight, boot_ms: int) -> Message:
        """Tell where its home is."""
        latitude, longitude, altitude = self._origin.geodetic(flight.settings.home)
        return mavlink.MAVLink_home_position_message(
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(altitude * 1e3),
            *flipped(flight.settings.home),
            [1.0, 0.0, 0.0, 0.0],
            *(0.0,) * 3,
        )

    def version(self, flight: Flight, boot_ms: int) -> Message:
        """Tell what it can do."""
        able = (
            mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        )
        return mavlink.MAVLink_autopilot_version_message(
            able, _SOFTWARE, 0, 0, 0, *([0] * 8,) * 3, 0, 0, 1
        )


@dataclass(frozen=True, slots=True)
class Report:
    """How a message is built, and how often it is sent unasked (infinity for never)."""

    build: Callable[[Reporter, Flight, int], Message]
    period_s: float


REPORTS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Report(Reporter.heartbeat, 1.0),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: Report(Reporter.local_position, 0.1),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: Report(Reporter.global_position, 0.25),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: Report(Reporter.attitude, 0.25),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Report(Reporter.status, 1.0),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: Report(Reporter.battery, 2.0),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Report(Reporter.extended_state, 0.5),
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: Report(Reporter.fence, 1.0),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: Report(Reporter.satellites, 1.0),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: Report(Reporter.home, 5.0),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: Report(Reporter.origin, math.inf),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: Report(Reporter.version, math.inf),
}
"""Message id to what is sent."""


def _cell_v(flight: Flight) -> float:
    return _EMPTY_V + (_FULL_V - _EMPTY_V) * flight.battery
