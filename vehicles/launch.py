"""Puts one robot into a team, whatever its body: agent, senses and bus, until cancelled."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from uuid import uuid4

from solver import engines
from solver.planner import Planner
from vehicles.agent import VehicleAgent
from vehicles.body import Body
from vehicles.bus import Bus
from vehicles.jamming import JammableBus
from vehicles.keys import TeamKeys
from vehicles.onboard import OnboardPilot
from vehicles.senses import NoSenses, Senses, Sight
from vehicles.settings import AgentSettings
from vehicles.world_link import WorldLink
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

STEP_S = 0.1
"""Of the agent; bodies may tick faster."""


@dataclass(frozen=True, slots=True)
class Place:
    """A robot's place in its team.

    Raises:
        ValueError: The team's name could not stand in a key.
    """

    team: str
    zenoh: ZenohSettings
    engine: str | None = None
    """For flying alone; None for the default of the machine."""

    sight: Sight = Sight.NONE
    agent: AgentSettings = field(default_factory=AgentSettings)

    def __post_init__(self) -> None:
        TeamKeys(self.team)


async def pilot_for(robot_id: int, engine: str | None) -> OnboardPilot:
    """Return a robot's on-board pilot.

    Raises:
        ValueError: There is no such engine.
    """
    made = await asyncio.to_thread(engines.create, engine or engines.default_engine())
    return OnboardPilot(robot_id, Planner(made))


async def serve(
    body: Body,
    pilot: OnboardPilot,
    place: Place,
    ready: Callable[[], None] = lambda: None,
    own: Senses | None = None,
) -> None:
    """Fly a body over Zenoh until cancelled.

    `own` are its own senses, where the simulated world does not sense for it.

    Raises:
        vehicles.agent.DuplicateRobotError: Somebody else flies this robot.
        vehicles.bus.BusError: Nobody answers where the settings say.
    """
    keys = TeamKeys(place.team)
    async with ZenohBus(place.zenoh, keys.delivery) as bus, AsyncExitStack() as stack:
        senses: Senses | WorldLink = own or NoSenses()
        if place.sight is Sight.WORLD:
            link = WorldLink(pilot.robot_id, bus, keys, uuid4().hex[:16])
            senses = await stack.enter_async_context(link)
        await fly(body, place.agent, bus, keys, pilot, senses, ready)


async def fly(
    body: Body,
    settings: AgentSettings,
    bus: Bus,
    keys: TeamKeys,
    pilot: OnboardPilot,
    senses: Senses | WorldLink,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Fly one vehicle for its team until cancelled.

    Args:
        body: The vehicle, connected.
        settings: How its agent behaves.
        bus: Open.
        keys: The team's.
        pilot: Flies it when it is cut off.
        senses: What it notices of targets and failures. A simulated world that senses for it
            also jams it, where its agent meets the bus.
        ready: Called once it is announced.

    Raises:
        vehicles.agent.DuplicateRobotError: Somebody else flies this robot.
    """
    clock = asyncio.get_running_loop().time
    radio = JammableBus(bus)
    agent = VehicleAgent(radio, keys, body, senses, pilot, uuid4().hex[:16], settings)
    try:
        await agent.start()
        ready()
        due_s = clock()
        while True:
            now_s = clock()
            if isinstance(senses, WorldLink):
                _meet_world(senses, radio, body, now_s)
            await agent.step(now_s)
            due_s = max(due_s + STEP_S, clock())
            await asyncio.sleep(due_s - clock())
    finally:
        await agent.close()


def _meet_world(world: WorldLink, radio: JammableBus, body: Body, now_s: float) -> None:
    """Tell the simulated world where the vehicle is, and let it have its way with it."""
    state = body.state(now_s)
    if state is not None:
        world.tell(state, now_s)
    world.listen(now_s)
    radio.jammed = world.failures().communication
