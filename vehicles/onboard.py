"""What one robot does alone: its own filter, its own plan (paper, section III-D).

A robot in communication failure leaves the central problem and solves the same problem for
itself: the targets it was assigned, the zones it knows, communication zones at the risk it
accepts alone and without the team term, its mates' last known positions to keep clear of.
Sans-I/O: time comes in as an argument, on any one clock.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from solver import estimation
from solver.arrays import BoolArray, FloatArray, IntArray, frozen, frozen_bool
from solver.beliefs import Beliefs, is_covariance
from solver.exposure import zone_table
from solver.observations import Detections, OnboardTrack, TrackReport
from solver.plans import shifted
from solver.problem import Budget, Problem, Solution, ZoneTable
from solver.zones import Point, Zone, ZoneKind
from vehicles.inference import JammingMap
from vehicles.knowledge import FlightRules, Knowledge

BACK_OFF_M_S = 0.2
"""A robot alone keeps this much farther off communication zones every second it is cut off."""

BACK_OFF_MOST_M = 3.0


class ProblemSolver(Protocol):
    """Solves a problem whatever happens: `solver.planner.Planner`."""

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return a solution; never raise."""
        ...


class OnboardPilot:
    """One robot's own knowledge, filter and plan.

    Connected, it only listens (`learn`). `lost_link` hands the team's tracks over to its
    private filter; `plan` predicts it to the given moment, updates it with what was observed
    since the last plan, and solves the single-robot problem. `report` is what the robot brings
    when it returns; the next `learn` ends its being alone.
    """

    def __init__(self, robot_id: int, planner: ProblemSolver) -> None:
        self.robot_id = robot_id
        self._planner = planner
        self._knowledge: Knowledge | None = None
        self._revealed: dict[str, Zone] = {}
        self._jamming: JammingMap | None = None
        self._inferred: tuple[Zone, ...] = ()
        self._beliefs: Beliefs | None = None
        self._filter_s = 0.0
        self._observed: list[Detections] = []
        self._plan: FloatArray | None = None
        self._planned_s = 0.0
        self._lost_s = 0.0

    @property
    def alone(self) -> bool:
        """Whether the robot flies by its own filter and plan."""
        return self._beliefs is not None

    @property
    def targets(self) -> tuple[int, ...]:
        """Ids of the targets the robot was last assigned."""
        return () if self._knowledge is None else self._knowledge.targets

    @property
    def zones(self) -> tuple[Zone, ...]:
        """Every zone this robot knows, told, suffered or inferred.

        The newest word on an id counts.
        """
        told = () if self._knowledge is None else self._knowledge.zones
        return (*({zone.id: zone for zone in told} | self._revealed).values(), *self._inferred)

    def learn(self, knowledge: Knowledge) -> None:
        """Take what the planner tells; the robot is connected, its private filter ends.

        Raises:
            ValueError: The knowledge is meant for another robot.
        """
        if knowledge.robot_id != self.robot_id:
            raise ValueError(
                f"robot {self.robot_id} was told what robot {knowledge.robot_id} knows"
            )
        if self._knowledge is None or self._knowledge.mission != knowledge.mission:
            self._begin_map(knowledge.rules)
        self._knowledge = knowledge
        self._inferred = ()
        told = {zone.id for zone in knowledge.zones}
        self._revealed = {key: zone for key, zone in self._revealed.items() if key not in told}
        self._beliefs = None
        self._observed.clear()
        self._plan = None

    def reveal(self, zone: Zone) -> None:
        """Take a zone that an attack has revealed to this robot."""
        self._revealed[zone.id] = zone

    def note(self, now_s: float, position: Point, *, heard: bool) -> None:
        """Take where the robot is, and whether it is heard there or jammed.

        What has cut it off is inferred from this where zones do not reveal themselves. Time is on
        the clock of `lost_link`; a robot that is alone for want of a planner is neither.
        """
        if self._jamming is not None:
            self._jamming.note(now_s, position, heard=heard)

    def lost_link(self, now_s: float) -> None:
        """Start the private filter from the team's last tracks; harmless when alone already."""
        if self.alone or self._knowledge is None:
            return
        self._beliefs = _handed_over(self._knowledge)
        self._filter_s = min(self._knowledge.time_s, now_s)
        self._planned_s = now_s
        self._lost_s = now_s

    def observe(self, detections: Detections) -> None:
        """Take what the robot sees now; it counts at the next plan."""
        if self.alone:
            self._observed.append(detections)

    def plan(
        self, now_s: float, position: Point, velocity: Point, budget: Budget
    ) -> tuple[Point, Point]:
        """Return where to fly alone.

        A robot that has observed nothing since the last plan (not even an empty list) is blind:
        its plan does not count on measurements.

        Args:
            now_s: Time on the clock of `lost_link`.
            position: Where the robot is, metres.
            velocity: Its velocity, m/s.
            budget: For the solve.

        Returns:
            Velocity and way-point after one planning step. A robot that is not alone, or that
            was never told anything, is to stand still where it is.
        """
        if self._knowledge is None or self._beliefs is None:
            return (0.0, 0.0), position
        rules = self._knowledge.rules
        elapsed_s = now_s - self._filter_s
        if elapsed_s > 0.0:
            self._beliefs = estimation.predict(self._beliefs, rules.filter, elapsed_s)
            self._filter_s = now_s
        observed, self._observed = tuple(self._observed), []
        self._beliefs = estimation.update(self._beliefs, rules.filter, rules.sensor, observed)
        if self._jamming is not None:
            self._inferred = ()
            self._inferred = self._jamming.zones(self.zones)
        known = np.flatnonzero(self._beliefs.known)
        sees = np.full((1, len(known)), bool(observed))
        problem = self._problem(
            self._knowledge, _selected(self._beliefs, known), sees, (position, velocity)
        )
        previous = None
        if self._plan is not None:
            previous = frozen(shifted(self._plan, now_s - self._planned_s, rules.step_s)[None])
        solution = self._planner.solve(replace(problem, previous=previous), budget)
        self._plan, self._planned_s = solution.controls[0], now_s
        return _point(solution.velocities[0, 0]), _point(solution.positions[0, 0])

    @property
    def trace(self) -> float:
        """Trace of the private filter's position covariances, 0 for a robot not alone."""
        return 0.0 if self._beliefs is None else estimation.trace(self._beliefs)

    def report(self, now_s: float) -> TrackReport:
        """Return what the robot brings to the team at `now_s`: tracks, zones, silent places.

        The tracks are predicted to that moment, so that they can be fused with the team's. Zones
        are those that have struck it and of which the planner has not told it since: what it was
        told before may have been changed or erased meanwhile.
        """
        beliefs = self._beliefs
        if beliefs is not None and self._knowledge is not None and now_s > self._filter_s:
            beliefs = estimation.predict(
                beliefs, self._knowledge.rules.filter, now_s - self._filter_s
            )
        tracks: list[OnboardTrack] = []
        if beliefs is not None:
            for row in np.flatnonzero(beliefs.known):
                tracks.append(
                    OnboardTrack(
                        target_id=beliefs.ids[row],
                        mean=tuple(beliefs.means[row].tolist()),
                        covariance=tuple(tuple(r) for r in beliefs.covariances[row].tolist()),
                    )
                )
        silent = () if self._jamming is None else self._jamming.silent
        return TrackReport(self.robot_id, tuple(tracks), tuple(self._revealed.values()), silent)

    def _begin_map(self, rules: FlightRules) -> None:
        """Begin the map of a mission's jamming, where its rules ask for one."""
        asked = rules.inference
        self._jamming = (
            None if asked is None else JammingMap(asked, rules.field_lower, rules.field_upper)
        )

    def _back_off_m(self) -> float:
        """Return the margin to communication zones after this long without a link.

        How far jamming reaches is not known on board, only that it still lasts: a robot that
        stays at the rim of its constraint may stay cut off for ever, so it backs off until it
        is heard again.
        """
        return min(BACK_OFF_M_S * (self._filter_s - self._lost_s), BACK_OFF_MOST_M)

    def _problem(
        self,
        knowledge: Knowledge,
        beliefs: Beliefs,
        sees: BoolArray,
        state: tuple[Point, Point],
    ) -> Problem:
        """Return the single-robot problem over the targets known to the private filter."""
        rules = knowledge.rules
        means, priors, growth = estimation.forecast(
            beliefs, rules.filter, rules.step_s, rules.horizon
        )
        zones = self.zones
        severities = dict(knowledge.severities)
        return Problem(
            robot_ids=(self.robot_id,),
            step_s=rules.step_s,
            horizon=rules.horizon,
            dynamics=rules.dynamics,
            positions=frozen([state[0]]),
            velocities=frozen([state[1]]),
            control_lower=frozen([rules.control_lower]),
            control_upper=frozen([rules.control_upper]),
            speed_limit=frozen([rules.speed_limit_m_s]),
            field_lower=frozen(rules.field_lower),
            field_upper=frozen(rules.field_upper),
            sees=frozen_bool(sees),
            target_means=frozen(means),
            target_priors=frozen(priors),
            target_growth=frozen(growth),
            sensor=rules.sensor,
            sensing=_sensing_table(zones, severities, knowledge.prices.sensing),
            communication=_communication_table(
                zones, severities, knowledge.prices.communication, self._back_off_m()
            ),
            weights=knowledge.weights,
            separation_weight=rules.separation_weight,
            min_dist_m=rules.min_dist_m,
            obstacles=frozen(np.reshape([mate.position for mate in knowledge.mates], (-1, 2))),
            previous=None,
            replan=frozen_bool([False]),
        )


