"""The bridge over real sockets: a few seconds of real time."""

import asyncio
import socket
import time
from collections.abc import Callable

import pytest

from solver.setpoints import Setpoint
from tests.patience import PATIENCE_S
from tests.vehicles.mavlink.air import ORIGIN, build, dialect_of
from vehicles.body import Body, BodyState
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.bridge import MavlinkBody, connected
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.simulator import flying
from vehicles.mavlink.udp import EndpointError, parse_endpoint
from vehicles.messages import Mode

pytestmark = pytest.mark.sockets


def vehicle(autopilot: Autopilot) -> SimulatedAutopilot:
    flight = FlightSettings(dialect=dialect_of(autopilot), start=Start.AIRBORNE)
    return SimulatedAutopilot(AutopilotSettings(flight, system=7, origin=ORIGIN))


async def until(body: Body, wanted: Callable[[BodyState], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            state = body.state(time.monotonic())
            if state is not None and wanted(state):
                return
            await asyncio.sleep(0.02)


async def fly_east(body: Body, wanted: Callable[[BodyState], bool]) -> None:
    """Send ten setpoints a second until the vehicle says what is wanted."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            now_s = time.monotonic()
            state = body.state(now_s)
            assert state is not None
            if wanted(state):
                return
            x, y = state.position
            body.follow(Setpoint(7, (1.0, 0.0), (x + 0.5, y), 2.0, 0.5), now_s)
            await asyncio.sleep(0.1)


def flies(state: BodyState) -> bool:
    return state.mode is Mode.FLYING


async def check_flight(body: MavlinkBody) -> None:
    await until(body, lambda state: state.mode is Mode.HOLDING)
    await fly_east(body, lambda s: flies(s) and s.position[0] > 1.0 and s.age_s < 0.3)
    await until(body, lambda state: state.mode is Mode.HOLDING)
    assert body.counts.bad == body.counts.foreign == body.counts.implausible == 0


@pytest.mark.asyncio
@pytest.mark.parametrize("autopilot", list(Autopilot))
async def test_the_vehicle_finds_the_bridge(autopilot: Autopilot) -> None:
    session = build(autopilot).session
    async with connected(session, parse_endpoint("udpin:127.0.0.1:0")) as body:
        assert body.socket is not None
        endpoint = parse_endpoint(f"udpout:127.0.0.1:{body.socket.port}")
        async with flying(vehicle(autopilot), endpoint):
            await check_flight(body)


@pytest.mark.asyncio
async def test_the_bridge_finds_a_vehicle_that_listens() -> None:
    """With udpin on the vehicle's side the bridge must be heard first: it asks."""
    async with flying(vehicle(Autopilot.PX4), parse_endpoint("udpin:127.0.0.1:0")) as simulator:
        assert simulator.socket is not None
        endpoint = parse_endpoint(f"udpout:127.0.0.1:{simulator.socket.port}")
        async with connected(build(Autopilot.PX4).session, endpoint) as body:
            await check_flight(body)


@pytest.mark.asyncio
async def test_strangers_and_noise_do_not_disturb() -> None:
    session = build().session
    async with connected(session, parse_endpoint("udpin:127.0.0.1:0")) as body:
        assert body.socket is not None
        endpoint = parse_endpoint(f"udpout:127.0.0.1:{body.socket.port}")
        stranger = vehicle(Autopilot.ARDUPILOT)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise:
            async with flying(vehicle(Autopilot.ARDUPILOT), endpoint):
                await until(body, lambda state: state.mode is Mode.HOLDING)
                for number in range(2000):
                    noise.sendto(bytes([0xFD, number % 256]) * 20, ("127.0.0.1", endpoint.port))
                stranger.flight.change_mode(5, time.monotonic())
                for frame in stranger.tick(time.monotonic()):
                    noise.sendto(frame, ("127.0.0.1", endpoint.port))
                await fly_east(body, lambda state: flies(state) and body.counts.foreign > 0)
        assert body.counts.foreign > 0


@pytest.mark.asyncio
async def test_a_bridge_that_is_closed_falls_silent() -> None:
    heard: list[float] = []
    simulated = vehicle(Autopilot.ARDUPILOT)
    async with flying(simulated, parse_endpoint("udpin:127.0.0.1:0")) as simulator:
        assert simulator.socket is not None
        endpoint = parse_endpoint(f"udpout:127.0.0.1:{simulator.socket.port}")
        async with connected(build().session, endpoint) as body:
            await until(body, lambda state: state.mode is Mode.HOLDING)
            await fly_east(body, flies)
        for _ in range(100):  # what was under way has arrived
            await asyncio.sleep(0)
        receive = simulated.receive

        def listen(datagram: bytes, now_s: float) -> list[bytes]:
            heard.append(now_s)
            return receive(datagram, now_s)

        simulated.receive = listen  # type: ignore[method-assign]
        await asyncio.sleep(0.5)
    assert heard == []


@pytest.mark.asyncio
async def test_a_port_in_use_is_told() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        endpoint = parse_endpoint(f"udpin:127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(EndpointError, match="cannot open udpin:127"):
            async with connected(build().session, endpoint):
                pytest.fail("opened")
