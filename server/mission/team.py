"""The robots as they last reported, and how they are reached."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from server.mission.setup import MissionSetup
from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool
from solver.observations import Link, RobotState
from solver.setpoints import Setpoint
from solver.snapshot import RobotTable

GHOST_S = 5.0
"""A robot out of reach is kept clear of for this long where it was last seen."""

HOLD_REACH_M = 1.0
"""Farther than this from where it began to hold, a robot still brakes or was moved by others."""


@dataclass(frozen=True, slots=True, eq=False)
class Lanes:
    """Which rows of the team the planner flies now."""

    rows: tuple[int, ...]
    ids: tuple[int, ...]
    control_lower: FloatArray
    """(len(rows), 2), as in `MissionSetup.robots`."""

    control_upper: FloatArray
    speed_limit: FloatArray
    """(len(rows),) m/s."""


class TeamBook:
    """Owner of the robots' last known states, links and commands."""

    def __init__(self, setup: MissionSetup) -> None:
        self._setup = setup
        robots = setup.robots
        self.ids = tuple(robot.id for robot in robots)
        self._rows = {robot_id: row for row, robot_id in enumerate(self.ids)}
        count = len(robots)
        self._positions = np.array([r.position for r in robots], dtype=float).reshape(count, 2)
        self._velocities = np.zeros((count, 2))
        self._altitudes = np.array([r.altitude_m for r in robots], dtype=float)
        self._sensing_failed = np.zeros(count, dtype=bool)
        self._links = [Link.CONNECTED] * count
        self._heard_s: list[float | None] = [None] * count
        self._setpoints = np.zeros((count, 2))
        self._waypoints = self._positions.copy()
        self._holds = np.full((count, 2), np.nan)
        self._lanes: Lanes | None = None

    def row(self, robot_id: int) -> int | None:
        """Return a robot's row, None for an unknown id."""
        return self._rows.get(robot_id)

    def report(self, state: RobotState, now_s: float) -> None:
        """Take a robot's own report; an unknown id or a number that is not one changes nothing."""
        row = self._rows.get(state.robot_id)
        numbers = (*state.position, *state.velocity, state.altitude_m)
        if row is None or not all(map(math.isfinite, numbers)):
            return
        self._positions[row] = state.position
        self._velocities[row] = state.velocity
        self._altitudes[row] = state.altitude_m
        self._sensing_failed[row] = state.sensing_failed
        self._heard_s[row] = now_s

    def relink(self, robot_id: int, link: Link) -> Link | None:
        """Set a robot's link; return the one before, None for an unknown id."""
        row = self._rows.get(robot_id)
        if row is None:
            return None
        before = self._links[row]
        self._links[row] = link
        self._lanes = None
        return before

    def link_of(self, robot_id: int) -> Link | None:
        """Return how a robot is reached, None for an unknown id."""
        row = self._rows.get(robot_id)
        return None if row is None else self._links[row]

    def links(self) -> dict[int, Link]:
        """Return every robot's link by id."""
        return dict(zip(self.ids, self._links, strict=True))

    def lanes(self) -> Lanes:
        """Return the connected robots, in team order; the same object until a link changes."""
        if self._lanes is None:
            rows = tuple(i for i, link in enumerate(self._links) if link is Link.CONNECTED)
            robots = [self._setup.robots[row] for row in rows]
            self._lanes = Lanes(
                rows,
                tuple(self.ids[row] for row in rows),
                frozen(np.reshape([r.control_lower for r in robots], (-1, 2))),
                frozen(np.reshape([r.control_upper for r in robots], (-1, 2))),
                frozen([r.speed_limit_m_s for r in robots]),
            )
        return self._lanes

    def positions_of(self, rows: tuple[int, ...]) -> FloatArray:
        """Return positions (len(rows), 2)."""
        return frozen(self._positions[list(rows)].reshape(-1, 2))

    def velocities_of(self, rows: tuple[int, ...]) -> FloatArray:
        """Return velocities (len(rows), 2)."""
        return frozen(self._velocities[list(rows)].reshape(-1, 2))

    def rows_of(self, robot_ids: Iterable[int]) -> tuple[int, ...]:
        """Return the rows of robots. Raises KeyError for an unknown id."""
        return tuple(self._rows[robot_id] for robot_id in robot_ids)

    def heard_at(self, robot_id: int, now_s: float) -> bool:
        """Return whether a robot in reach has reported in the tick of that time."""
        row = self._rows[robot_id]
        return self._links[row] is Link.CONNECTED and self._heard_s[row] == now_s

    def is_blind(self, robot_id: int) -> bool:
        """Return whether a robot has last reported a sensing failure."""
        return bool(self._sensing_failed[self._rows[robot_id]])

    def commanded(self, rows: tuple[int, ...]) -> FloatArray:
        """Return the last commanded velocities (len(rows), 2)."""
        return frozen(self._setpoints[list(rows)].reshape(-1, 2))

    def sensing_failed(self) -> BoolArray:
        """Return the mask (M,)."""
        return frozen_bool(self._sensing_failed)

    def hold_places(self, rows: tuple[int, ...]) -> FloatArray:
        """Return where robots are to hold, (len(rows), 2) metres: where they began to.

        One place, not the newest report: sent to where it says it is, a robot would drift with
        the wind. Who is farther off than `HOLD_REACH_M` begins anew where it is.
        """
        chosen = list(rows)
        here, there = self._positions[chosen], self._holds[chosen]
        near = np.linalg.norm(here - there, axis=1) <= HOLD_REACH_M
        self._holds[chosen] = np.where(near[:, None], there, here)
        return frozen(self._holds[chosen].reshape(-1, 2))

    def let_go(self) -> None:
        """Forget where robots began to hold."""
        self._holds[:] = np.nan

    def ghosts(self, now_s: float, fresh_s: float = GHOST_S) -> FloatArray:
        """Return where robots that are not flown here were last seen, if lately, (K, 2)."""
        rows = [
            row
            for row, link in enumerate(self._links)
            if link is not Link.CONNECTED
            and self._heard_s[row] is not None
            and now_s - (self._heard_s[row] or 0.0) <= fresh_s
        ]
        return frozen(self._positions[rows].reshape(-1, 2))

    def command(self, setpoints: tuple[Setpoint, ...]) -> None:
        """Keep what was commanded; robots without a setpoint show none."""
        self._setpoints[:] = 0.0
        for setpoint in setpoints:
            row = self._rows[setpoint.robot_id]
            self._setpoints[row] = setpoint.velocity
            self._waypoints[row] = setpoint.waypoint

    def table(self, now_s: float) -> RobotTable:
        """Return the immutable picture of the team."""
        ages = [np.inf if heard is None else now_s - heard for heard in self._heard_s]
        return RobotTable(
            ids=self.ids,
            positions=frozen(self._positions),
            velocities=frozen(self._velocities),
            altitudes=frozen(self._altitudes),
            sensing_failed=frozen_bool(self._sensing_failed),
            links=tuple(self._links),
            state_age_s=frozen(ages),
            setpoint_velocities=frozen(self._setpoints),
            waypoints=frozen(self._waypoints),
        )
