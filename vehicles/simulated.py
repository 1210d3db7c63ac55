"""A simulated robot as its agent sees it: a body to fly and senses to notice with."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot

from solver.observations import Detections
from solver.problem import Dynamics
from solver.setpoints import Setpoint
from solver.zones import Point
from vehicles.body import BodyEvent, BodyEventKind, BodyState
from vehicles.messages import Mode, Order
from vehicles.senses import Incident, Recovered, Struck
from vehicles.world.setup import WorldRobot
from vehicles.world.state import Failures, Hit, WorldEvent
from vehicles.world.world import World

AT_M = 0.05
"""Nearer than this a robot is where it was sent."""

APPROACH_S = 1.0
"""A returning robot slows down when it is less than this from home."""

DOUBLE_CRUISE_M_S = 0.5
"""Speed of return of a robot whose box bounds its acceleration."""


@dataclass(frozen=True, slots=True)
class Motion:
    """What a simulated robot does in the next step."""

    velocity: Point
    altitude_m: float


class SimulatedBody:
    """Flies one robot of a world: `vehicles.body.Body`.

    Args:
        robot: As it was set up; its start is its home.
        world: Read only; whoever owns it moves it by `motion`.
    """

    def __init__(self, robot: WorldRobot, world: World) -> None:
        self._robot = robot
        self._world = world
        self._mode = Mode.HOLDING
        self._reason = "started"
        self._setpoint: Setpoint | None = None
        self._until_s = 0.0
        self._order_id: str | None = None
        self._events: list[BodyEvent] = []

    def state(self, now_s: float) -> BodyState:
        """Return where the robot is and what it does."""
        self._settle(now_s)
        state = self._world.robot_state(self._robot.id)
        return BodyState(
            position=state.position,
            velocity=state.velocity,
            altitude_m=state.altitude_m,
            mode=self._mode,
            reason=self._reason,
            armed=self._mode is not Mode.LANDED,
            battery=None,
            age_s=0.0,
        )

    def follow(self, setpoint: Setpoint, now_s: float) -> None:
        """Fly a setpoint until it expires, then hold; an order in force goes before."""
        if self._mode not in (Mode.HOLDING, Mode.FLYING) or self._order_id is not None:
            return
        self._setpoint, self._until_s = setpoint, now_s + setpoint.ttl_s
        self._change(Mode.FLYING, "following setpoints")

    def hold(self, now_s: float, reason: str) -> None:
        """Hold position now; who lands, returns or takes off on an order goes on with it."""
        self._setpoint = None
        if self._mode in (Mode.HOLDING, Mode.FLYING):
            self._change(Mode.HOLDING, reason)

    def order(self, order: Order, now_s: float, order_id: str) -> None:
        """Carry out an operator's order."""
        grounded = self._mode is Mode.LANDED
        if grounded and order not in (Order.TAKE_OFF, Order.LAND):
            self._tell(BodyEventKind.REFUSED, f"{order.value}: on the ground", now_s, order_id)
            return
        if order is Order.TAKE_OFF and not grounded:
            self._tell(BodyEventKind.REFUSED, "take_off: in the air", now_s, order_id)
            return
        self._setpoint = None
        self._order_id = order_id
        match order:
            case Order.HOLD:
                self._change(Mode.HOLDING, "ordered to hold")
                self._tell(BodyEventKind.DONE, "holding", now_s, order_id)
            case Order.RESUME:
                self._order_id = None
                self._change(Mode.HOLDING, "waiting for setpoints")
                self._tell(BodyEventKind.DONE, "taking setpoints again", now_s, order_id)
            case Order.LAND:
                self._change(Mode.LANDING, "ordered to land")
            case Order.RETURN:
                self._change(Mode.RETURNING, "ordered to return")
            case Order.TAKE_OFF:
                self._change(Mode.CLIMBING, "ordered to take off")

    def take_events(self) -> tuple[BodyEvent, ...]:
        """Return what has happened since the last call, oldest first."""
        events, self._events = tuple(self._events), []
        return events

    def motion(self, now_s: float) -> Motion:
        """Return how the world is to move this robot in its next step."""
        self._settle(now_s)
        state = self._world.robot_state(self._robot.id)
        still = Motion((0.0, 0.0), state.altitude_m)
        match self._mode:
            case Mode.FLYING if self._setpoint is not None:
                return Motion(self._setpoint.velocity, self._setpoint.altitude_m)
            case Mode.RETURNING:
                return Motion(self._homeward(state.position), state.altitude_m)
            case Mode.LANDING | Mode.LANDED:
                return Motion((0.0, 0.0), 0.0)
            case Mode.CLIMBING:
                return Motion((0.0, 0.0), self._robot.altitude_m)
            case _:
                return still

    # ------------------------------------------------------------------ inside

    def _settle(self, now_s: float) -> None:
        """Let a mode end that has reached its end."""
        state = self._world.robot_state(self._robot.id)
        match self._mode:
            case Mode.FLYING if self._setpoint is None or now_s >= self._until_s:
                self._setpoint = None
                self._change(Mode.HOLDING, "the last setpoint has expired")
            case Mode.RETURNING if _distance(state.position, self._robot.position) < AT_M:
                self._done(Mode.HOLDING, "at home", now_s)
            case Mode.LANDING if state.altitude_m < AT_M:
                self._done(Mode.LANDED, "landed", now_s)
            case Mode.CLIMBING if abs(state.altitude_m - self._robot.altitude_m) < AT_M:
                self._done(Mode.HOLDING, "in the air", now_s)
            case _:
                pass

    def _homeward(self, position: Point) -> Point:
        east = self._robot.position[0] - position[0]
        north = self._robot.position[1] - position[1]
        box = (*self._robot.control_lower, *self._robot.control_upper)
        single = self._robot.dynamics is Dynamics.SINGLE_INTEGRATOR
        cruise = min(abs(bound) for bound in box) if single else DOUBLE_CRUISE_M_S
        way = hypot(east, north)
        speed = min(cruise, way / APPROACH_S)
        return (speed * east / way, speed * north / way) if way > 0.0 else (0.0, 0.0)

    def _done(self, mode: Mode, words: str, now_s: float) -> None:
        self._change(mode, words)
        self._tell(BodyEventKind.DONE, words, now_s, self._order_id)

    def _change(self, mode: Mode, reason: str) -> None:
        self._mode, self._reason = mode, reason

    def _tell(self, kind: BodyEventKind, text: str, now_s: float, order_id: str | None) -> None:
        self._events.append(BodyEvent(kind, text, now_s, order_id))


