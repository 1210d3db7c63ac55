"""Asking a model outside a mission: one situation, both loops, with and without an example."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from llm.answers import AnswerError, read_action, read_task
from llm.chat import LanguageModel, ModelError
from llm.consultation import Consultation, Retry, consult
from llm.history import History
from llm.prompts import PromptView
from llm.styles import Examples, Loop
from server.experiments.generation import Layout, generated
from server.lockstep.council import Council
from server.lockstep.driver import Lockstep
from server.mission.core import MissionCore
from server.mission.setup import GateMode
from server.mission.tape import NoTape, TapedCore
from server.models import Manner, manner_of, named_model, open_model
from server.settings import load_settings
from solver import engines
from solver.observations import ZoneDrawn
from solver.planner import Planner
from solver.streams import Streams
from vehicles.world.setup import WorldSetup
from vehicles.world.world import World

REAL_TIMEOUT_S = 120.0
"""Longest a real call may take: nobody flies meanwhile."""


@dataclass(frozen=True, slots=True)
class QuestionTrial:
    """One situation put to one model: four questions."""

    llm: str
    name: str
    """Of the model, for files."""

    layout: Layout
    seed: int
    engine: str

    @property
    def label(self) -> str:
        """Model, size and seed."""
        return f"{self.name}-{self.layout.targets}-targets-{self.layout.zones}-zones-{self.seed}"

    def identity(self) -> Mapping[str, Any]:
        """Return what decides the answers: the situation and the model."""
        layout = self.layout
        return {
            "kind": "questions",
            "llm": named_model(self.llm, load_settings()),
            "robots": layout.robots,
            "targets": layout.targets,
            "zones": layout.zones,
            "capacity": layout.capacity,
            "area": layout.area_per_robot_m2,
            "steps": [layout.steps, layout.tick_s],
            "seed": self.seed,
            "engine": self.engine,
        }

    def perform(self) -> dict[str, Any]:
        """Fly up to the situation and ask. Raises ModelUnavailable."""
        return asyncio.run(self._ask())

    async def _ask(self) -> dict[str, Any]:
        manner = manner_of(self.llm)
        view = await self.situation(manner)
        async with open_model(self.llm, load_settings(), niceness=0) as model:
            if model is None:
                raise ValueError(f"{self.llm} is no model that can be asked")
            answers = [
                await _answered(model, loop, view, examples)
                for loop in Loop
                for examples in Examples
            ]
        return {"answers": answers}

    async def situation(self, manner: Manner) -> PromptView:
        """Fly the scenario without advice, every zone known; return what a model would see."""
        scenario = generated(self.layout, self.seed)
        setup, world = scenario.mission_setup(self.engine), scenario.world_setup()
        core = TapedCore(MissionCore(setup), NoTape())
        for zone in _zones(world):
            core.observe(zone)
        history = History()
        planner = Planner(engines.create(self.engine))
        council = Council(core, GateMode.OFF, Planner(engines.create(self.engine)))
        mission = Lockstep(setup, World(world, Streams(self.seed)), council, planner, None)
        await mission.run(lambda _: history.record(mission.snapshot))
        return PromptView(
            snapshot=mission.snapshot,
            history=history.entries,
            limits=core.core.limits,
            attacks=history.latest_attacks,
            style=manner.style,
        )


def _zones(world: WorldSetup) -> list[ZoneDrawn]:
    return [ZoneDrawn(zone.zone) for zone in world.zones]


async def _answered(
    model: LanguageModel, loop: Loop, view: PromptView, examples: Examples
) -> dict[str, Any]:
    """Ask one loop's question as a mission would, retries and all; return how it went."""
    asked = PromptView(
        snapshot=view.snapshot,
        history=view.history,
        limits=view.limits,
        attacks=view.attacks,
        style=view.style,
        examples=examples,
    )
    consultation = consult(loop, asked, f"{loop.value}-{examples.value}")
    outcome: object = None
    while outcome is None or isinstance(outcome, Retry):
        try:
            reply = await model.complete(consultation.request, REAL_TIMEOUT_S)
        except ModelError as error:
            outcome = consultation.fail(error)
        else:
            outcome = consultation.receive(reply, view.snapshot)
    stats = consultation.stats
    return {
        "loop": loop.value,
        "examples": examples.value,
        "valid_first": stats.valid_first,
        "valid": stats.valid,
        "tries": stats.tries,
        "well_formed": _well_formed(consultation),
        "tokens_in": stats.tokens_in,
        "tokens_out": stats.tokens_out,
        "latency_s": stats.latency_s,
        "reasons": [list(attempt.reasons) for attempt in consultation.attempts],
    }


def _well_formed(consultation: Consultation) -> int:
    """Return how many answers of a consultation could be read, whatever they said."""
    read = read_task if consultation.loop is Loop.TASK else read_action
    count = 0
    for attempt in consultation.attempts:
        try:
            read(attempt.text)
        except AnswerError:
            continue
        count += 1
    return count
