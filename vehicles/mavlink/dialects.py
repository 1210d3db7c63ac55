"""How ArduPilot and PX4 differ: modes, the setpoint's type mask, how one takes off.

Modes are the numbers of HEARTBEAT.custom_mode: plain for ArduPilot Copter, main mode in the third
byte and sub-mode in the fourth for PX4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from vehicles.mavlink.protocol import mavlink


class Autopilot(StrEnum):
    """The autopilots flown."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


class TakeOff(StrEnum):
    """How an armed vehicle leaves the ground."""

    COMMAND = "command"
    """By MAV_CMD_NAV_TAKEOFF in the mode that follows us."""

    SETPOINT = "setpoint"
    """By a setpoint above it; the setpoints must flow before the mode is accepted."""


IGNORE_ACCELERATION_AND_YAW = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)
"""Position and velocity count: 0x0DC0. Bit 9 (force instead of acceleration) stays clear: PX4
refuses setpoints that carry it."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """What must be known to fly one kind of autopilot."""

    autopilot: Autopilot
    identities: tuple[int, ...]
    """Its MAV_AUTOPILOT numbers in heartbeats, its own first."""

    follow: int
    """The mode that follows setpoints: GUIDED or OFFBOARD."""

    hold: int
    land: int
    return_home: int
    names: Mapping[int, str]
    savers: frozenset[int]
    """Modes the autopilot's own failsafes choose."""

    type_mask: int
    take_off: TakeOff
    stream_first_s: float
    """How long setpoints must flow before the following mode is accepted."""

    lead_s: float
    """How far ahead of now a setpoint's position is meant: ArduPilot moves it on by the velocity
    until the next one comes, PX4 keeps it, so there the middle of the period is right."""

    def name(self, mode: int) -> str:
        """Return what people call a mode."""
        return self.names.get(mode, f"mode {mode:#x}")

    def mode_parameters(self, mode: int) -> tuple[float, float]:
        """Return parameters 2 and 3 of MAV_CMD_DO_SET_MODE."""
        if self.autopilot is Autopilot.PX4:
            return float(mode >> 16 & 0xFF), float(mode >> 24 & 0xFF)
        return float(mode), 0.0

    def mode_of(self, main: int, sub: int) -> int:
        """Return the mode that parameters 2 and 3 of MAV_CMD_DO_SET_MODE name."""
        return px4_mode(main, sub) if self.autopilot is Autopilot.PX4 else main


def px4_mode(main: int, sub: int = 0) -> int:
    """Return PX4's custom mode of a main mode and a sub-mode."""
    return (main & 0xFF) << 16 | (sub & 0xFF) << 24


ARDUPILOT = Dialect(
    autopilot=Autopilot.ARDUPILOT,
    identities=(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,),
    follow=4,
    hold=17,
    land=9,
    return_home=6,
    names={
        0: "STABILIZE",
        2: "ALT_HOLD",
        3: "AUTO",
        4: "GUIDED",
        5: "LOITER",
        6: "RTL",
        9: "LAND",
        16: "POSHOLD",
        17: "BRAKE",
        21: "SMART_RTL",
    },
    savers=frozenset({6, 9, 17, 21}),
    type_mask=IGNORE_ACCELERATION_AND_YAW,
    take_off=TakeOff.COMMAND,
    stream_first_s=0.0,
    lead_s=0.0,
)

PX4 = Dialect(
    autopilot=Autopilot.PX4,
    # Small flight stacks that speak PX4's modes call themselves generic.
    identities=(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_GENERIC),
    follow=px4_mode(6),
    hold=px4_mode(4, 3),
    land=px4_mode(4, 6),
    return_home=px4_mode(4, 5),
    names={
        px4_mode(1): "MANUAL",
        px4_mode(2): "ALTITUDE",
        px4_mode(3): "POSITION",
        px4_mode(4, 2): "TAKEOFF",
        px4_mode(4, 3): "HOLD",
        px4_mode(4, 4): "MISSION",
        px4_mode(4, 5): "RETURN",
        px4_mode(4, 6): "LAND",
        px4_mode(5): "ACRO",
        px4_mode(6): "OFFBOARD",
        px4_mode(7): "STABILIZED",
    },
    savers=frozenset({px4_mode(4, 3), px4_mode(4, 5), px4_mode(4, 6)}),
    type_mask=IGNORE_ACCELERATION_AND_YAW,
    take_off=TakeOff.SETPOINT,
    stream_first_s=1.0,
    lead_s=0.05,
)

DIALECTS: Mapping[Autopilot, Dialect] = {Autopilot.ARDUPILOT: ARDUPILOT, Autopilot.PX4: PX4}
