"""One live mission: the optimizer ten times a second, two models beside it, people above.

Drives the same core as lockstep does, in real time. A tick is: take what has arrived, begin,
solve in another thread, commit, send. Everything else (models, comments, the web side) happens
between ticks and enters the core only at the beginning of one.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from llm.chat import LanguageModel
from llm.prompts import Loop
from server.advice import Advisors
from server.encoding import EventKind, MissionState, Severity, comment_object
from server.exact import ExactSolver
from server.live.channel import Json, RequestRefused
from server.live.consulting import AdviceLoop, ModelLoop, Pace, SolverLoop
from server.live.figures import LiveFigures
from server.live.herald import Herald
from server.live.schedule import Schedule
from server.live.solving import Solver
from server.loops import LoopClock, LoopMeter
from server.mission.comments import MAX_STANDING
from server.mission.downlink import knowledge_for
from server.mission.tape import TapedCore
from server.result import LoopTally
from solver.directives import Proposal, Verdict
from solver.observations import Comment, HoldChange, HoldState, Link
from solver.problem import Budget, Rung
from solver.snapshot import CommentReceipt, Snapshot
from vehicles.messages import PlannerState, Truth, WorldAction
from vehicles.team_link import TeamLink

ITERATIONS: Final = 200
DEADLINE_SHARE: Final = 0.4
"""Of the tick, for the engine: it stops there with its best feasible iterate."""

PATIENCE_SHARE: Final = 0.8
"""Of the tick, for the solve: then the last plan goes on without it."""

KNOWLEDGE_TICKS: Final = 10
"""Each robot is told what it should know at least every so many ticks, and on changes."""

PAUSED_BEAT_S: Final = 0.2

MUSTER_S: Final = 3.0
"""Robots not heard by then are missing from the start."""

MUSTER_STEP_S: Final = 0.05

_PLANNER_STATES: Final = {
    MissionState.RUNNING: PlannerState.RUNNING,
    MissionState.HELD: PlannerState.HELD,
    MissionState.PAUSED: PlannerState.PAUSED,
}


@dataclass(frozen=True, slots=True)
class Terms:
    """How one live mission is run."""

    mission: str
    model_timeout_s: float = 8.0
    comments: tuple[tuple[float, str], ...] = ()
    """(mission time, text) of comments that are said by themselves, ordered by time."""


class LiveMission:
    """Owner of a mission's tick and its two loops. All methods on one event loop."""

    def __init__(
        self,
        terms: Terms,
        core: TapedCore,
        solver: Solver,
        link: TeamLink,
        adviser: LanguageModel | ExactSolver | None,
        tell: Callable[[Json], None],
        now: Callable[[], float],
    ) -> None:
        self.state = MissionState.CREATED
        self._terms = terms
        self._core = core
        self._solver = solver
        self._link = link
        self._herald = Herald(terms.mission, core.core.setup, tell)
        self._now = now
        self._setup = core.core.setup
        self._advisors = Advisors(core.core)
        self._figures = LiveFigures(self._setup)
        self._meter = LoopMeter()
        self._loops = self._make_loops(adviser)
        self._inbox: deque[Comment | HoldChange] = deque()
        self._proposals: deque[tuple[Proposal, asyncio.Future[Verdict]]] = deque()
        self._script = deque(terms.comments)
        self._flying = asyncio.Event()
        """Set while models are asked: from the first tick on, except while paused."""

        self._over = asyncio.Event()
        self._changed = asyncio.Event()
        self._ending: str | None = None
        self._comment_count = 0
        self._told: object = None
        self._began_s = now()

    # ------------------------------------------------------------------ what is asked of it

    async def run(self) -> None:
        """Fly until the mission's time is over or it is stopped."""
        await self._muster()
        self._began_s = self._now()
        self.state = MissionState.RUNNING
        async with asyncio.TaskGroup() as tasks:
            loops = [
                tasks.create_task(driver.run(self._flying), name=loop.value)
                for loop, driver in self._loops.items()
            ]
            try:
                await self._fly()
            finally:
                for task in loops:
                    task.cancel()
        self._end()

    def comment(self, text: str, author: str) -> Json:
        """Take a comment for the next tick. Raises RequestRefused when too many stand."""
        waiting = sum(isinstance(item, Comment) for item in self._inbox)
        if len(self._core.snapshot.receipts) + waiting >= MAX_STANDING:
            raise RequestRefused(
                "too_many_comments", f"{MAX_STANDING} comments stand already; wait for answers."
            )
        comment = self._comment(text, author)
        self._inbox.append(comment)
        return comment_object(CommentReceipt(comment))

    def hold(self, author: str) -> Json:
        """Let every robot hold from the next tick on."""
        self._inbox.append(HoldChange(HoldState.HELD, author))
        if self.state is MissionState.RUNNING:
            self._become(MissionState.HELD)
        return {"state": self.state.value}

    def resume(self, author: str) -> Json:
        """Go on after hold or pause."""
        self._inbox.append(HoldChange(HoldState.FLYING, author))
        if self.state is MissionState.PAUSED:
            self._link.control_world(WorldAction.RESUME)
            self._herald.say(EventKind.HOLD, Severity.INFO, f"Mission time goes on ({author}).")
        if self.state is not MissionState.ENDED:
            self._become(MissionState.RUNNING)
        return {"state": self.state.value}

    def pause(self, author: str) -> Json:
        """Let mission time stand still; a simulated world pauses too."""
        if self.state in (MissionState.RUNNING, MissionState.HELD):
            self._become(MissionState.PAUSED)
            self._link.control_world(WorldAction.PAUSE)
            self._herald.say(
                EventKind.HOLD, Severity.WARNING, f"Mission time stands still ({author})."
            )
        return {"state": self.state.value}

    async def stop(self, author: str) -> Json:
        """End the mission and return its result."""
        if self._ending is None:
            self._ending = f"Mission stopped by {author}."
            self._changed.set()
        await self._over.wait()
        return {"result": self.result()}

    def result(self) -> Json:
        """Return the figures so far."""
        task, action = (
            self._loops[loop].tally if loop in self._loops else LoopTally()
            for loop in (Loop.TASK, Loop.ACTION)
        )
        wall_s = self._now() - self._began_s
        return self._figures.result(self._core.snapshot, task, action, wall_s)

    # ------------------------------------------------------------------ the tick

    async def _muster(self) -> None:
        """Wait until every robot is heard, or long enough; then mission time begins."""
        deadline_s = self._now() + MUSTER_S
        ids = self._setup.robot_ids
        while self._ending is None and self._now() < deadline_s:
            for observation in self._link.drain(0.0):
                self._core.observe(observation)
            if all(self._link.link(robot_id) is Link.CONNECTED for robot_id in ids):
                return
            await asyncio.sleep(MUSTER_STEP_S)

    async def _fly(self) -> None:
        """Tick on a grid; a pause begins a new grid where mission time stood still."""
        base_s = 0.0
        period_s = self._setup.live_tick_s
        while self._ending is None:
            start_s = self._now()
            schedule = Schedule(period_s, start_s)
            while self._ending is None and self.state is not MissionState.PAUSED:
                await asyncio.sleep(max(0.0, schedule.due_s - self._now()))
                time_s = base_s + schedule.due_s - start_s
                await self._tick(time_s)
                self._let_models_speak()
                self._meter.miss(schedule.advance(self._now()))
                if time_s + period_s > self._setup.duration_s - 1e-9:
                    self._ending = "The mission's time is over."
            base_s += schedule.due_s - start_s
            await self._wait_paused()

    def _let_models_speak(self) -> None:
        """Let models be asked from the first tick on, and not while time stands still."""
        if self.state is MissionState.PAUSED:
            self._flying.clear()
        else:
            self._flying.set()

    async def _tick(self, time_s: float) -> None:
        """Take what arrived, plan, send, tell."""
        began_s = self._now()
        core, period_s = self._core, self._setup.live_tick_s
        for observation in self._link.drain(time_s):
            core.observe(observation)
        self._take_waiting(time_s)
        problem = core.begin(time_s)
        budget = Budget(iterations=ITERATIONS, deadline_s=DEADLINE_SHARE * period_s)
        solution = await self._solver.solve(problem, budget, PATIENCE_SHARE * period_s)
        setpoints = core.commit(solution)
        self._link.send_setpoints(setpoints, self._terms.mission)
        self._beat(core.snapshot)
        ended_s = self._now()
        good = solution.rung is Rung.CONVERGED
        self._meter.record(ended_s, ended_s - began_s, success=good)
        self._share_knowledge(core.snapshot)
        self._tell_snapshot(core.snapshot)

    def _take_waiting(self, time_s: float) -> None:
        """Give the core what people and models said since the last tick."""
        while self._script and self._script[0][0] <= time_s + 1e-9:
            self._inbox.append(self._comment(self._script.popleft()[1], "operator"))
        while self._inbox:
            self._core.observe(self._inbox.popleft())
        while self._proposals:
            proposal, answer = self._proposals.popleft()
            verdict = self._core.propose(proposal)
            if not answer.done():
                answer.set_result(verdict)

    async def _wait_paused(self) -> None:
        """Keep the planner's sign of life up while mission time stands still."""
        while self.state is MissionState.PAUSED and self._ending is None:
            self._beat(self._core.snapshot)
            self._changed.clear()
            try:
                async with asyncio.timeout(PAUSED_BEAT_S):
                    await self._changed.wait()
            except TimeoutError:
                continue

    def _beat(self, snapshot: Snapshot) -> None:
        state = _PLANNER_STATES[self.state]
        self._link.send_heartbeat(self._terms.mission, snapshot.tick, snapshot.time_s, state)

    def _share_knowledge(self, snapshot: Snapshot) -> None:
        """Tell robots what they need to fly on alone: all on a change, else in turn."""
        relevant = (snapshot.directives, len(snapshot.zones), snapshot.robots.links)
        changed, self._told = relevant != self._told, relevant
        ids = self._setup.robot_ids
        chosen = ids if changed else ids[snapshot.tick % KNOWLEDGE_TICKS :: KNOWLEDGE_TICKS]
        for robot_id in chosen:
            self._link.send_knowledge(knowledge_for(robot_id, self._core.core))

    # ------------------------------------------------------------------ the loops

    def _make_loops(self, adviser: LanguageModel | ExactSolver | None) -> dict[Loop, AdviceLoop]:
        periods = self._setup.loops
        task = Pace(LoopClock(periods.task_period_s, self._now()), self._now)
        if adviser is None:
            return {}
        if isinstance(adviser, ExactSolver):
            return {Loop.TASK: SolverLoop(task, adviser, self._snapshot, self._propose)}
        action = Pace(LoopClock(periods.action_period_s, self._now()), self._now)
        kinds = {
            Loop.TASK: (task, self._advisors.task),
            Loop.ACTION: (action, self._advisors.action),
        }
        return {
            loop: ModelLoop(
                pace,
                adviser,
                self._terms.model_timeout_s,
                consult,
                self._snapshot,
                self._propose,
                self._herald.outcome,
            )
            for loop, (pace, consult) in kinds.items()
        }

    def _snapshot(self) -> Snapshot:
        return self._core.snapshot

    async def _propose(self, proposal: Proposal) -> Verdict:
        """Let a proposal wait for the next tick; return the core's verdict."""
        answer: asyncio.Future[Verdict] = asyncio.get_running_loop().create_future()
        self._proposals.append((proposal, answer))
        return await answer

    # ------------------------------------------------------------------ telling

    def _tell_snapshot(self, snapshot: Snapshot) -> None:
        """Send the snapshot and its news to the web side, and let the loops look at it."""
        truth = self._link.truth()
        self._figures.add(snapshot, truth)
        self._herald.announce(snapshot)
        for notice in self._link.take_notices():
            self._herald.notice(notice)
        woken = self._advisors.look(snapshot)
        for loop, wanted in ((Loop.TASK, woken.task), (Loop.ACTION, woken.action)):
            if wanted and loop in self._loops:
                self._loops[loop].wake()
        self._show(truth)

    def _show(self, truth: Truth | None) -> None:
        now_s = self._now()
        reports = {"optimizer": self._meter.report(now_s)}
        for loop, driver in self._loops.items():
            reports[f"{loop.value}_llm"] = driver.meter.report(now_s)
        self._herald.show(self._core.snapshot, self.state, reports, self._figures.hits(), truth)

    def _become(self, state: MissionState) -> None:
        self.state = state
        self._let_models_speak()
        self._changed.set()
        self._show(self._link.truth())

    def _end(self) -> None:
        self.state = MissionState.ENDED
        self._show(self._link.truth())
        words = self._ending or "The mission has ended."
        self._herald.say(EventKind.ENDED, Severity.INFO, words, {"result": self.result()})
        self._over.set()

    def _comment(self, text: str, author: str) -> Comment:
        self._comment_count += 1
        ttl_s = self._setup.loops.comment_ttl_s
        time_s = max(0.0, self._core.snapshot.time_s)
        return Comment(f"c{self._comment_count}", text, time_s, ttl_s, author)
