"""A vehicle no one here wrote the protocol of: MAVSDK in the place of the autopilot.

It obeys what MAVSDK hands it: modes, arming, position setpoints (it is at once where it is told
to be, at its speed). Callbacks come on MAVSDK's threads and only set plain attributes.
"""

import asyncio
import json
import math
from typing import Any

from mavsdk import ComponentType  # type: ignore[import-untyped]
from mavsdk.mavsdk import Configuration, Mavsdk  # type: ignore[import-untyped]
from mavsdk.plugins.action_server.action_server import (  # type: ignore[import-untyped]
    ActionServer,
    AllowableFlightModes,
    FlightMode,
)
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import (  # type: ignore[import-untyped]
    MavlinkDirectServer,
)
from mavsdk.plugins.telemetry_server.telemetry_server import (  # type: ignore[import-untyped]
    LandedState,
    Position,
    PositionNed,
    PositionVelocityNed,
    TelemetryServer,
    VelocityNed,
    VtolState,
)

from vehicles.mavlink.frames import Datum

STEP_S = 0.05
SPEED_M_S = 3.0


class ForeignVehicle:
    """A point that flies where MAVSDK tells it to.

    Args:
        system: Its system id.
        home: Where it stands.
        port: Of the bridge.
    """

    def __init__(self, system: int, home: Datum, port: int) -> None:
        configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
        configuration.system_id = system
        self._mavsdk = Mavsdk(configuration)
        self._mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        component = self._mavsdk.server_component(0)
        self._system = system
        self._home = home
        self._telemetry = TelemetryServer(component)
        self._action = ActionServer(component)
        self._direct = MavlinkDirectServer(component)
        self.armed = False
        self.mode: Any = FlightMode.HOLD
        self.setpoints = 0
        self.strays = 0
        self.place = [0.0, 0.0, 0.0]
        """North, east, down."""

        self._target = list(self.place)
        self._action.set_armable(True, True)
        self._action.set_disarmable(True, True)
        self._action.set_allowable_flight_modes(AllowableFlightModes(*(True,) * 7))
        self._action.subscribe_arm_disarm(self._arm)
        self._action.subscribe_flight_mode_change(self._change)
        self._direct.subscribe_message("SET_POSITION_TARGET_LOCAL_NED", self._follow)

    def take_over(self) -> None:
        """Let a pilot take it over by remote control."""
        self.mode = FlightMode.POSCTL
        self._action.set_flight_mode(FlightMode.POSCTL)

    async def fly(self) -> None:
        """Fly and tell for ever."""
        while True:
            velocity = self._step()
            north, east, down = self.place
            self._telemetry.publish_position_velocity_ned(
                PositionVelocityNed(PositionNed(north, east, down), VelocityNed(*velocity))
            )
            self._telemetry.publish_home(
                Position(
                    self._home.latitude_deg, self._home.longitude_deg, self._home.altitude_m, 0.0
                )
            )
            landed = LandedState.ON_GROUND if down > -0.1 else LandedState.IN_AIR
            self._telemetry.publish_extended_sys_state(VtolState.UNDEFINED, landed)
            await asyncio.sleep(STEP_S)

    def close(self) -> None:
        """Take it off the air."""
        self._mavsdk.destroy()

    def _step(self) -> tuple[float, float, float]:
        if self.mode == FlightMode.LAND:
            self._target = [self.place[0], self.place[1], 0.0]
        flying = self.armed and self.mode in (FlightMode.OFFBOARD, FlightMode.LAND)
        target = self._target if flying else self.place
        way = math.dist(target, self.place)
        part = min(SPEED_M_S * STEP_S / way, 1.0) if way > 0.0 else 0.0
        moved = [part * (a - b) for a, b in zip(target, self.place, strict=True)]
        self.place = [p + m for p, m in zip(self.place, moved, strict=True)]
        if self.mode == FlightMode.LAND and self.armed and self.place[2] > -0.01:
            self.armed = False
            self._action.set_armed_state(False)
        north, east, down = (m / STEP_S for m in moved)
        return north, east, down

    def _arm(self, result: Any, order: Any, _: Any) -> None:
        self.armed = bool(order.arm)

    def _change(self, result: Any, mode: Any, _: Any) -> None:
        self.mode = mode

    def _follow(self, message: Any, _: Any) -> None:
        said = json.loads(message.fields_json)
        if said["target_system"] != self._system:
            self.strays += 1
            return
        self.setpoints += 1
        self._target = [said["x"], said["y"], said["z"]]
