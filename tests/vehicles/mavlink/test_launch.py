"""A MAVLink vehicle in a team: planner, bus, agent, bridge, UDP, autopilot, in real time."""

import asyncio
import socket
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from solver.setpoints import Setpoint
from tests.vehicles.mavlink.air import ORIGIN, dialect_of
from tests.vehicles.pilots import Recorder
from vehicles import messages as wire
from vehicles import translation
from vehicles.agent import AgentSettings, DuplicateRobotError
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.frames import Datum
from vehicles.mavlink.launch import VehicleOptions, fly, signing_key
from vehicles.mavlink.signing import SigningError
from vehicles.mavlink.simulator import flying
from vehicles.mavlink.udp import Endpoint, Side, parse_endpoint
from vehicles.onboard import OnboardPilot
from vehicles.senses import NoSenses

KEYS = TeamKeys("alpha")
TEAM = Datum(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_m)


@dataclass
class Ground:
    """A planner of few words: flies the robot east, listens to what it says."""

    bus: LocalBus
    robot_id: int
    inbox: Inbox = field(default_factory=lambda: Inbox(KEYS.delivery))
    state: wire.State | None = None
    events: list[wire.Event] = field(default_factory=list)
    sender: translation.Sender = field(default_factory=lambda: translation.Sender("ground"))

    async def listen(self) -> None:
        for topic in (Topic.STATE, Topic.EVENTS):
            await self.bus.subscribe(KEYS.robot(self.robot_id, topic), self.inbox)

    def hear(self) -> None:
        for sample in self.inbox.drain():
            if sample.key.endswith("state"):
                self.state = wire.decode(wire.State, sample.payload)
            else:
                self.events.append(wire.decode(wire.Event, sample.payload))

    def told(self) -> wire.State:
        assert self.state is not None
        return self.state

    def speak(self, now_s: float) -> None:
        header = self.sender.header(KEYS.heartbeat, now_s)
        beat = wire.Heartbeat(
            **header, mission="m1", tick=1, time_s=0.0, state=wire.PlannerState.RUNNING
        )
        self.bus.publish(KEYS.heartbeat, wire.encode(beat))
        if self.state is None:
            return
        x, y = self.state.position
        key = KEYS.robot(self.robot_id, Topic.SETPOINT)
        setpoint = Setpoint(self.robot_id, (1.0, 0.0), (x + 0.5, y), 2.0, 0.5)
        message = translation.setpoint_message(self.sender.header(key, now_s), setpoint, "m1")
        self.bus.publish(key, wire.encode(message))


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_bytes(bytes(range(32)))
    path.chmod(0o600)
    return path


@pytest.mark.asyncio
async def test_a_signed_vehicle_flies_for_its_team_and_holds_without_it(key_file: Path) -> None:
    hub, port = LocalHub(), free_port()
    options = VehicleOptions(
        21, Endpoint(Side.IN, "127.0.0.1", port), Autopilot.PX4, 7, datum=TEAM, key_file=key_file
    )
    flight = FlightSettings(dialect=dialect_of(Autopilot.PX4), start=Start.AIRBORNE)
    vehicle = SimulatedAutopilot(AutopilotSettings(flight, 7, ORIGIN), signing_key(key_file))
    async with LocalBus(hub) as ground_bus, LocalBus(hub) as bus:
        ground = Ground(ground_bus, 21)
        await ground.listen()
        pilot = OnboardPilot(21, Recorder())
        work = asyncio.create_task(fly(options, bus, KEYS, pilot, NoSenses()))
        clock = asyncio.get_running_loop().time
        try:
            async with flying(vehicle, parse_endpoint(f"udpout:127.0.0.1:{port}")):
                for _ in range(50):
                    ground.hear()
                    ground.speak(clock())
                    await asyncio.sleep(0.1)
                flown = ground.told()
                assert flown.mode is wire.Mode.FLYING
                assert flown.position[0] > 2.0
                await asyncio.sleep(1.0)
                ground.hear()
                assert ground.told().mode is wire.Mode.HOLDING
                await asyncio.sleep(1.5)
                assert abs(vehicle.flight.body.velocity[0]) < 0.1
                assert work.done() is False
        finally:
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)
        notices = [
            event.event.code for event in ground.events if isinstance(event.event, wire.NoticePart)
        ]
        assert notices.count("control") == 1
        assert vehicle.ignored_setpoints == 0


@pytest.mark.asyncio
async def test_a_robot_that_is_flown_already_is_refused() -> None:
    hub = LocalHub()
    options = VehicleOptions(
        21, parse_endpoint("udpin:127.0.0.1:0"), agent=AgentSettings(duplicate_wait_s=0.0)
    )
    async with LocalBus(hub) as other, LocalBus(hub) as bus:
        await other.announce(KEYS.alive(21))
        with pytest.raises(DuplicateRobotError):
            await fly(options, bus, KEYS, OnboardPilot(21, Recorder()), NoSenses())


def test_a_bad_key_file_is_told(tmp_path: Path) -> None:
    endpoint = parse_endpoint("udpin:127.0.0.1:0")
    with pytest.raises(SigningError):
        VehicleOptions(21, endpoint, key_file=tmp_path / "none").session()
