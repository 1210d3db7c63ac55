"""Live missions in virtual time: core, loops, mock model and a simulated world on one local bus."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from llm.chat import ChatReply, ChatRequest, ErrorKind, LanguageModel, ModelError
from llm.mock.app import in_process_client
from server.encoding import MissionState
from server.gate.rollout import Comparison, Forecast, forecast
from server.live.mission import LiveMission, Terms
from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from server.mission.tape import MemoryTape, TapedCore
from server.scenarios import library
from solver import engines
from solver.planner import Planner
from solver.problem import Budget, Problem, Solution
from tests.server.waiting import eventually
from vehicles.keys import TeamKeys
from vehicles.link_monitor import LinkSettings
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.onboard import OnboardPilot
from vehicles.settings import SimulationSettings
from vehicles.simulation import Simulation
from vehicles.team_link import TeamLink

ENGINE = engines.default_engine()
"""What a mission flies with unless told otherwise."""


class InlineSolver:
    """Solves in the event loop: virtual time stands still meanwhile."""

    def __init__(self) -> None:
        self.planner = Planner(engines.create(ENGINE))

    async def solve(self, problem: Problem, budget: Budget, patience_s: float) -> Solution:
        return self.planner.solve(problem, Budget(iterations=budget.iterations))


class InlineForecaster:
    """Predicts in the event loop: virtual time stands still meanwhile."""

    def __init__(self) -> None:
        self.planner = Planner(engines.create(ENGINE))
        self.spent_s: list[float] = []

    async def predict(self, comparison: Comparison, patience_s: float) -> Forecast | None:
        return forecast(comparison, self.planner)


class DeadModel:
    """An endpoint where nobody is."""

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        await asyncio.sleep(timeout_s)
        raise ModelError(ErrorKind.TIMEOUT, f"no answer within {timeout_s:g} s")


@dataclass
class Flight:
    """A mission that flies, and what it has told."""

    setup: MissionSetup
    mission: LiveMission
    core: TapedCore
    tape: MemoryTape
    link: TeamLink
    simulation: Simulation
    told: list[dict[str, Any]] = field(default_factory=list)

    @property
    def snapshots(self) -> list[dict[str, Any]]:
        return [said for said in self.told if said["type"] == "snapshot"]

    @property
    def events(self) -> list[dict[str, Any]]:
        return [said for said in self.told if said["type"] == "event"]

    def words(self) -> str:
        """Everything that was told in words."""
        return "\n".join(event["text"] for event in self.events)

    async def until(self, time_s: float) -> None:
        """Let mission time pass."""
        await eventually(lambda: self.core.snapshot.time_s >= time_s, within_s=1000.0)


def hardware_setup(**changes: Any) -> MissionSetup:
    """The paper's hardware case."""
    return replace(library.named("hardware").mission_setup(ENGINE), **changes)


@asynccontextmanager
async def flight(
    model: LanguageModel | None = None,
    terms: Terms | None = None,
    setup: MissionSetup | None = None,
    living: Literal["world", "nobody"] = "world",
) -> AsyncIterator[Flight]:
    """Fly the hardware case until the block ends; then the mission is stopped if need be."""
    setup = setup or hardware_setup()
    keys, hub = TeamKeys(setup.team), LocalHub()
    now = asyncio.get_running_loop().time
    tape = MemoryTape()
    core = TapedCore(MissionCore(setup), tape)
    pilots = Planner(engines.create(ENGINE))
    world = library.named("hardware").world_setup()
    settings = SimulationSettings(seed=setup.seed, tick_s=setup.live_tick_s)
    link_settings = LinkSettings(lost_after_s=setup.lost_after_s)
    told: list[dict[str, Any]] = []
    async with AsyncExitStack() as stack:
        planner_bus = await stack.enter_async_context(LocalBus(hub))
        world_bus = await stack.enter_async_context(LocalBus(hub))
        link = await stack.enter_async_context(
            TeamLink(planner_bus, keys, setup.robot_ids, "p", now, link_settings)
        )
        simulation = Simulation(
            world, settings, world_bus, keys, lambda rid: OnboardPilot(rid, pilots), "w"
        )
        mission = LiveMission(
            terms or Terms("m1"),
            core,
            InlineSolver(),
            InlineForecaster(),
            link,
            model,
            told.append,
            now,
        )
        tasks = [asyncio.create_task(mission.run())]
        if living == "world":
            await stack.enter_async_context(simulation)
            tasks.append(asyncio.create_task(simulation.run()))
        try:
            yield Flight(setup, mission, core, tape, link, simulation, told)
            if mission.state is not MissionState.ENDED:
                await mission.stop("test")
            await tasks[0]
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


def mock_model() -> Any:
    """The built-in rule model as a context."""
    return in_process_client()
