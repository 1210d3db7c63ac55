"""A planner and a simulated world on one local bus, in virtual time."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

from solver.observations import LinkChange, Observation
from solver.setpoints import Setpoint
from solver.zones import Point
from tests.vehicles.buses import KEYS
from tests.vehicles.pilots import Recorder, knowledge
from vehicles import messages as wire
from vehicles.knowledge import Knowledge
from vehicles.link_monitor import LinkSettings
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.onboard import OnboardPilot
from vehicles.orders import send
from vehicles.settings import AgentSettings, SimulationSettings
from vehicles.simulation import Simulation
from vehicles.team_link import Notice, TeamLink
from vehicles.world.setup import WorldSetup

TICK_S = 0.1


class Rig:
    """A clock that only `tick` moves, everything that was observed, and what is commanded."""

    def __init__(self, hub: LocalHub, recorder: Recorder) -> None:
        self.hub = hub
        self.recorder = recorder
        self.now_s = 1000.0
        self.bus: LocalBus
        """The planner's."""

        self.simulation: Simulation
        self.link: TeamLink
        self.observed: list[Observation] = []
        self.notices: list[Notice] = []
        self.velocities: dict[int, Point] = {}
        self.tick_number = 0

    @property
    def time_s(self) -> float:
        """Mission time."""
        return self.now_s - 1000.0

    async def tick(self, times: int = 1, planner: str = "alive") -> list[Observation]:
        """Let the world and, if it is alive, the planner live through some ticks.

        Returns what the planner observed in them.
        """
        seen: list[Observation] = []
        for _ in range(times):
            self.now_s += TICK_S
            self.tick_number += 1
            await self.simulation.tick(self.now_s)
            if planner != "alive":
                continue
            seen.extend(self.link.drain(self.time_s))
            self.notices.extend(self.link.take_notices())
            self.link.send_heartbeat("m1", self.tick_number, self.time_s, wire.PlannerState.RUNNING)
            self.link.send_setpoints(
                (
                    Setpoint(robot_id, velocity, (0.0, 0.0), 1.5, 0.5)
                    for robot_id, velocity in self.velocities.items()
                ),
                "m1",
            )
        self.observed.extend(seen)
        return seen

    def tell(self, robot_id: int, **changes: object) -> Knowledge:
        """Send a robot what it should know."""
        known: Knowledge = replace(knowledge(robot_id), **changes)  # type: ignore[arg-type]
        self.link.send_knowledge(known)
        return known

    def order(self, robot_id: int, order: wire.Order) -> str:
        """Give a robot an operator's order; return its id."""
        return send(self.bus, KEYS, robot_id, order, "operator", self.now_s)

    def links(self) -> list[tuple[int, str]]:
        """Return every change of a link so far."""
        return [
            (change.robot_id, change.link.value)
            for change in self.observed
            if isinstance(change, LinkChange)
        ]

    def position(self, robot_id: int) -> Point:
        """Return where a robot really is."""
        return self.simulation.world.robot_state(robot_id).position

    def velocity(self, robot_id: int) -> Point:
        """Return how fast a robot really is."""
        return self.simulation.world.robot_state(robot_id).velocity


@asynccontextmanager
async def rig(
    setup: WorldSetup,
    agent: AgentSettings | None = None,
    planner: Recorder | None = None,
    external: tuple[int, ...] = (),
) -> AsyncIterator[Rig]:
    """Open a world and a planner that reach each other."""
    made = Rig(LocalHub(), planner or Recorder())
    ids = [robot.id for robot in setup.robots]
    settings = SimulationSettings(
        seed=0, tick_s=TICK_S, agent=agent or AgentSettings(), external=external
    )
    async with LocalBus(made.hub) as vehicles, LocalBus(made.hub) as mission:
        made.simulation = Simulation(
            setup,
            settings,
            vehicles,
            KEYS,
            lambda robot_id: OnboardPilot(robot_id, made.recorder),
            "s1",
        )
        made.bus = mission
        made.link = TeamLink(mission, KEYS, ids, "p1", lambda: made.now_s, LinkSettings())
        async with made.link, made.simulation:
            yield made
