"""A mission in lockstep as a trial."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from server.lockstep.assembly import Assembly
from server.lockstep.job import PAPER_LATENCY, Latency, ScriptedComment
from server.mission.setup import GateMode, MissionSetup
from server.models import named_model
from server.scenarios.schema import Scenario
from server.settings import load_settings
from solver.directives import Proposal, Source, Weights


@dataclass(frozen=True, slots=True)
class PlannerChange:
    """A planner that differs from the scenario's."""

    horizon: int | None = None
    priced: bool = True
    """False: exposure has no price, only the chance constraints count (the paper)."""


@dataclass(frozen=True, slots=True)
class Policy:
    """How a mission is flown: what a cell of an experiment stands for."""

    name: str
    """Letters, digits and dashes."""

    llm: str
    comments: tuple[ScriptedComment, ...] = ()
    weights: Weights | None = None
    """Set by a person before the first tick; None leaves the scenario's."""

    planner: PlannerChange = field(default_factory=PlannerChange)


@dataclass(frozen=True, slots=True)
class MissionTrial:
    """One policy on one scenario under one seed."""

    policy: Policy
    scenario: Scenario
    seed: int
    gate: GateMode
    engine: str
    latency: Latency = PAPER_LATENCY

    @property
    def label(self) -> str:
        """Policy and seed."""
        return f"{self.policy.name}-seed-{self.seed}"

    def identity(self) -> Mapping[str, Any]:
        """Return what decides the figures: scenario, policy, seed, gate, engine, latency."""
        policy = self.policy
        return {
            "kind": "mission",
            "scenario": self.scenario.model_dump(mode="json", exclude={"seed"}),
            "seed": self.seed,
            "llm": named_model(policy.llm, load_settings()),
            "comments": [[comment.time_s, comment.text] for comment in policy.comments],
            "weights": None if policy.weights is None else list(policy.weights),
            "horizon": policy.planner.horizon,
            "priced": policy.planner.priced,
            "gate": self.gate.value,
            "engine": self.engine,
            "latency_s": [self.latency.task_s, self.latency.action_s],
        }

    def setup(self) -> MissionSetup:
        """Return the mission before its first tick."""
        setup = self.scenario.varied(seed=self.seed).mission_setup(self.engine)
        changes: dict[str, Any] = {"engine": self.engine}
        if self.policy.planner.horizon is not None:
            changes["horizon"] = self.policy.planner.horizon
        if not self.policy.planner.priced:
            changes |= {"sensing_failure_s": 0.0, "communication_failure_s": 0.0}
        return replace(setup, gate=self.gate, planner=replace(setup.planner, **changes))

    def perform(self) -> dict[str, Any]:
        """Fly it; return the run's JSON object.

        Raises ModelUnavailable when the model cannot be had, EngineUnavailable likewise.
        """
        assembly = Assembly(
            setup=self.setup(),
            world=self.scenario.world_setup(),
            llm=self.policy.llm,
            latency=self.latency,
            settings=load_settings(),
            opening=self._opening(),
        )
        return asyncio.run(assembly.run(self.policy.comments, lambda _: None))

    def _opening(self) -> tuple[Proposal, ...]:
        weights = self.policy.weights
        if weights is None:
            return ()
        return (Proposal("opening", Source.OPERATOR, asked_s=0.0, weights=tuple(weights)),)
