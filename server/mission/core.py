"""The mission core: observations and proposals in, one problem a tick out, setpoints back.

Sans-I/O and deterministic: no clock, no thread, no randomness of its own. Whoever drives
it (asyncio in real time, lockstep in virtual time, a replay) gives it the time and solves
the problem; the same inputs in the same order give the same outputs, bit for bit.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from llm.verification import Limits, verify
from server.mission.changes import (
    applied,
    assignment_proposal,
    declined,
    without_expired,
    without_zone,
)
from server.mission.checkpoint import Checkpoint, KnownZone, kept_tracks, with_tracks
from server.mission.comments import CommentLedger
from server.mission.exposure import PriceList
from server.mission.guidance import GuidanceLadder
from server.mission.hazards import HazardBook
from server.mission.knowledge import ZoneKnowledge
from server.mission.plans import PlanBook
from server.mission.setup import MissionSetup
from server.mission.team import Lanes, TeamBook
from server.mission.tracks import track_table
from solver import estimation
from solver.arrays import frozen, frozen_bool
from solver.assignment import repair
from solver.beliefs import Beliefs
from solver.directives import Directives, Pairing, Proposal, Source, Verdict
from solver.exposure import Prices
from solver.observations import (
    Attack,
    Comment,
    Detections,
    HoldChange,
    HoldState,
    Link,
    LinkChange,
    Observation,
    RobotState,
    TargetPrior,
    TrackReport,
    ZoneDrawn,
    ZoneErased,
)
from solver.problem import Problem, Solution
from solver.setpoints import Setpoint
from solver.snapshot import Snapshot, SolveSummary


class MissionCore:
    """Owner of everything the team knows. One tick: `begin`, solve elsewhere, `commit`."""

    def __init__(self, setup: MissionSetup) -> None:
        self.setup = setup
        self._limits = Limits(
            weights_lower=setup.weight_lower,
            weights_upper=setup.weight_upper,
            severity_lower=setup.severity_bounds[0],
            severity_upper=setup.severity_bounds[1],
        )
        self._team = TeamBook(setup)
        self._zones = ZoneKnowledge(setup.robot_ids)
        self._hazards = HazardBook(setup)
        self._price_list = PriceList(setup)
        self._comments = CommentLedger()
        self._guidance = GuidanceLadder(setup.loops.task_period_s)
        self._plans = PlanBook(setup)
        self._directives = setup.initial_directives()
        self._beliefs = estimation.start(setup.target_ids, setup.filter)
        for target in setup.targets:
            if target.prior is not None:
                self._take_prior(target.prior)
        self._hold = HoldState.FLYING
        self._shaken = False
        self._strayed: set[int] = set()
        self._inbox: list[Observation] = []
        self._attacks: list[Attack] = []
        self._replan: set[int] = set()
        self._lanes = self._team.lanes()
        self._assigned: tuple[Lanes, frozenset[Pairing], np.ndarray] | None = None
        self._time_s = -setup.tick_s
        self._elapsed_s = setup.tick_s
        self._tick = -1
        if setup.start is not None:
            self._go_on(setup.start)
        self.snapshot = self._picture(None)

    @property
    def beliefs(self) -> Beliefs:
        """The team's full filter state, for robots that may have to go on alone."""
        return self._beliefs

    @property
    def directives(self) -> Directives:
        """What is in force now; the snapshot shows what was in force at its tick."""
        return self._directives

    @property
    def elapsed_s(self) -> float:
        """Time from one measurement to the next, as of the last tick."""
        return self._elapsed_s

    @property
    def prices(self) -> Prices:
        """What exposure to zones costs under the directives in force."""
        return self._price_list.of(self._directives.assignment)

    @property
    def limits(self) -> Limits:
        """What proposals are verified against."""
        return self._limits

    def checkpoint(self) -> Checkpoint:
        """Return what a later core needs to go on from here (`MissionSetup.start`)."""
        return Checkpoint(
            time_s=self._time_s,
            directives=self._directives,
            zones=tuple(KnownZone(z, self._zones.holders(z.id)) for z in self._zones.zones),
            standing=self._comments.standing(),
            closed=self._comments.closed(),
            tracks=kept_tracks(self._beliefs),
            answered_s=self._guidance.answered_s,
            hazards=self._hazards.kept(),
        )

    def observe(self, observation: Observation) -> None:
        """Take a fact. It counts from the next `begin` on, in the order of arrival."""
        self._inbox.append(observation)

    @property
    def current(self) -> Snapshot:
        """The newest snapshot with the directives in force now."""
        return replace(self.snapshot, directives=self._directives)

    def outlook(self, proposal: Proposal) -> Directives:
        """Return what would be in force if a proposal were adopted now. Nothing changes."""
        return applied(self._directives, proposal, self._time_s, self._comments.standing())

    def propose(self, proposal: Proposal, refusal: tuple[str, ...] = ()) -> Verdict:
        """Verify a proposal against the newest snapshot and, if it holds, put it in force.

        A refused proposal leaves the directives untouched (paper, section III-C: the
        previous assignment is kept). The change shows in the next problem.

        Args:
            proposal: What is asked for.
            refusal: Why somebody else (the gate, a person) does not want it, empty where
                nobody objects. Then comments it claims to have applied are declined.
        """
        verdict = verify(proposal, self.current, self._limits)
        if verdict.accepted and refusal:
            verdict = Verdict(proposal.id, refusal)
            self._comments.answer(declined(proposal, refusal[0]))
        elif verdict.accepted:
            self._directives = applied(
                self._directives, proposal, self._time_s, self._comments.standing()
            )
            self._replan.update(proposal.replan)
            self._comments.answer(proposal)
        self._guidance.note(proposal, verdict, self._time_s)
        return verdict

    def begin(self, now_s: float) -> Problem:
        """Advance the estimates to `now_s` with all that arrived; return what to solve.

        Raises ValueError when time does not advance.
        """
        elapsed_s = now_s - self._time_s
        if not elapsed_s > 0.0:
            raise ValueError(f"time must advance: {now_s} s after {self._time_s} s")
        self._time_s, self._elapsed_s = now_s, elapsed_s
        self._tick += 1
        self._attacks.clear()
        self._beliefs = estimation.predict(self._beliefs, self.setup.filter, elapsed_s)
        arrived, self._inbox = self._inbox, []
        self._fold(arrived)
        for zone_id in self._hazards.infer(self._team, self._zones, now_s, elapsed_s):
            self._directives = without_zone(self._directives, zone_id)
        self._comments.expire(now_s)
        self._directives = without_expired(self._directives, now_s)
        self._lanes = self._team.lanes()
        if self._shaken:
            self._mend()
        return self.problem_under(self._directives)

    def commit(self, solution: Solution) -> tuple[Setpoint, ...]:
        """Take the tick's solution; return one setpoint per connected robot, in team order.

        While held, every robot stands still where it began to hold. Altitudes are those set, not
        those reported: sent to where it says it is, a robot keeps every error and leaves its layer.
        """
        rows, robots = self._lanes.rows, self.setup.robots
        velocities, places = solution.velocities[:, 0], solution.positions[:, 0]
        if self._hold is HoldState.HELD:
            velocities, places = np.zeros_like(velocities), self._team.hold_places(rows)
        else:
            self._plans.keep(solution)
        setpoints = tuple(
            Setpoint(
                robot_id=robots[row].id,
                velocity=(u, v),
                waypoint=(x, y),
                altitude_m=robots[row].altitude_m,
                ttl_s=self.setup.setpoint_ttl_s,
            )
            for row, (u, v), (x, y) in zip(rows, velocities.tolist(), places.tolist(), strict=True)
        )
        self._team.command(setpoints)
        self._replan.clear()
        self.snapshot = self._picture(
            SolveSummary(
                rung=solution.rung,
                objective=solution.objective,
                iterations=solution.iterations,
                solve_s=solution.solve_s,
            )
        )
        return setpoints

    def _go_on(self, start: Checkpoint) -> None:
        """Take over where another core was broken off; robots hold until somebody resumes."""
        self._time_s = start.time_s
        self._hold = HoldState.HELD
        self._directives = start.directives
        for known in start.zones:
            self._zones.restore(known.zone, known.holders)
        self._hazards.restore(start.hazards, start.time_s)
        self._comments.restore(start.standing, start.closed)
        self._guidance.answered_s = start.answered_s
        beliefs = with_tracks(self._beliefs, start.tracks)
        self._beliefs = estimation.predict(beliefs, self.setup.filter, start.away_s)

    def _fold(self, arrived: Iterable[Observation]) -> None:
        """Apply what arrived, in order; detections together in one update at the end."""
        detections: list[Detections] = []
        for observation in arrived:
            match observation:
                case RobotState():
                    self._team.report(observation, self._time_s)
                case Detections():
                    detections.append(observation)
                case LinkChange():
                    self._relink(observation)
                case Attack():
                    self._take_attack(observation)
                case TrackReport():
                    self._welcome(observation)
                case Comment():
                    self._comments.receive(observation)
                case ZoneDrawn():
                    self._hazards.release(observation.zone.id)
                    self._zones.learn(observation.zone, self._team.links())
                case ZoneErased():
                    self._hazards.release(observation.zone_id)
                    self._zones.forget(observation.zone_id)
                    self._directives = without_zone(self._directives, observation.zone_id)
                case TargetPrior():
                    self._take_prior(observation)
                case HoldChange():
                    self._hold = observation.state
                    self._team.let_go()
                    self._plans.clear()
        heard = tuple(d for d in detections if self._team.link_of(d.robot_id) is Link.CONNECTED)
        self._beliefs = estimation.update(
            self._beliefs, self.setup.filter, self.setup.sensor, heard
        )

    def _mend(self) -> None:
        """Cover the targets of a lost robot at once, with the fewest changes."""
        self._shaken = False
        self.snapshot = self._picture(None)
        mended = repair(self.snapshot)
        if mended != self._directives.assignment:
            name = f"repair-{self._tick}"
            self.propose(assignment_proposal(name, Source.REPAIR, self.snapshot, mended))

    def _relink(self, change: LinkChange) -> None:
        before = self._team.relink(change.robot_id, change.link)
        if before is None or before is change.link:
            return
        self._hazards.relinked(change, before)
        if change.link is Link.LOST:
            self._strayed.add(change.robot_id)
        self._shaken |= Link.LOST in (before, change.link)
        if change.link is Link.CONNECTED:
            # Between lost and heard again it may seem jammed: its token comes before its state.
            self._shaken |= change.robot_id in self._strayed
            self._strayed.discard(change.robot_id)
            self._zones.share(self._team.links())
        else:
            self._plans.forget(change.robot_id)

    def _take_attack(self, attack: Attack) -> None:
        if self._team.row(attack.robot_id) is None:
            return
        self._attacks.append(attack)
        if attack.zone is None:
            self._hazards.struck(attack, self._time_s)
        else:
            self._zones.learn(attack.zone, self._team.links())

    def _welcome(self, report: TrackReport) -> None:
        """Fuse what a returned robot brings (covariance intersection: no double counting)."""
        if self._team.row(report.robot_id) is None:
            return
        self._beliefs = estimation.fuse(self._beliefs, report.tracks)
        self._hazards.unheard(report.silent)
        for zone in report.zones:
            # What was inferred when a robot was cut off is older than what is inferred now.
            if not self._hazards.owns(zone.id):
                self._zones.learn(zone, self._team.links())

    def _take_prior(self, prior: TargetPrior) -> None:
        if prior.target_id not in self._beliefs.ids:
            return
        self._beliefs = estimation.with_prior(
            self._beliefs, prior.target_id, prior.mean, prior.covariance
        )

    def problem_under(self, directives: Directives) -> Problem:
        """Return the optimizer's problem as of the last `begin` under any directives."""
        setup, lanes = self.setup, self._lanes
        planner, rows = setup.planner, lanes.rows
        means, priors, growth = estimation.forecast(
            self._beliefs, setup.filter, planner.plan_step_s, planner.horizon
        )
        columns = np.flatnonzero(self._beliefs.known)
        sensing, communication = self._zones.tables(
            rows, directives.severities, self._price_list.of(directives.assignment)
        )
        return Problem(
            robot_ids=lanes.ids,
            step_s=planner.plan_step_s,
            horizon=planner.horizon,
            dynamics=setup.dynamics,
            positions=self._team.positions_of(rows),
            velocities=self._team.velocities_of(rows),
            control_lower=lanes.control_lower,
            control_upper=lanes.control_upper,
            speed_limit=lanes.speed_limit,
            field_lower=frozen(setup.field_lower),
            field_upper=frozen(setup.field_upper),
            sees=frozen_bool(self._sees(lanes, directives.assignment)[:, columns]),
            target_means=frozen(means[:, columns]),
            target_priors=frozen(priors[columns]),
            target_growth=frozen(growth[:, columns]),
            sensor=setup.sensor,
            sensing=sensing,
            communication=communication,
            weights=directives.weights,
            separation_weight=planner.separation_weight,
            min_dist_m=planner.min_dist_m,
            obstacles=self._team.ghosts(self._time_s),
            previous=self._plans.shifted(self._lanes.ids, self._elapsed_s),
            replan=frozen_bool([robot_id in self._replan for robot_id in lanes.ids]),
        )

    def _sees(self, lanes: Lanes, assignment: frozenset[Pairing]) -> np.ndarray:
        """Return A (M, N) of the planned robots without those in sensing failure."""
        if self._assigned is None or self._assigned[:2] != (lanes, assignment):
            columns = {target_id: j for j, target_id in enumerate(self.setup.target_ids)}
            lane_of = {robot_id: i for i, robot_id in enumerate(lanes.ids)}
            A = np.zeros((len(lane_of), len(columns)), dtype=bool)
            for robot_id, target_id in assignment:
                if robot_id in lane_of and target_id in columns:
                    A[lane_of[robot_id], columns[target_id]] = True
            self._assigned = lanes, assignment, A
        sees = self._assigned[2].copy()
        sees[self._team.sensing_failed()[list(lanes.rows)]] = False
        return sees

    def _picture(self, solve: SolveSummary | None) -> Snapshot:
        level, age_s = self._guidance.level(self._directives, self._hold, self._time_s)
        return Snapshot(
            mission=self.setup.name,
            tick=self._tick,
            time_s=self._time_s,
            robots=self._team.table(self._time_s),
            tracks=track_table(self._beliefs),
            zones=self._zones.zones,
            known=self._zones.known(),
            directives=self._directives,
            hold=self._hold,
            trace=estimation.trace(self._beliefs),
            solve=solve,
            attacks=tuple(self._attacks),
            receipts=self._comments.standing(),
            guidance=level,
            guidance_age_s=age_s,
            closed=self._comments.closed(),
            inferred=self._hazards.zones,
        )
