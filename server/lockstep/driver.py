"""Steps a mission through virtual time: attack, report, plan, fly; models in between."""

import time
from collections.abc import Callable
from typing import Any, Protocol

from server.gate.encoding import with_decisions
from server.lockstep.council import Council
from server.lockstep.job import ScriptedComment
from server.lockstep.robots import SimulatedTeam
from server.mission.setup import MissionSetup
from server.result import LoopTally, RunTally, WorldFigures, position_errors_m, result_json
from solver.observations import Comment
from solver.planner import Planner
from solver.problem import Budget
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles.world.state import Truth
from vehicles.world.world import World

LOCKSTEP_BUDGET = Budget(iterations=200)
"""Of a solve: iterations, never wall time, so that a run can be repeated bit for bit."""

Witness = Callable[[Snapshot, World], None]
"""Told of every finished step, after its move."""


class Advice(Protocol):
    """Whoever advises a lockstep mission."""

    @property
    def task(self) -> LoopTally:
        """The task loop's figures."""
        ...

    @property
    def action(self) -> LoopTally:
        """The action loop's figures."""
        ...

    async def deliver(self, now_s: float) -> None:
        """Hand over every answer that has arrived by now."""
        ...

    async def ask(self, now_s: float) -> None:
        """Look at the newest snapshot and ask where a loop is due."""
        ...


class Lockstep:
    """One mission in virtual time. Same setup, seed and answers: same run, bit for bit."""

    def __init__(
        self,
        setup: MissionSetup,
        world: World,
        council: Council,
        planner: Planner,
        advice: Advice | None,
        comments: tuple[ScriptedComment, ...] = (),
        witness: Witness | None = None,
    ) -> None:
        self._setup = setup
        self._world = world
        self._core = council.core
        self._keeper = council.keeper
        self._council = council
        self._planner = planner
        self._advice = advice
        self._witness = witness
        self._script = sorted(comments, key=lambda c: c.time_s)
        self._said = 0
        self._team = SimulatedTeam(setup, world, planner)
        self._tally = RunTally()

    @property
    def snapshot(self) -> Snapshot:
        """The newest snapshot."""
        return self._core.snapshot

    def take_over(self, said: int) -> None:
        """Go on with a mission that has flown already: its core and its world are at one time.

        `said` comments were spoken before; ids of further ones count on from there.
        """
        self._said = said
        self._team.take_over(self._core.core, self._core.snapshot.time_s)

    async def run(self, progress: Callable[[int], None], begin_s: float = 0.0) -> dict[str, Any]:
        """Run all steps and return the result; `progress` is told every finished step.

        The first step is at mission time `begin_s`. Wall time counts from here: imports and
        kernel loading are over.
        """
        started_s = time.perf_counter()
        self._team.brief(self._core.core)
        for step in range(self._setup.steps):
            await self.step(begin_s + step * self._setup.tick_s)
            progress(step + 1)
        self._council.tell()
        wall_s = time.perf_counter() - started_s
        task = self._advice.task if self._advice else LoopTally()
        action = self._advice.action if self._advice else LoopTally()
        result = result_json(
            self._setup, self.snapshot, self._tally, self._figures(), task, action, wall_s
        )
        return with_decisions(result, self._keeper, self._council.forecasts_s)

    async def step(self, now_s: float) -> None:
        """Run one step of the authors' order: attack, report, plan, fly, then ask."""
        core, team = self._core, self._team
        for heard in team.suffer(now_s):
            core.observe(heard)
        self._say(now_s)
        if self._advice is not None:
            await self._advice.deliver(now_s)
        for heard in team.report(core.core.directives, now_s):
            core.observe(heard)
        truth = self._world.truth()
        solution = self._planner.solve(core.begin(now_s), LOCKSTEP_BUDGET)
        setpoints = core.commit(solution)
        self._keeper.look(self.snapshot)
        alone = team.fly_alone(now_s, LOCKSTEP_BUDGET)
        self._count(truth)
        team.brief(core.core)
        team.move(setpoints, alone)
        if self._witness is not None:
            self._witness(core.snapshot, self._world)
        self._council.tell()
        if self._advice is not None:
            await self._advice.ask(now_s)

    def _say(self, now_s: float) -> None:
        """Hand over the scripted comments that are due."""
        while self._script and self._script[0].time_s <= now_s + 1e-9:
            comment = self._script.pop(0)
            self._said += 1
            ttl_s = self._setup.loops.comment_ttl_s
            self._core.observe(Comment(f"c{self._said}", comment.text, now_s, ttl_s))

    def _count(self, truth: Truth) -> None:
        """Count the tick: estimates beside the truth of the moment they are of."""
        snapshot = self._core.snapshot
        places = {target.id: target.position for target in truth.targets}
        errors_m = position_errors_m(snapshot, places)
        connected = len(self._team.jammed) < len(self._setup.robots)
        authors = (snapshot.trace if connected else 0.0) + self._team.private_trace()
        self._tally.step(snapshot, errors_m, authors)

    def _figures(self) -> WorldFigures:
        paths = [self._world.path_length_m(robot_id) for robot_id in self._setup.robot_ids]
        return WorldFigures(
            sensing_attacks=self._world.hits(ZoneKind.SENSING),
            communication_attacks=self._world.hits(ZoneKind.COMMUNICATION),
            trajectory_length_m=sum(paths) / len(paths),
            min_separation_m=self._world.min_separation_m,
        )
