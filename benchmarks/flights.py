"""Missions flown in lockstep without any model, once per seed, and what each came to."""

import asyncio
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from server.lockstep.council import Council
from server.lockstep.driver import Lockstep
from server.mission.core import MissionCore
from server.mission.tape import NoTape, TapedCore
from server.scenarios import library
from server.scenarios.schema import Scenario
from solver import engines
from solver.observations import Link
from solver.planner import Planner
from solver.snapshot import Snapshot
from solver.streams import Streams
from vehicles.world.state import Truth
from vehicles.world.world import World

_ROUNDING_M = 1e-6
_SATURATED = 0.99
"""Share of its bound from which on a control counts as saturated."""


@dataclass(frozen=True, slots=True)
class Job:
    """One run to do."""

    scenario: str
    """A file, or the name of one that comes with Falconer."""

    seed: int
    changes: tuple[tuple[str, Any], ...] = ()
    """What is to differ from the file: ("planner.horizon", 1)."""


@dataclass(frozen=True, slots=True)
class Run:
    """What one run came to."""

    scenario: str
    seed: int
    trace: float
    """Accumulated over the steps: the team's estimate after the update."""

    trace_authors: float
    """By the authors' accounting: a target counts twice while a watcher flies alone, and not
    at all while everybody does. Equal to `trace` outside their scenarios."""

    sensing_attacks: int
    communication_attacks: int
    trajectory_length_m: float
    position_error_m: float
    closest_m: float | None
    """How near two connected robots came that had been at least `min_dist` apart since both
    were connected; None when they always stayed so."""

    saturated: float
    """Share of set-points with an axis at its bound."""

    turning: float
    """Mean change of velocity from one set-point to the next, m/s."""

    tick_ms: float


class Separations:
    """Watches the distances of connected pairs."""

    def __init__(self, min_dist_m: float) -> None:
        self._min_dist_m = min_dist_m
        self._apart: set[tuple[int, int]] = set()
        self.closest_m = float("inf")

    def look(self, snapshot: Snapshot, truth: Truth) -> None:
        """Take the positions after a move and the links it was planned with."""
        linked = dict(zip(snapshot.robots.ids, snapshot.robots.links, strict=True))
        for first, second in combinations(truth.robots, 2):
            pair = (first.id, second.id)
            if {linked[first.id], linked[second.id]} != {Link.CONNECTED}:
                self._apart.discard(pair)
                continue
            gap_m = float(np.hypot(*np.subtract(first.position, second.position)))
            if gap_m >= self._min_dist_m - _ROUNDING_M:
                self._apart.add(pair)
            elif pair in self._apart:
                self.closest_m = min(self.closest_m, gap_m)


class Commands:
    """Watches how restless the set-points are: as moves, so that flights alone count too."""

    def __init__(self, scenario: Scenario) -> None:
        self._step_s = scenario.tick_s
        self._limits = {r.id: np.array((r.control_lower, r.control_upper)) for r in scenario.robots}
        self._places: dict[int, np.ndarray] = {}
        self._last: dict[int, np.ndarray] = {}
        self._saturated: list[bool] = []
        self._turns: list[float] = []

    def look(self, truth: Truth) -> None:
        """Take the positions after a move."""
        for robot in truth.robots:
            place = np.array(robot.position)
            before = self._places.get(robot.id)
            self._places[robot.id] = place
            if before is None:
                continue
            velocity = (place - before) / self._step_s
            low, high = self._limits[robot.id]
            at_bound = (velocity <= _SATURATED * low) | (velocity >= _SATURATED * high)
            self._saturated.append(bool(at_bound.any()))
            if robot.id in self._last:
                self._turns.append(float(np.hypot(*(velocity - self._last[robot.id]))))
            self._last[robot.id] = velocity

    @property
    def saturated(self) -> float:
        """Share of moves with an axis at its bound."""
        return float(np.mean(self._saturated)) if self._saturated else 0.0

    @property
    def turning(self) -> float:
        """Mean change of velocity between moves, m/s."""
        return float(np.mean(self._turns)) if self._turns else 0.0


def changed(scenario: Scenario, changes: tuple[tuple[str, Any], ...]) -> Scenario:
    """Return a scenario with other values at dotted paths.

    Raises:
        pydantic.ValidationError: A path or a value that a scenario cannot have.
    """
    document = scenario.model_dump()
    for path, value in changes:
        *sections, name = path.split(".")
        part = document
        for section in sections:
            part = part.setdefault(section, {})
        part[name] = value
    return Scenario.model_validate(document)


def fly(job: Job) -> Run:
    """Do one run in lockstep, with no model and nothing recorded."""
    scenario = changed(library.load(job.scenario).varied(seed=job.seed), job.changes)
    setup = scenario.mission_setup()
    world = World(scenario.world_setup(), Streams(setup.seed))
    planner = Planner(engines.create(setup.planner.engine or engines.default_engine()))
    council = Council(TapedCore(MissionCore(setup), NoTape()), setup.gate, planner)
    mission = Lockstep(setup, world, council, planner, None)
    separations = Separations(setup.planner.min_dist_m)
    commands = Commands(scenario)

    def look(_: int) -> None:
        truth = world.truth()
        separations.look(mission.snapshot, truth)
        commands.look(truth)

    result = asyncio.run(mission.run(look))
    return Run(
        scenario=Path(job.scenario).stem,
        seed=job.seed,
        trace=result["accumulated_trace"],
        trace_authors=result.get("accumulated_trace_authors", result["accumulated_trace"]),
        sensing_attacks=result["sensing_attacks"],
        communication_attacks=result["communication_attacks"],
        trajectory_length_m=result["trajectory_length_m"],
        position_error_m=result["position_error_m"],
        closest_m=None if np.isinf(separations.closest_m) else separations.closest_m,
        saturated=commands.saturated,
        turning=commands.turning,
        tick_ms=result["optimizer"]["median_ms"],
    )
