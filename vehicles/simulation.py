"""A world in real time: one agent per robot on a bus, jamming at their adapters.

A tick is drift-free: attacks, then every agent's step, then motion. Ticks that come late are
skipped and counted; the world's clock then falls behind the wall, never jumps.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass

from solver.streams import Streams
from solver.zones import ZoneKind
from vehicles import messages as wire
from vehicles import translation
from vehicles.agent import VehicleAgent
from vehicles.bus import Bus, Subscription
from vehicles.external import ExternalRobots
from vehicles.inbox import Inbox, Sample
from vehicles.jamming import JammableBus
from vehicles.keys import TeamKeys
from vehicles.onboard import OnboardPilot
from vehicles.repetition import Repetition
from vehicles.settings import SimulationSettings, check_external
from vehicles.simulated import SimulatedBody, SimulatedSenses
from vehicles.world.setup import WorldSetup
from vehicles.world.world import World

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Puppet:
    """One simulated robot with its agent."""

    agent: VehicleAgent
    body: SimulatedBody
    senses: SimulatedSenses
    bus: JammableBus


class Simulation:
    """Owner of a world and its agents. `async with`, then `tick` or `run`.

    Args:
        setup: The world.
        settings: How it is run.
        bus: Open; carries the truth and every agent's messages.
        keys: The team's.
        pilot: Makes a robot's on-board pilot.
        boot: Names this run.

    Raises:
        ValueError: An external robot is none of the world's.
    """

    def __init__(
        self,
        setup: WorldSetup,
        settings: SimulationSettings,
        bus: Bus,
        keys: TeamKeys,
        pilot: Callable[[int], OnboardPilot],
        boot: str,
    ) -> None:
        self.setup = setup
        self.settings = settings
        self.late = 0
        """Ticks skipped because the one before took too long."""

        self._bus, self._keys, self._boot = bus, keys, boot
        self._make_pilot = pilot
        self._sender = translation.Sender(boot)
        self._control = Inbox(keys.delivery)
        self._refusals = Repetition(logger)
        self._state = wire.WorldState.RUNNING
        self._seed = settings.seed
        self._resets = 0
        self._world = World(setup, Streams(settings.seed))
        self._puppets: dict[int, Puppet] = {}
        check_external(setup, settings.external)
        self._external = ExternalRobots(settings.external, bus, keys, boot)
        self._listening: Subscription | None = None

    @property
    def world(self) -> World:
        """The world as it is now; a reset makes another one."""
        return self._world

    async def __aenter__(self) -> "Simulation":
        self._listening = await self._bus.subscribe(self._keys.control, self._control)
        await self._external.__aenter__()
        await self._populate()
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self._depopulate()
        await self._external.__aexit__()
        if self._listening is not None:
            await self._listening.close()

    async def run(self) -> None:
        """Tick until cancelled."""
        clock = asyncio.get_running_loop().time
        due_s = clock()
        while True:
            await self.tick(clock())
            due_s += self.settings.tick_s
            now_s = clock()
            if now_s > due_s:
                missed = int((now_s - due_s) / self.settings.tick_s)
                self.late += missed
                due_s += missed * self.settings.tick_s
            await asyncio.sleep(max(0.0, due_s - now_s))

    async def tick(self, now_s: float) -> None:
        """Live through one tick of the world.

        Args:
            now_s: This machine's monotonic clock.
        """
        for sample in self._control.drain():
            await self._obey(sample, now_s)
        running = self._state is wire.WorldState.RUNNING
        self._external.place(self._world, now_s)
        if running:
            self._attack(now_s)
        self._external.tell_senses(self._world, now_s, looking=running)
        for robot_id, puppet in self._puppets.items():
            puppet.senses.looking = running
            puppet.bus.jammed = self._world.failures(robot_id).communication
        await asyncio.gather(*(puppet.agent.step(now_s) for puppet in self._puppets.values()))
        if running:
            motions = {
                robot_id: puppet.body.motion(now_s) for robot_id, puppet in self._puppets.items()
            }
            self._world.move(
                self.settings.tick_s,
                {robot_id: motion.velocity for robot_id, motion in motions.items()},
                {robot_id: motion.altitude_m for robot_id, motion in motions.items()},
            )
        self._tell_truth(now_s)

    # ------------------------------------------------------------------ inside

    def _attack(self, now_s: float) -> None:
        """Let the zones strike, and tell whom they struck."""
        for event in self._world.attack(self.settings.tick_s, self._external.absent(now_s)):
            puppet = self._puppets.get(event.robot_id)
            if puppet is None:
                self._external.befall(event, now_s)
            else:
                puppet.senses.befall(event)

    async def _populate(self) -> None:
        """Give every robot its body and agent, and announce them."""
        boot = f"{self._boot}-{self._resets}"
        for robot in self.setup.robots:
            if robot.id in self.settings.external:
                continue
            bus = JammableBus(self._bus)
            body = SimulatedBody(robot, self._world)
            senses = SimulatedSenses(robot.id, self._world)
            agent = VehicleAgent(
                bus,
                self._keys,
                body,
                senses,
                self._make_pilot(robot.id),
                boot,
                self.settings.agent,
            )
            self._puppets[robot.id] = Puppet(agent, body, senses, bus)
        started: list[VehicleAgent] = []
        try:
            for puppet in self._puppets.values():
                await puppet.agent.start()
                started.append(puppet.agent)
        except BaseException:
            for agent in started:
                await agent.close()
            raise

    async def _depopulate(self) -> None:
        puppets, self._puppets = self._puppets, {}
        for puppet in puppets.values():
            await puppet.agent.close()

    async def _obey(self, sample: Sample, now_s: float) -> None:
        try:
            control = wire.decode(wire.WorldControl, sample.payload)
        except wire.MessageError as error:
            self._refusals.warn(now_s, "the world refuses an order: %s", error)
            return
        match control.action:
            case wire.WorldAction.PAUSE:
                self._state = wire.WorldState.PAUSED
            case wire.WorldAction.RESUME:
                self._state = wire.WorldState.RUNNING
            case wire.WorldAction.RESET:
                await self._reset(self._seed if control.seed is None else control.seed)

    async def _reset(self, seed: int) -> None:
        """Begin again with another world of the same setup; running or paused as before."""
        await self._depopulate()
        self._resets += 1
        self._seed = seed
        self._world = World(self.setup, Streams(seed))
        await self._populate()

    def _tell_truth(self, now_s: float) -> None:
        hits = wire.HitsPart(
            sensing=self._world.hits(ZoneKind.SENSING),
            communication=self._world.hits(ZoneKind.COMMUNICATION),
        )
        message = translation.truth_message(
            self._sender.header(self._keys.truth, now_s), self._world.truth(), self._state, hits
        )
        self._bus.publish(self._keys.truth, wire.encode(message))
