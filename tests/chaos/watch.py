"""What must hold whatever is broken, looked at all the time on the bus by one who takes no part.

Clocks: setpoints and states carry the monotonic clock of their sender, which on one machine is
everybody's. So what was sent after a planner's death, or said by a vehicle a second after it, is
known exactly, however late it is heard here.
"""

import asyncio
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations
from time import monotonic

from server.scenarios.schema import Scenario
from tests.patience import HOLD_S, busy
from vehicles import messages as wire
from vehicles.inbox import Inbox, Sample
from vehicles.keys import TeamKeys, Topic

STAMP_S = 0.05
"""Threads of a process stop one after the other."""

CLOSE_TO = 1e-6
ROUNDED_M_S = 1e-3
"""MAVLink carries single precision."""

HEARD_S = 1.0
"""A robot that has said nothing for longer is not connected."""

SETPOINT_LIFE_S = 0.5
PART_S = 10.0
"""Two robots that come into each other's reach too close are apart after so much common flight."""


class Invariant(StrEnum):
    """What must hold."""

    LIMITS = "no setpoint outside limits"
    DEAD = "none from a dead planner"
    HOLD = "hold within 1 s"
    SEPARATION = "separation between connected robots"
    BOUNDS = "no directive outside bounds"
    COMMENTS = "no acknowledged comment lost"
    CHAIN = "journal chain intact"
    REPORTED = "every fault reported"


@dataclass(frozen=True)
class Violation:
    """An invariant that did not hold."""

    invariant: Invariant
    at_s: float
    text: str


@dataclass
class Findings:
    """Every violation, each cause once."""

    violations: list[Violation] = field(default_factory=list)
    checks: Counter[Invariant] = field(default_factory=Counter)
    """How often each was looked at."""

    _seen: set[tuple[Invariant, str]] = field(default_factory=set)

    def looked(self, invariant: Invariant, times: int = 1) -> None:
        """Count looks at an invariant."""
        self.checks[invariant] += times

    def broken(self, invariant: Invariant, cause: str, text: str) -> None:
        """Take note of a violation, once for each cause."""
        if (invariant, cause) not in self._seen:
            self._seen.add((invariant, cause))
            self.violations.append(Violation(invariant, monotonic(), text))

    def of(self, invariant: Invariant) -> list[Violation]:
        """Return the violations of one invariant."""
        return [one for one in self.violations if one.invariant is invariant]

    def forget(self) -> None:
        """Begin anew."""
        self.violations.clear()
        self._seen.clear()


@dataclass
class Silence:
    """A planner that cannot be heard, and by whom."""

    since_s: float
    robots: frozenset[int]
    dead: bool
    """Whether it is dead, rather than out of reach."""


