"""Both ends judged by a peer no one here wrote, MAVSDK: as ground station and as vehicle."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from mavsdk import ComponentType  # type: ignore[import-untyped]
from mavsdk.asyncio.mavsdk import Configuration, Mavsdk  # type: ignore[import-untyped]
from mavsdk.asyncio.plugins.action.action import ActionAsync  # type: ignore[import-untyped]
from mavsdk.asyncio.plugins.offboard.offboard import OffboardAsync  # type: ignore[import-untyped]
from mavsdk.asyncio.plugins.telemetry.telemetry import TelemetryAsync  # type: ignore[import-untyped]
from mavsdk.plugins.offboard.offboard import VelocityNedYaw  # type: ignore[import-untyped]
from mavsdk.plugins.telemetry.telemetry import FlightMode, LandedState  # type: ignore[import-untyped]

from tests.patience import PATIENCE_S
from tests.vehicles.mavlink.air import ORIGIN, build
from tests.vehicles.mavlink.foreign import ForeignVehicle
from tests.vehicles.mavlink.test_bridge import fly_east
from tests.vehicles.mavlink.test_bridge import until as state_is
from vehicles.body import BodyEventKind
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.bridge import connected
from vehicles.mavlink.dialects import DIALECTS, Autopilot
from vehicles.mavlink.flight import FlightSettings
from vehicles.mavlink.guard import TakeOffRule
from vehicles.mavlink.simulator import flying
from vehicles.mavlink.udp import parse_endpoint
from vehicles.messages import Mode, Order

pytestmark = pytest.mark.sockets


async def until(read: Callable[[], Awaitable[Any]], wanted: Callable[[Any], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            if wanted(await read()):
                return
            await asyncio.sleep(0.1)


@pytest.mark.asyncio
@pytest.mark.parametrize("autopilot", list(Autopilot))
async def test_a_foreign_ground_station_flies_it(autopilot: Autopilot) -> None:
    vehicle = SimulatedAutopilot(AutopilotSettings(FlightSettings(dialect=DIALECTS[autopilot])))
    async with flying(vehicle, parse_endpoint("udpin:127.0.0.1:0")) as simulator:
        assert simulator.socket is not None
        station = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with Mavsdk(station) as mavsdk:
            await mavsdk.add_any_connection(f"udpout://127.0.0.1:{simulator.socket.port}")
            system = await mavsdk.first_autopilot(timeout_s=PATIENCE_S)
            assert system is not None
            told, action = TelemetryAsync(system), ActionAsync(system)

            await until(told.health, lambda health: health.is_local_position_ok)
            await until(told.position, lambda place: abs(place.latitude_deg - 47.0) < 1e-6)
            await until(told.battery, lambda battery: battery.remaining_percent == 100.0)

            await action.arm()
            await action.takeoff()
            await until(told.position, lambda place: place.relative_altitude_m > 1.8)
            await until(told.in_air, bool)
            await action.hold()
            await until(told.flight_mode, lambda mode: mode == FlightMode.HOLD)

            offboard = OffboardAsync(system)
            await offboard.set_velocity_ned(VelocityNedYaw(1.0, 0.5, 0.0, 0.0))
            await offboard.start()
            await until(
                told.velocity_ned, lambda v: abs(v.north_m_s - 1) + abs(v.east_m_s - 0.5) < 0.1
            )
            assert await told.flight_mode() == FlightMode.OFFBOARD
            assert vehicle.ignored_setpoints == 0

            await action.return_to_launch()
            await until(told.flight_mode, lambda mode: mode == FlightMode.RETURN_TO_LAUNCH)
            await action.land()
            await until(told.landed_state, lambda state: state == LandedState.ON_GROUND)
            await until(told.armed, lambda armed: not armed)


@pytest.mark.asyncio
async def test_a_foreign_vehicle_is_flown() -> None:
    """Take-off, flight and landing of MAVSDK's vehicle; then a pilot takes it over."""
    session = build(Autopilot.PX4, take_off=TakeOffRule.ALLOWED).session
    async with connected(session, parse_endpoint("udpin:127.0.0.1:0")) as body:
        assert body.socket is not None
        vehicle = ForeignVehicle(7, ORIGIN, body.socket.port)
        flight = asyncio.create_task(vehicle.fly())
        try:
            await state_is(body, lambda state: state.reason == "waiting for an operator")
            body.order(Order.TAKE_OFF, time.monotonic(), "c1")
            await state_is(body, lambda state: state.mode is Mode.HOLDING)
            await state_is(body, lambda state: abs(state.altitude_m - 2.0) < 0.1)
            await fly_east(body, lambda state: state.position[0] > 1.0)
            body.order(Order.LAND, time.monotonic(), "c2")
            await state_is(body, lambda state: state.mode is Mode.LANDED and not state.armed)
            body.order(Order.TAKE_OFF, time.monotonic(), "c3")
            await state_is(body, lambda state: state.mode is Mode.HOLDING)
            vehicle.take_over()
            await state_is(body, lambda state: state.mode is Mode.MANUAL)
            await asyncio.sleep(1.0)  # what was under way has arrived
            sent = vehicle.setpoints
            await asyncio.sleep(1.0)
            assert vehicle.setpoints == sent
        finally:
            flight.cancel()
            vehicle.close()
        kinds = [event.kind for event in body.take_events()]
        assert kinds.count(BodyEventKind.DONE) == 3
        assert kinds.count(BodyEventKind.PILOT) == 1
        assert BodyEventKind.REFUSED not in kinds
        assert vehicle.strays == 0
        assert body.counts.bad == body.counts.implausible == 0