class SimulatedSenses:
    """Sensors and failures of one robot of a world: `vehicles.senses.Senses`.

    Args:
        robot_id: Whose.
        world: Read only.
    """

    def __init__(self, robot_id: int, world: World) -> None:
        self._robot_id = robot_id
        self._world = world
        self._incidents: list[Incident] = []
        self.looking = True
        """False while the world stands still: the same moment must not be measured twice."""

    def befall(self, event: WorldEvent) -> None:
        """Take what the world did to this robot."""
        if isinstance(event, Hit):
            self._incidents.append(Struck(event.kind, event.zone))
        else:
            self._incidents.append(Recovered(event.kind))

    def failures(self) -> Failures:
        """Return what the robot cannot do now."""
        return self._world.failures(self._robot_id)

    def detect(self, target_ids: Iterable[int]) -> Detections | None:
        """Return what it sees of these targets now, None in a sensing failure."""
        if not self.looking:
            return None
        return self._world.sense(self._robot_id, target_ids)

    def take_incidents(self) -> tuple[Incident, ...]:
        """Return what has befallen it since the last call, oldest first."""
        incidents, self._incidents = tuple(self._incidents), []
        return incidents


def _distance(one: Point, other: Point) -> float:
    return hypot(one[0] - other[0], one[1] - other[1])