class Watch:
    """Listens to everything on the bus and judges it.

    Args:
        scenario: What is flown.
        findings: Where violations go.
        piloted: Robots that an autopilot flies.
    """

    def __init__(self, scenario: Scenario, findings: Findings, piloted: Iterable[int]) -> None:
        self.findings = findings
        self._piloted = frozenset(piloted)
        self.keys = TeamKeys(scenario.team)
        self.inbox = Inbox(self.keys.delivery)
        self.states: dict[int, wire.State] = {}
        self.truth: wire.Truth | None = None
        self.jammed_s: dict[int, float] = {}
        """When the world last jammed a robot, by the world's clock."""

        self.notices: list[tuple[float, int, wire.NoticePart]] = []
        self.modes: list[tuple[float, int, wire.ModePart]] = []
        self.setpoints = 0
        self.nearest_m = math.inf
        self.held_s: list[float] = []
        """From each silence to the last word of a robot still flying, by its own clock."""

        self.known_boots: set[str] = set()
        """Senders of garbage that somebody throws on purpose: not the planner's setpoints."""

        self.away: set[int] = set()
        """Robots that are broken on purpose now."""

        self._robots = {robot.id: robot for robot in scenario.robots}
        self._field = (scenario.field.lower, scenario.field.upper)
        reach_m = SETPOINT_LIFE_S * max(math.hypot(*r.control_upper) for r in scenario.robots)
        self.least_m = scenario.planner.min_dist_m - 2.0 * reach_m
        """Setpoints keep the least distance; two robots may fly them on until they expire."""

        self._silence: Silence | None = None
        self._connected: frozenset[int] = frozenset()
        self._joining: dict[tuple[int, int], float] = {}
        """Pairs that were too close when they came into each other's reach, and for how long both
        have flown since, seconds."""

    async def listen(self) -> None:
        """Listen for ever."""
        while True:
            for sample in self.inbox.drain():
                with suppress(wire.MessageError):
                    self._take(sample)
            await asyncio.sleep(0.005)

    # ------------------------------------------------------------------ what the faults say

    @contextmanager
    def silence(self, robots: Iterable[int], since_s: float, *, dead: bool) -> Iterator[None]:
        """Expect robots to hold, and with a dead planner no setpoint, until the block ends."""
        self._silence = Silence(since_s, frozenset(robots), dead)
        self.findings.looked(Invariant.DEAD, int(dead))
        try:
            yield
        finally:
            self._silence = None

    def flies(self, robot_id: int) -> bool:
        """Tell whether a robot follows the planner, or is jammed and flies by itself."""
        return self.jammed(robot_id) or (
            self.heard(robot_id) and self.states[robot_id].mode is wire.Mode.FLYING
        )

    def jammed(self, robot_id: int) -> bool:
        """Tell whether the world jams a robot."""
        truth = self.truth
        return truth is not None and any(r.jammed for r in truth.robots if r.id == robot_id)

    def heard(self, robot_id: int) -> bool:
        """Tell whether a robot has said something lately."""
        state = self.states.get(robot_id)
        return state is not None and monotonic() - state.stamp_s < HEARD_S

    def left_alone_s(self, robot_id: int, since_s: float) -> float:
        """Return since when a robot is to hold in a silence: while jammed it flies by itself."""
        return max(since_s, self.jammed_s.get(robot_id, since_s))

    # ------------------------------------------------------------------ what is heard

    def _take(self, sample: Sample) -> None:
        if sample.key == self.keys.truth:
            before, self.truth = self.truth, wire.decode(wire.Truth, sample.payload)
            jammed = (robot.id for robot in self.truth.robots if robot.jammed)
            self.jammed_s |= dict.fromkeys(jammed, self.truth.stamp_s)
            passed_s = 0.0 if before is None else self.truth.stamp_s - before.stamp_s
            self._judge_distances(self.truth, min(passed_s, HEARD_S))
            return
        address = self.keys.parse(sample.key)
        if address is None or address.robot_id is None:
            return
        match address.topic:
            case Topic.SETPOINT:
                self._judge_setpoint(wire.decode(wire.Setpoint, sample.payload), address.robot_id)
            case Topic.STATE:
                self._judge_state(wire.decode(wire.State, sample.payload))
            case Topic.EVENTS:
                event = wire.decode(wire.Event, sample.payload)
                if isinstance(event.event, wire.NoticePart):
                    self.notices.append((monotonic(), event.robot_id, event.event))
                elif isinstance(event.event, wire.ModePart):
                    self.modes.append((monotonic(), event.robot_id, event.event))

    def _judge_setpoint(self, message: wire.Setpoint, robot_id: int) -> None:
        if message.boot in self.known_boots:
            return
        self.setpoints += 1
        self.findings.looked(Invariant.LIMITS)
        robot = self._robots[robot_id]
        within = all(
            low - CLOSE_TO <= v <= high + CLOSE_TO
            for v, low, high in zip(
                message.velocity, robot.control_lower, robot.control_upper, strict=True
            )
        )
        inside = all(
            low - CLOSE_TO <= x <= high + CLOSE_TO
            for x, low, high in zip(message.waypoint, *self._field, strict=True)
        )
        level = abs(message.altitude_m - robot.altitude_m) < CLOSE_TO
        if not (within and inside and level and message.ttl_s <= SETPOINT_LIFE_S):
            words = f"robot {robot_id} is to fly {message.velocity} m/s to {message.waypoint}"
            self.findings.broken(Invariant.LIMITS, f"setpoint {robot_id}", words)
        self._judge_sender(message)

    def _judge_sender(self, message: wire.Setpoint) -> None:
        silence = self._silence
        if silence is None or not silence.dead:
            return
        made_s = message.stamp_s - silence.since_s
        late_s = monotonic() - silence.since_s
        if made_s > STAMP_S or late_s > 2.0 + 2.0 * busy():
            words = (
                f"robot {message.robot_id} got a setpoint made {made_s:.2f} s after the planner's"
                f" death, heard {late_s:.2f} s after it"
            )
            self.findings.broken(Invariant.DEAD, f"sender {message.boot}", words)

    def _judge_state(self, state: wire.State) -> None:
        if state.boot in self.known_boots:
            return
        self.states[state.robot_id] = state
        robot = self._robots.get(state.robot_id)
        if robot is None:
            return
        if state.mode is wire.Mode.FLYING:
            self._judge_flight(state, math.hypot(*robot.control_upper))
        silence = self._silence
        if silence is None or state.robot_id not in silence.robots or self.jammed(state.robot_id):
            return
        after_s = state.stamp_s - self.left_alone_s(state.robot_id, silence.since_s)
        moves = state.mode in (wire.Mode.FLYING, wire.Mode.ONBOARD)
        if moves and after_s > 0.0:
            self.held_s.append(after_s)
        if after_s > HOLD_S:
            self.findings.looked(Invariant.HOLD)
            if moves:
                words = f"robot {state.robot_id} is {state.mode} {after_s:.2f} s after the silence"
                self.findings.broken(Invariant.HOLD, f"hold {state.robot_id}", words)

    def judge_orders(self, robot_id: int, speeds_m_s: Iterable[float]) -> None:
        """Judge how fast an autopilot was told to fly by its bridge."""
        most_m_s = math.hypot(*self._robots[robot_id].control_upper)
        for speed_m_s in speeds_m_s:
            self.findings.looked(Invariant.LIMITS)
            if speed_m_s > most_m_s + ROUNDED_M_S:
                words = f"autopilot {robot_id} is told to fly {speed_m_s:.2f} m/s"
                self.findings.broken(Invariant.LIMITS, f"order {robot_id}", words)

    def _judge_flight(self, state: wire.State, most_m_s: float) -> None:
        """A robot without an autopilot flies no faster than a setpoint within limits says.

        An autopilot makes up for what it is behind; what it is told is judged instead.
        """
        if state.robot_id in self._piloted:
            return
        self.findings.looked(Invariant.LIMITS)
        if math.hypot(*state.velocity) > 1.5 * most_m_s:
            words = f"robot {state.robot_id} flies {math.hypot(*state.velocity):.2f} m/s"
            self.findings.broken(Invariant.LIMITS, f"speed {state.robot_id}", words)

    def _judge_distances(self, truth: wire.Truth, passed_s: float) -> None:
        """Two robots in reach keep apart; those that were near each other when one came back part.

        Nobody keeps clear for long of a robot that is out of reach (`server.mission.team`).
        """
        connected = [
            robot
            for robot in truth.robots
            if not robot.jammed and robot.id not in self.away and self.heard(robot.id)
        ]
        before, self._connected = self._connected, frozenset(robot.id for robot in connected)
        joining, self._joining = self._joining, {}
        for one, other in combinations(connected, 2):
            self.findings.looked(Invariant.SEPARATION)
            pair, apart_m = (one.id, other.id), math.dist(one.position, other.position)
            if apart_m < self.least_m and (pair in joining or not before.issuperset(pair)):
                flown_s = joining.get(pair, 0.0) + passed_s * all(map(self._follows, pair))
                if flown_s <= PART_S:
                    self._joining[pair] = flown_s
                    continue
            self.nearest_m = min(self.nearest_m, apart_m)
            if apart_m < self.least_m:
                words = f"robots {one.id} and {other.id} are {apart_m:.2f} m apart"
                self.findings.broken(Invariant.SEPARATION, f"{one.id}-{other.id}", words)

    def _follows(self, robot_id: int) -> bool:
        """Tell whether a robot said last that it follows setpoints."""
        return self.states[robot_id].mode is wire.Mode.FLYING
