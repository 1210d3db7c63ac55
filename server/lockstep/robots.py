"""The robots' side of a lockstep step: the world, the links, what is flown on board.

Live, agents and the bus do this (`vehicles.agent`, `vehicles.team_link`); here the same world
and the same on-board pilots are stepped in order. A jammed robot says nothing until it
returns; then it brings its tracks, its zones and word of the attacks it suffered.
"""

from collections.abc import Iterable

from server.mission.core import MissionCore
from server.mission.downlink import Briefing
from server.mission.setup import MissionSetup
from solver.directives import Directives
from solver.observations import Attack, Detections, Link, LinkChange, Observation
from solver.problem import Budget
from solver.setpoints import Setpoint
from solver.zones import Point, ZoneKind
from vehicles.onboard import OnboardPilot, ProblemSolver
from vehicles.world.state import Hit, Recovery
from vehicles.world.world import World


class SimulatedTeam:
    """Owner of the robots' side: who is jammed, and what each robot knows by itself."""

    def __init__(self, setup: MissionSetup, world: World, planner: ProblemSolver) -> None:
        self._setup = setup
        self._world = world
        self._pilots = {rid: OnboardPilot(rid, planner) for rid in setup.robot_ids}
        self._jammed: dict[int, list[Attack]] = {}
        self._seen: dict[int, Detections | None] = {}

    @property
    def jammed(self) -> frozenset[int]:
        """Robots in communication failure."""
        return frozenset(self._jammed)

    def brief(self, core: MissionCore) -> None:
        """Tell every connected robot what the planner knows."""
        briefing = Briefing(core)
        for robot_id, pilot in self._pilots.items():
            if robot_id not in self._jammed:
                pilot.learn(briefing.of(robot_id))

    def take_over(self, core: MissionCore, now_s: float) -> None:
        """Go on with robots that the world has jammed already; they know what the team knows."""
        briefing = Briefing(core)
        for robot_id, pilot in self._pilots.items():
            pilot.learn(briefing.of(robot_id))
            if self._world.failures(robot_id).communication:
                self._jammed[robot_id] = []
                pilot.lost_link(now_s)

    def suffer(self, now_s: float) -> tuple[Observation, ...]:
        """Let the world attack; return what the team hears of it, in order.

        A robot hit by a communication zone falls silent at once: what hit it is known to
        itself alone until it returns.
        """
        heard: list[Observation] = []
        for event in self._world.attack(self._setup.tick_s):
            match event:
                case Hit():
                    heard.extend(self._hit(event, now_s))
                case Recovery(kind=ZoneKind.COMMUNICATION):
                    heard.extend(self._return(event.robot_id, now_s))
                case Recovery():
                    pass  # The robot's next state says so.
        return tuple(heard)

    def report(self, directives: Directives, now_s: float) -> tuple[Observation, ...]:
        """Let every robot look at its targets; return what the connected ones say."""
        heard: list[Observation] = []
        rows = directives.rows()
        for robot_id, pilot in self._pilots.items():
            connected = robot_id not in self._jammed
            state = self._world.robot_state(robot_id)
            pilot.note(now_s, state.position, heard=connected)
            targets = rows.get(robot_id, ()) if connected else pilot.targets
            seen = self._world.sense(robot_id, targets)
            self._seen[robot_id] = seen
            if connected:
                heard.append(state)
                if seen is not None:
                    heard.append(seen)
        return tuple(heard)

    def fly_alone(self, now_s: float, budget: Budget) -> dict[int, Point]:
        """Return the velocities that jammed robots choose on board."""
        velocities = {}
        for robot_id in self._jammed:
            pilot, seen = self._pilots[robot_id], self._seen[robot_id]
            if seen is not None:
                pilot.observe(seen)
            state = self._world.robot_state(robot_id)
            velocities[robot_id], _ = pilot.plan(now_s, state.position, state.velocity, budget)
        return velocities

    def move(self, setpoints: Iterable[Setpoint], alone: dict[int, Point]) -> None:
        """Fly every robot for one step; the world's step ends."""
        commanded = {s.robot_id: s.velocity for s in setpoints}
        self._world.move(self._setup.tick_s, commanded | alone)

    def private_trace(self) -> float:
        """Return the traces of jammed robots that still see, over their own targets.

        The paper authors' program adds these to the team's (their accounting).
        """
        return sum(
            self._pilots[robot_id].trace
            for robot_id in self._jammed
            if self._seen[robot_id] is not None
        )

    def _hit(self, hit: Hit, now_s: float) -> tuple[Observation, ...]:
        attack = Attack(hit.robot_id, hit.kind, hit.zone, now_s)
        pilot = self._pilots[hit.robot_id]
        if hit.kind is ZoneKind.SENSING and hit.robot_id not in self._jammed:
            return (attack,)
        if hit.zone is not None:
            pilot.reveal(hit.zone)
        if hit.robot_id in self._jammed:
            self._jammed[hit.robot_id].append(attack)
            return ()
        self._jammed[hit.robot_id] = [attack]
        pilot.lost_link(now_s)
        return (LinkChange(hit.robot_id, Link.JAMMED, "hit by a communication zone"),)

    def _return(self, robot_id: int, now_s: float) -> tuple[Observation, ...]:
        attacks = self._jammed.pop(robot_id, [])
        back = LinkChange(robot_id, Link.CONNECTED, "outside every communication zone")
        return (back, *attacks, self._pilots[robot_id].report(now_s))
