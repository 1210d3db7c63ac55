"""Puts a lockstep run together from a setup, a world and the choice of a model."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from server.lockstep.advice import VirtualAdvice
from server.lockstep.council import Council, Listener
from server.lockstep.driver import LOCKSTEP_BUDGET, Advice, Lockstep, Witness
from server.lockstep.exact import ExactAdvice
from server.lockstep.job import Latency, ScriptedComment
from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from server.mission.tape import NoTape, Recorder, TapedCore
from server.models import EXACT, manner_of, open_model
from server.settings import Settings
from solver import engines
from solver.directives import Proposal
from solver.planner import Planner
from solver.streams import Streams
from vehicles.world.setup import WorldSetup
from vehicles.world.world import World


class OpeningRefused(Exception):
    """Raised when what people ask for before the first tick breaks the rules."""


@dataclass(frozen=True, slots=True)
class Assembly:
    """What a lockstep run is made of."""

    setup: MissionSetup
    world: WorldSetup
    llm: str
    latency: Latency
    settings: Settings
    opening: tuple[Proposal, ...] = ()
    """What people ask for before the first tick."""

    async def run(
        self,
        comments: tuple[ScriptedComment, ...],
        progress: Callable[[int], None],
        recorder: Recorder | None = None,
        say: Callable[[str], None] = lambda _: None,
        witness: Witness | None = None,
        listener: Listener | None = None,
    ) -> dict[str, Any]:
        """Run the mission and return its result; `say` is told in words what takes its time.

        `witness` sees every finished step, `listener` every decision.

        Raises ModelUnavailable when the model cannot be had, EngineUnavailable likewise,
        OpeningRefused when what people ask for breaks the rules.
        """
        engine = engines.create(self.setup.planner.engine or engines.default_engine())
        core = TapedCore(MissionCore(self.setup), recorder or NoTape())
        council = Council(core, self.setup.gate, Planner(engines.create(engine.name)))
        if listener is not None:
            council.listeners.append(listener)
        for proposal in self.opening:
            verdict = core.propose(proposal)
            if not verdict.accepted:
                raise OpeningRefused(" ".join(verdict.violations))
        planner = Planner(engine)
        # Kernels are loaded, or an expression built, before anything is counted.
        planner.solve(MissionCore(self.setup).begin(0.0), LOCKSTEP_BUDGET)
        async with open_advice(self.llm, self.settings, council, self.latency, say) as advice:
            run = Lockstep(
                self.setup,
                World(self.world, Streams(self.setup.seed)),
                council,
                planner,
                advice,
                comments,
                witness,
            )
            return await run.run(progress)


@asynccontextmanager
async def open_advice(
    llm: str,
    settings: Settings,
    council: Council,
    latency: Latency,
    say: Callable[[str], None] = lambda _: None,
) -> AsyncIterator[Advice | None]:
    """Yield whoever advises a lockstep mission. Raises ModelUnavailable."""
    # Mission time waits for the model here: it need not step back.
    async with open_model(llm, settings, say, niceness=0) as model:
        if llm == EXACT:
            yield ExactAdvice(council)
        elif model is not None:
            yield VirtualAdvice(council, model, latency, manner_of(llm))
        else:
            yield None
