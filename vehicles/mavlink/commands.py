"""What we say to an autopilot: actions of the guard as MAVLink messages."""

import math
from dataclasses import dataclass
from typing import TypeAlias

from vehicles.mavlink.codec import AUTOPILOT
from vehicles.mavlink.dialects import Dialect
from vehicles.mavlink.frames import Vector, flipped
from vehicles.mavlink.protocol import Message, mavlink

STREAMS_HZ = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 2.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
}
"""Messages an autopilot is asked to send, and how often."""


@dataclass(frozen=True, slots=True)
class Target:
    """Be here, moving so: position (m) and velocity (m/s) in the local ENU frame."""

    position: Vector
    velocity: Vector


@dataclass(frozen=True, slots=True)
class Beat:
    """Say that a planner is alive."""


@dataclass(frozen=True, slots=True)
class ChangeMode:
    """Ask for a mode."""

    mode: int


@dataclass(frozen=True, slots=True)
class Arm:
    """Start the motors."""


@dataclass(frozen=True, slots=True)
class Disarm:
    """Stop the motors; an autopilot that flies refuses."""


@dataclass(frozen=True, slots=True)
class Climb:
    """Take off to an altitude above the local origin, metres."""

    altitude_m: float


Action: TypeAlias = Target | Beat | ChangeMode | Arm | Disarm | Climb

COMMANDS = {
    ChangeMode: mavlink.MAV_CMD_DO_SET_MODE,
    Arm: mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    Disarm: mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    Climb: mavlink.MAV_CMD_NAV_TAKEOFF,
}
"""The MAV_CMD whose acknowledgement answers an action."""


def command(system: int, number: int, *parameters: float) -> Message:
    """Return a COMMAND_LONG to a system's autopilot; missing parameters are 0."""
    filled = (*parameters, *(0.0,) * (7 - len(parameters)))
    return mavlink.MAVLink_command_long_message(system, AUTOPILOT, number, 0, *filled)


def stream_requests(system: int) -> list[Message]:
    """Return the requests for the messages we live on."""
    requests = [
        command(system, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message), 1e6 / rate_hz)
        for message, rate_hz in STREAMS_HZ.items()
    ]
    for message in (
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    ):
        requests.append(command(system, mavlink.MAV_CMD_REQUEST_MESSAGE, float(message)))
    return requests


def message_of(action: Action, dialect: Dialect, system: int, boot_ms: int) -> Message:
    """Return the message that carries an action out.

    Args:
        action: What to do.
        dialect: Of the autopilot.
        system: Its system id.
        boot_ms: Milliseconds since we started.
    """
    match action:
        case Target():
            return _target(action, dialect, system, boot_ms)
        case Beat():
            return mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                mavlink.MAV_AUTOPILOT_INVALID,
                0,
                0,
                mavlink.MAV_STATE_ACTIVE,
                3,
            )
        case ChangeMode(mode):
            custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
            parameters: tuple[float, ...] = (custom, *dialect.mode_parameters(mode))
        case Arm():
            parameters = (1.0,)
        case Disarm():
            parameters = (0.0,)
        case Climb(altitude_m):
            parameters = (0.0, 0.0, 0.0, math.nan, 0.0, 0.0, altitude_m)
    return command(system, COMMANDS[type(action)], *parameters)


def _target(target: Target, dialect: Dialect, system: int, boot_ms: int) -> Message:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        boot_ms & 0xFFFFFFFF,
        system,
        AUTOPILOT,
        mavlink.MAV_FRAME_LOCAL_NED,
        dialect.type_mask,
        *flipped(target.position),
        *flipped(target.velocity),
        *(0.0,) * 5,
    )
