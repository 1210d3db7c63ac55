"""What the planner tells each robot, so that it can fly on when it is cut off."""

from itertools import islice

import numpy as np

from server.mission.core import MissionCore
from server.mission.hazards import attack_law
from server.mission.setup import MissionSetup, RobotSetup
from solver.observations import Link, OnboardTrack
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles.inference import InferenceRules
from vehicles.knowledge import FlightRules, Knowledge, Mate

KNOWLEDGE_TICKS = 10
"""Each robot is told what it should know every so many ticks, and on changes."""

MOST_IN_A_TICK = 64
"""Robots told in one tick; the others of a larger team wait for the next ones."""


class Turns:
    """Who is to be told what it should know: all on a change, else each in turn."""

    def __init__(self, robot_ids: tuple[int, ...]) -> None:
        self._ids = robot_ids
        self._due: dict[int, None] = {}
        self._relevant: object = None

    def take(self, snapshot: Snapshot) -> tuple[int, ...]:
        """Return whose turn it is at a tick. Who has waited longest comes first."""
        relevant = (snapshot.directives, len(snapshot.zones), snapshot.robots.links)
        changed, self._relevant = relevant != self._relevant, relevant
        first = snapshot.tick % KNOWLEDGE_TICKS
        self._due |= dict.fromkeys(self._ids if changed else self._ids[first::KNOWLEDGE_TICKS])
        chosen = tuple(islice(self._due, MOST_IN_A_TICK))
        for robot_id in chosen:
            del self._due[robot_id]
        return chosen


def flight_rules(setup: MissionSetup, robot: RobotSetup) -> FlightRules:
    """Return what holds for one robot through the whole mission."""
    return FlightRules(
        step_s=setup.planner.plan_step_s,
        horizon=setup.planner.horizon,
        dynamics=setup.dynamics,
        control_lower=robot.control_lower,
        control_upper=robot.control_upper,
        speed_limit_m_s=robot.speed_limit_m_s,
        field_lower=setup.field_lower,
        field_upper=setup.field_upper,
        min_dist_m=setup.planner.min_dist_m,
        separation_weight=setup.planner.separation_weight,
        sensor=setup.sensor,
        filter=setup.filter,
        inference=_inference_rules(setup),
    )


def _inference_rules(setup: MissionSetup) -> InferenceRules | None:
    """Return how robots infer by themselves what cuts them off, as the team does."""
    if setup.hazards is None:
        return None
    defaults = setup.zone_defaults(ZoneKind.COMMUNICATION)
    return InferenceRules(
        law=attack_law(setup, setup.hazards),
        memory_s=setup.hazards.memory_s,
        confidence=setup.hazards.confidence,
        risk=defaults.risk,
        risk_single=defaults.risk_single,
    )


class Briefing:
    """What robots should know as of a core's newest snapshot.

    What all of them are told is made once, so that a round over the team costs no more than
    its messages.
    """

    def __init__(self, core: MissionCore) -> None:
        snapshot, beliefs = core.snapshot, core.beliefs
        self._snapshot, self._beliefs = snapshot, beliefs
        self._setup, self._prices = core.setup, core.prices
        self._rows = {robot_id: row for row, robot_id in enumerate(snapshot.robots.ids)}
        self._tracks = {target_id: row for row, target_id in enumerate(beliefs.ids)}
        self._targets = snapshot.directives.rows()
        table = snapshot.robots
        self._mates = tuple(
            Mate(mate_id, (float(position[0]), float(position[1])))
            for mate_id, position, link in zip(table.ids, table.positions, table.links, strict=True)
            if link is not Link.LOST
        )
        self._places = {mate.robot_id: place for place, mate in enumerate(self._mates)}

    def of(self, robot_id: int) -> Knowledge:
        """Return what one robot should know. Raises KeyError for an unknown robot."""
        snapshot, beliefs = self._snapshot, self._beliefs
        row, place = self._rows[robot_id], self._places.get(robot_id, len(self._mates))
        targets = self._targets.get(robot_id, ())
        known = [(i, self._tracks[i]) for i in targets if i in self._tracks]
        return Knowledge(
            robot_id=robot_id,
            mission=snapshot.mission,
            time_s=snapshot.time_s,
            rules=flight_rules(self._setup, self._setup.robots[row]),
            weights=snapshot.directives.weights,
            targets=targets,
            tracks=tuple(
                OnboardTrack(
                    target_id=target_id,
                    mean=tuple(beliefs.means[track].tolist()),
                    covariance=tuple(tuple(r) for r in beliefs.covariances[track].tolist()),
                )
                for target_id, track in known
                if beliefs.known[track]
            ),
            zones=tuple(snapshot.zones[z] for z in np.flatnonzero(snapshot.known[row])),
            severities=snapshot.directives.severities,
            mates=self._mates[:place] + self._mates[place + 1 :],
            prices=self._prices,
        )
