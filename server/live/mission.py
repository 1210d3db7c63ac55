"""One live mission: the optimizer ten times a second, two models beside it, people above.

Drives the same core as lockstep does, in real time. A tick is: take what has arrived, begin,
solve in another thread, commit, send. Everything else (models, comments, the web side) happens
between ticks and enters the core only at the beginning of one.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from llm.chat import LanguageModel
from llm.prompts import Loop
from server.advice import Advisors
from server.encoding import EventKind, MissionState, Severity, comment_object
from server.exact import ExactSolver
from server.gate.decisions import Decision
from server.live.advisers import advice_loops, loop_reports
from server.live.channel import Json, RequestRefused
from server.live.consulting import AdviceLoop
from server.live.council import LiveCouncil
from server.live.figures import KeptFigures, LiveFigures
from server.live.forecasting import Forecaster
from server.live.herald import Herald
from server.live.overrides import Overrides
from server.live.recording import FlightRecorder
from server.live.relief import stand_in
from server.live.saving import Saver
from server.live.schedule import Schedule
from server.live.solving import Solver
from server.loops import LoopMeter
from server.mission.comments import MAX_STANDING
from server.mission.downlink import Briefing, Turns
from server.mission.tape import NoTape, TapedCore
from server.models import Manner
from server.result import LoopTally
from solver.observations import Comment, HoldChange, HoldState, Link, Observation
from solver.problem import Budget, Rung
from solver.snapshot import CommentReceipt, Snapshot
from vehicles.messages import PlannerState, Truth, WorldAction
from vehicles.team_link import TeamLink

ITERATIONS: Final = 200
DEADLINE_SHARE: Final = 0.4
"""Of the tick, for the engine: it stops there with its best feasible iterate."""

PATIENCE_SHARE: Final = 0.8
"""Of the tick, for the solve: then the last plan goes on without it."""

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
    manner: Manner = field(default_factory=Manner)
    comments: tuple[tuple[float, str], ...] = ()
    """(mission time, text) of comments that are said by themselves, ordered by time."""

    comments_said: int = 0
    """How many of those were said before a mission was broken off."""

    decisions_made: int = 0
    """Numbers of decisions that were given away by then."""

    figures: KeptFigures | None = None
    """What was counted by then."""


class LiveMission:
    """Owner of a mission's tick and its two loops. All methods on one event loop."""

    def __init__(
        self,
        terms: Terms,
        core: TapedCore,
        solver: Solver,
        forecaster: Forecaster,
        link: TeamLink,
        adviser: LanguageModel | ExactSolver | None,
        tell: Callable[[Json], None],
        now: Callable[[], float],
        recorder: FlightRecorder | None = None,
    ) -> None:
        self._recorder = recorder or FlightRecorder(None, NoTape())
        self._recorder.failed = self._recording_failed

        def tell_all(message: Json) -> None:
            self._recorder.tell(message)
            tell(message)

        self.state = MissionState.CREATED
        # What it begins in once its robots are mustered, unless somebody says otherwise.
        self._first = MissionState.RUNNING if core.core.setup.start is None else MissionState.HELD
        self._terms = terms
        self._core = core
        self._solver = solver
        self._link = link
        self._herald = Herald(terms.mission, core.core.setup, tell_all, now)
        self._changed = asyncio.Event()
        self._council = LiveCouncil(
            core,
            forecaster,
            self._herald,
            self._changed.set,
            self._note_decision,
            terms.decisions_made,
        )
        self._saver = Saver(terms.mission, core.core, tell, self._kept_figures)
        self._now = now
        self._setup = core.core.setup
        self._advisors = Advisors(core.core, terms.manner.style)
        self._figures = LiveFigures.after(self._setup, terms.figures)
        self._meter = LoopMeter()
        self._loops = self._make_loops(adviser)
        self._stand_in = stand_in(adviser, self._setup, self._snapshot, self._council.propose, now)
        self._inbox: deque[Observation] = deque()
        self._overrides = Overrides(core.core, self._council, self._herald, self._inbox.append)
        self._script = deque(terms.comments)
        self._flying = asyncio.Event()
        """Set while models are asked: from the first tick on, except while paused."""

        self._over = asyncio.Event()
        self._ending: str | None = None
        self._comment_count = terms.comments_said
        self._turns = Turns(self._setup.robot_ids)
        self._began_s = now()

    # ------------------------------------------------------------------ what is asked of it

    async def run(self) -> None:
        """Fly until the mission's time is over or it is stopped."""
        await self._muster()
        self._began_s = self._now()
        self.state = self._first
        async with asyncio.TaskGroup() as tasks:
            loops = [
                tasks.create_task(driver.run(self._flying), name=loop.value)
                for loop, driver in self._loops.items()
            ]
            if self._stand_in is not None:
                loops.append(tasks.create_task(self._stand_in.run(self._flying), name="relief"))
            try:
                await self._fly()
            finally:
                for task in loops:
                    task.cancel()
        self._end()

    def comment(self, text: str, author: str, comment_id: str) -> Json:
        """Take a comment for the next tick. Raises RequestRefused when too many stand."""
        waiting = sum(isinstance(item, Comment) for item in self._inbox)
        if len(self._core.snapshot.receipts) + waiting >= MAX_STANDING:
            raise RequestRefused(
                "too_many_comments", f"{MAX_STANDING} comments stand already; wait for answers."
            )
        comment = self._comment(text, author, comment_id)
        self._inbox.append(comment)
        return comment_object(CommentReceipt(comment))

    async def override(self, what: str, asked: Json, author: str) -> Json:
        """Do what a person steers in person. Raises RequestRefused."""
        return await self._overrides.do(what, asked, author)

    def hold(self, author: str) -> Json:
        """Let every robot hold from the next tick on."""
        self._inbox.append(HoldChange(HoldState.HELD, author))
        if self._standing is MissionState.RUNNING:
            self._become(MissionState.HELD)
        return {"state": self._standing.value}

    def resume(self, author: str) -> Json:
        """Go on after hold or pause."""
        self._inbox.append(HoldChange(HoldState.FLYING, author))
        if self._standing is MissionState.PAUSED:
            self._link.control_world(WorldAction.RESUME)
            self._herald.say(EventKind.HOLD, Severity.INFO, f"Mission time goes on ({author}).")
        if self.state is not MissionState.ENDED:
            self._become(MissionState.RUNNING)
        return {"state": self._standing.value}

    def pause(self, author: str) -> Json:
        """Let mission time stand still; a simulated world pauses too."""
        if self._standing in (MissionState.RUNNING, MissionState.HELD):
            self._become(MissionState.PAUSED)
            self._link.control_world(WorldAction.PAUSE)
            self._herald.say(
                EventKind.HOLD, Severity.WARNING, f"Mission time stands still ({author})."
            )
        return {"state": self._standing.value}

    @property
    def _standing(self) -> MissionState:
        """Where it stands, or, while robots are mustered, where it will."""
        return self._first if self.state is MissionState.CREATED else self.state

    @property
    def refused(self) -> int:
        """Messages of the bus that were refused, found no room or could not be said."""
        return self._link.refused + self._link.dropped + self._link.unsaid

    def tallies(self) -> dict[str, LoopTally]:
        """Return the models' accounts by loop."""
        return {loop.value: driver.tally for loop, driver in self._loops.items()}

    def checkpoint(self) -> Json:
        """Return what the mission would need to go on in another process."""
        return self._saver.checkpoint(self._link.truth())

    async def stop(self, author: str) -> Json:
        """End the mission and return its result."""
        if self._ending is None:
            self._ending = f"Mission stopped by {author}."
            self._changed.set()
        await self._over.wait()
        return {"result": self.result()}

    def result(self) -> Json:
        """Return the figures so far."""
        wall_s = self._now() - self._began_s
        figures = self._figures.result(self._core.snapshot, self.tallies(), wall_s)
        return self._council.result(figures)

    def _kept_figures(self) -> Json:
        return self._figures.kept(self.tallies(), self._now() - self._began_s)

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
        period_s = self._setup.live_tick_s
        start = self._setup.start
        base_s = 0.0 if start is None else start.time_s + period_s
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
        self._meter.record(ended_s, ended_s - began_s, success=solution.rung is Rung.CONVERGED)
        self._share_knowledge(core.snapshot)
        self._tell_snapshot(core.snapshot)

    def _take_waiting(self, time_s: float) -> None:
        """Give the core what people and models said since the last tick."""
        while self._script and self._script[0][0] <= time_s + 1e-9:
            self._comment_count += 1
            said = self._script.popleft()[1]
            self._inbox.append(self._comment(said, "operator", f"c{self._comment_count}"))
        while self._inbox:
            self._core.observe(self._inbox.popleft())
        self._council.settle_waiting()

    async def _wait_paused(self) -> None:
        """Keep the planner's sign of life up while mission time stands still."""
        while self.state is MissionState.PAUSED and self._ending is None:
            self._beat(self._core.snapshot)
            self._council.settle_waiting()
            self._changed.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(PAUSED_BEAT_S):
                    await self._changed.wait()

    def _beat(self, snapshot: Snapshot) -> None:
        state = _PLANNER_STATES[self.state]
        self._link.send_heartbeat(self._terms.mission, snapshot.tick, snapshot.time_s, state)

    def _share_knowledge(self, snapshot: Snapshot) -> None:
        """Tell robots what they need to fly on alone."""
        if chosen := self._turns.take(snapshot):
            self._link.send_knowledge(*map(Briefing(self._core.core).of, chosen))

    # ------------------------------------------------------------------ the loops

    def _make_loops(self, adviser: LanguageModel | ExactSolver | None) -> dict[Loop, AdviceLoop]:
        return advice_loops(
            adviser,
            self._setup.loops,
            self._terms.manner.timeout_s,
            self._advisors,
            self._council,
            self._herald,
            self._snapshot,
            self._now,
        )

    def _note_decision(self, card: Decision) -> None:
        if self._stand_in is not None:
            self._stand_in.note(card)

    def _snapshot(self) -> Snapshot:
        return self._core.snapshot

    # ------------------------------------------------------------------ telling

    def _tell_snapshot(self, snapshot: Snapshot) -> None:
        """Send the snapshot and its news to the web side, and let the loops look at it."""
        truth = self._link.truth()
        self._figures.add(snapshot, truth)
        self._recorder.truth(truth)
        self._herald.announce(snapshot)
        self._council.look(snapshot)
        if self._stand_in is not None:
            self._stand_in.look(snapshot.time_s)
        for notice in self._link.take_notices():
            self._herald.notice(notice)
        woken = self._advisors.look(snapshot)
        for loop, wanted in ((Loop.TASK, woken.task), (Loop.ACTION, woken.action)):
            if wanted and loop in self._loops:
                self._loops[loop].wake()
        self._saver.look(snapshot, truth)
        self._show(truth)

    def _recording_failed(self, words: str) -> None:
        self._herald.say(EventKind.ALARM, Severity.ALARM, words, {"component": "recording"})

    def _show(self, truth: Truth | None) -> None:
        now_s = self._now()
        reports = {"optimizer": self._meter.report(now_s)}
        reports |= loop_reports(self._loops, self._council, now_s)
        self._herald.show(self._core.snapshot, self.state, reports, self._figures.hits(), truth)

    def _become(self, state: MissionState) -> None:
        if self.state is MissionState.CREATED:
            self._first = state
            return
        self.state = state
        self._let_models_speak()
        self._changed.set()
        self._show(self._link.truth())

    def _end(self) -> None:
        self.state = MissionState.ENDED
        self._show(self._link.truth())
        words = self._ending or "The mission has ended."
        self._council.close()
        self._herald.say(EventKind.ENDED, Severity.INFO, words, {"result": self.result()})
        self._over.set()

    def _comment(self, text: str, author: str, comment_id: str) -> Comment:
        ttl_s = self._setup.loops.comment_ttl_s
        time_s = max(0.0, self._core.snapshot.time_s)
        return Comment(comment_id, text, time_s, ttl_s, author)
