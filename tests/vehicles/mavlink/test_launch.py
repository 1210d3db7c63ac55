"""A MAVLink vehicle in a team: planner, bus, agent, bridge, UDP, autopilot, in real time."""

import asyncio
import socket
import time
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import pytest

from solver.setpoints import Setpoint
from solver.zones import ZoneKind
from tests.patience import PATIENCE_S
from tests.vehicles.buses import until
from tests.vehicles.mavlink.air import ORIGIN, dialect_of
from tests.vehicles.pilots import Recorder, knowledge
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles import translation
from vehicles.agent import DuplicateRobotError
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.launch import fly
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.bridge import connected
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.frames import Datum
from vehicles.mavlink.guard import TakeOffRule
from vehicles.mavlink.launch import VehicleOptions
from vehicles.mavlink.signing import SigningError, signing_key
from vehicles.mavlink.simulator import flying
from vehicles.mavlink.udp import Endpoint, Side, parse_endpoint
from vehicles.onboard import OnboardPilot
from vehicles.senses import NoSenses
from vehicles.settings import AgentSettings, SimulationSettings
from vehicles.simulation import Simulation
from vehicles.world.setup import WorldTarget
from vehicles.world_link import WorldLink

pytestmark = pytest.mark.sockets

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
    heard_s: list[float] = field(default_factory=list)
    sender: translation.Sender = field(default_factory=lambda: translation.Sender("ground"))

    async def listen(self) -> None:
        for topic in (Topic.STATE, Topic.EVENTS):
            await self.bus.subscribe(KEYS.robot(self.robot_id, topic), self.inbox)

    def hear(self) -> None:
        for sample in self.inbox.drain():
            if sample.key.endswith("state"):
                self.state = wire.decode(wire.State, sample.payload)
                self.heard_s.append(time.monotonic())
            else:
                self.events.append(wire.decode(wire.Event, sample.payload))

    def told(self) -> wire.State:
        assert self.state is not None
        return self.state

    def teach(self, now_s: float) -> None:
        """Tell it what it should know when it is cut off."""
        key = KEYS.robot(self.robot_id, Topic.KNOWLEDGE)
        header = self.sender.header(key, now_s)
        message = translation.knowledge_message(
            header, knowledge(self.robot_id), translation.MateParts()
        )
        self.bus.publish(key, wire.encode(message))

    def speak(self, now_s: float, speed_m_s: float = 1.0) -> None:
        header = self.sender.header(KEYS.heartbeat, now_s)
        beat = wire.Heartbeat(
            **header, mission="m1", tick=1, time_s=0.0, state=wire.PlannerState.RUNNING
        )
        self.bus.publish(KEYS.heartbeat, wire.encode(beat))
        if self.state is None:
            return
        x, y = self.state.position
        key = KEYS.robot(self.robot_id, Topic.SETPOINT)
        way = (x + 0.5 * speed_m_s, y)
        setpoint = Setpoint(self.robot_id, (speed_m_s, 0.0), way, 2.0, 0.5)
        message = translation.setpoint_message(self.sender.header(key, now_s), setpoint, "m1")
        self.bus.publish(key, wire.encode(message))


@pytest.mark.parametrize("altitude_m", [0.2, 500.0, float("nan")])
def test_a_take_off_never_leads_out_of_the_limits(altitude_m: float) -> None:
    endpoint = parse_endpoint("udpin:127.0.0.1:14550")
    grounded = VehicleOptions(7, endpoint, take_off_altitude_m=altitude_m)
    assert grounded.fitting().senses is None
    with pytest.raises(ValueError, match=r"must lie within 0\.5 and 120 m"):
        replace(grounded, take_off=TakeOffRule.ALLOWED).fitting()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def no_pilot(robot_id: int) -> OnboardPilot:
    raise AssertionError(f"the world flies robot {robot_id}")


async def connect_and_fly(
    options: VehicleOptions,
    bus: LocalBus,
    pilot: OnboardPilot,
    settings: AgentSettings | None = None,
) -> None:
    """Connect a vehicle and fly it."""
    clock = asyncio.get_running_loop().time
    async with connected(options.session(), options.endpoint, clock) as body:
        await fly(body, settings or AgentSettings(), bus, KEYS, pilot, NoSenses())


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_bytes(bytes(range(32)))
    path.chmod(0o600)
    return path