def _handed_over(knowledge: Knowledge) -> Beliefs:
    """Return the private filter's start: the team's tracks of the robot's own targets.

    A track whose shape is not the filter's, or that is no Gaussian, counts as unknown.
    """
    settings = knowledge.rules.filter
    beliefs = estimation.start(knowledge.targets, settings)
    means, covariances = beliefs.means.copy(), beliefs.covariances.copy()
    known = beliefs.known.copy()
    d = settings.dimension
    for track in knowledge.tracks:
        if track.target_id not in beliefs.ids or len(track.mean) != d:
            continue
        covariance = np.asarray(track.covariance, dtype=np.float64)
        sound = covariance.shape == (d, d) and is_covariance(covariance)
        if not (sound and np.isfinite(track.mean).all()):
            continue
        row = beliefs.ids.index(track.target_id)
        means[row], covariances[row], known[row] = track.mean, covariance, True
    return replace(beliefs, means=means, covariances=covariances, known=known, started=known)


def _selected(beliefs: Beliefs, rows: IntArray) -> Beliefs:
    return Beliefs(
        ids=tuple(beliefs.ids[row] for row in rows),
        means=beliefs.means[rows],
        covariances=beliefs.covariances[rows],
        known=beliefs.known[rows],
        unseen_s=beliefs.unseen_s[rows],
        rejected=beliefs.rejected[rows],
        started=beliefs.started[rows],
    )


