"""Puts a lockstep run together from a setup, a world and the choice of a model."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from server.lockstep.advice import Latency, VirtualAdvice
from server.lockstep.driver import Advice, Lockstep, ScriptedComment
from server.lockstep.exact import ExactAdvice
from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from server.mission.tape import NoTape, Recorder, TapedCore
from server.models import EXACT, open_model
from server.settings import Settings
from solver import engines
from solver.planner import Planner
from solver.streams import Streams
from vehicles.world.setup import WorldSetup
from vehicles.world.world import World


@dataclass(frozen=True, slots=True)
class Assembly:
    """What a lockstep run is made of."""

    setup: MissionSetup
    world: WorldSetup
    llm: str
    latency: Latency
    settings: Settings

    async def run(
        self,
        comments: tuple[ScriptedComment, ...],
        progress: Callable[[int], None],
        recorder: Recorder | None = None,
    ) -> dict[str, Any]:
        """Run the mission and return its result.

        Raises ModelUnavailable when the model cannot be had, EngineUnavailable likewise.
        """
        engine = engines.create(self.setup.planner.engine or engines.default_engine())
        core = TapedCore(MissionCore(self.setup), recorder or NoTape())
        async with open_model(self.llm, self.settings) as model:
            advice: Advice | None = None
            if self.llm == EXACT:
                advice = ExactAdvice(core)
            elif model is not None:
                advice = VirtualAdvice(core, model, self.latency)
            run = Lockstep(
                self.setup,
                World(self.world, Streams(self.setup.seed)),
                core,
                Planner(engine),
                advice,
                comments,
            )
            return await run.run(progress)