def flies_east(ground: Ground) -> bool:
    """Return whether the vehicle says that it flies and is two metres on its way."""
    told = ground.state
    return told is not None and told.mode is wire.Mode.FLYING and told.position[0] > 2.0


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
        work = asyncio.create_task(connect_and_fly(options, bus, pilot))
        clock = asyncio.get_running_loop().time
        try:
            async with flying(vehicle, parse_endpoint(f"udpout:127.0.0.1:{port}")):
                async with asyncio.timeout(PATIENCE_S):
                    while not flies_east(ground):
                        ground.hear()
                        ground.speak(clock())
                        await asyncio.sleep(0.1)
                    while ground.told().mode is not wire.Mode.HOLDING:
                        ground.hear()
                        await asyncio.sleep(0.1)
                await until(lambda: abs(vehicle.flight.body.velocity[0]) < 0.1)
                assert work.done() is False
        finally:
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)
        notices = [
            event.event.code for event in ground.events if isinstance(event.event, wire.NoticePart)
        ]
        assert notices.count("control") >= 1
        assert vehicle.ignored_setpoints == 0


@pytest.mark.asyncio
async def test_a_robot_that_is_flown_already_is_refused() -> None:
    hub = LocalHub()
    options = VehicleOptions(21, parse_endpoint("udpin:127.0.0.1:0"))
    impatient = AgentSettings(duplicate_wait_s=0.0)
    async with LocalBus(hub) as other, LocalBus(hub) as bus:
        await other.announce(KEYS.alive(21))
        with pytest.raises(DuplicateRobotError):
            await connect_and_fly(options, bus, OnboardPilot(21, Recorder()), impatient)


def test_a_bad_key_file_is_told(tmp_path: Path) -> None:
    endpoint = parse_endpoint("udpin:127.0.0.1:0")
    with pytest.raises(SigningError):
        VehicleOptions(21, endpoint, key_file=tmp_path / "none").session()


@pytest.mark.asyncio
async def test_a_simulated_world_blinds_and_jams_it_and_it_flies_on_alone_until_it_is_out() -> None:
    """The zone lies where it starts; on board it flies east until it is out, and reports."""
    hub, port = LocalHub(), free_port()
    endpoint = Endpoint(Side.IN, "127.0.0.1", port)
    options = VehicleOptions(21, endpoint, system=7, datum=TEAM)
    small = ((0.01, 0.0), (0.0, 0.01))
    setup = world_setup(
        (robot(21, 0.0),),
        (WorldTarget(122, (1.0, 0.0)),),
        (zone("c1", ZoneKind.COMMUNICATION, (0.0, 0.0), small, margin=0.0),),
        attack_period_s=0.05,
    )
    flight = FlightSettings(start=Start.AIRBORNE)
    vehicle = SimulatedAutopilot(AutopilotSettings(flight, 7, ORIGIN))
    clock = asyncio.get_running_loop().time
    async with LocalBus(hub) as ground_bus, LocalBus(hub) as bus, LocalBus(hub) as world_bus:
        ground = Ground(ground_bus, 21)
        await ground.listen()
        settings = SimulationSettings(external=(21,))
        world = Simulation(setup, settings, world_bus, KEYS, no_pilot, "w1")
        async with (
            world,
            WorldLink(21, bus, KEYS, "l1") as link,
            connected(options.session(), endpoint, clock) as body,
            flying(vehicle, parse_endpoint(f"udpout:127.0.0.1:{port}")),
            asyncio.TaskGroup() as tasks,
        ):
            pilot = OnboardPilot(21, Recorder())
            work = [tasks.create_task(fly(body, AgentSettings(), bus, KEYS, pilot, link))]
            returned: list[wire.ReturnPart] = []
            async with asyncio.timeout(PATIENCE_S):
                # The world jams it at once, and who knows nothing cannot fly on alone.
                while not pilot.targets:
                    ground.teach(clock())
                    await asyncio.sleep(0.02)
                work.append(tasks.create_task(world.run()))
                while not returned:
                    ground.hear()
                    ground.speak(clock(), speed_m_s=0.0)
                    ground.teach(clock())
                    returned = [
                        e.event for e in ground.events if isinstance(e.event, wire.ReturnPart)
                    ]
                    await asyncio.sleep(0.1)
            for task in work:
                task.cancel()
    assert vehicle.flight.body.position[0] > 0.2, "it flew out by itself"
    assert "c1" in {one.id for one in returned[0].zones}
    assert 122 in {one.target_id for one in returned[0].tracks}
    parts = [event.event for event in ground.events]
    assert sum(isinstance(part, wire.AttackPart) for part in parts) >= 1
    modes = [part.mode for part in parts if isinstance(part, wire.ModePart)]
    assert wire.Mode.ONBOARD in modes
    silence = max(b - a for a, b in pairwise(ground.heard_s))
    assert silence > 1.0, "jammed, it was not heard"