def _sensing_table(
    zones: tuple[Zone, ...], severities: dict[str, float], price: float
) -> ZoneTable:
    chosen = [zone for zone in zones if zone.kind is ZoneKind.SENSING]
    severity = [severities.get(zone.id, 1.0) for zone in chosen]
    quantiles = [zone.quantile(s) for zone, s in zip(chosen, severity, strict=True)]
    margins = [zone.margin for zone in chosen]
    return zone_table(chosen, _all_known(chosen), quantiles, margins, severity, price)


def _communication_table(
    zones: tuple[Zone, ...], severities: dict[str, float], price: float, back_off_m: float
) -> ZoneTable:
    """Communication zones as a robot alone fears them: its own risk, no term of the team.

    The margin of a communication zone is a factor on the spread of a team, which one robot
    has not; so backing off is told in deviations of the zone.
    """
    chosen = [zone for zone in zones if zone.kind is ZoneKind.COMMUNICATION]
    severity = [severities.get(zone.id, 1.0) for zone in chosen]
    quantiles = [
        zone.quantile_single(s) + back_off_m / float(np.sqrt(0.5 * np.trace(zone.covariance)))
        for zone, s in zip(chosen, severity, strict=True)
    ]
    margins = [0.0] * len(chosen)
    return zone_table(chosen, _all_known(chosen), quantiles, margins, severity, price)


def _all_known(zones: list[Zone]) -> BoolArray:
    return np.ones((1, len(zones)), dtype=np.bool_)


def _point(row: FloatArray) -> Point:
    return (float(row[0]), float(row[1]))
