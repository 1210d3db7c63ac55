"""A simulated robot in a process of its own: a point that does what its scenario says it can.

It has a world of its own that holds nothing but itself; targets and zones, if there are any, are
those of a world elsewhere, which it meets as every external robot does (`vehicles.world_link`).
"""

import asyncio
from collections.abc import Callable

from solver.setpoints import Setpoint
from solver.streams import Streams
from vehicles.alongside import alongside
from vehicles.body import BodyEvent, BodyState
from vehicles.launch import Place, pilot_for, serve
from vehicles.messages import Order
from vehicles.simulated import SimulatedBody
from vehicles.world.setup import WorldRobot, WorldSetup
from vehicles.world.world import World

TICK_S = 0.05


class LoneBody:
    """Flies one simulated robot by its own clock: `vehicles.body.Body`.

    Args:
        robot: What it is.
        clock: Monotonic seconds; the same clock as the agent's.
    """

    def __init__(self, robot: WorldRobot, clock: Callable[[], float]) -> None:
        nothing = WorldSetup((robot,), (), (), attack_period_s=1.0, recover_density=1.0)
        self._world = World(nothing, Streams(0))
        self._robot_id = robot.id
        self._body = SimulatedBody(robot, self._world)
        self._clock = clock

    def state(self, now_s: float) -> BodyState | None:
        """Return where it is and what it does."""
        return self._body.state(now_s)

    def follow(self, setpoint: Setpoint, now_s: float) -> None:
        """Fly a setpoint until it expires."""
        self._body.follow(setpoint, now_s)

    def hold(self, now_s: float, reason: str) -> None:
        """Hold position."""
        self._body.hold(now_s, reason)

    def order(self, order: Order, now_s: float, order_id: str) -> None:
        """Carry out an operator's order."""
        self._body.order(order, now_s, order_id)

    def take_events(self) -> tuple[BodyEvent, ...]:
        """Return what has happened since the last call."""
        return self._body.take_events()

    def move(self, dt_s: float, now_s: float) -> None:
        """Let time pass."""
        motion = self._body.motion(now_s)
        self._world.move(
            dt_s, {self._robot_id: motion.velocity}, {self._robot_id: motion.altitude_m}
        )

    async def run(self) -> None:
        """Move for ever; a tick that comes late moves it for as long as it took."""
        before_s = self._clock()
        while True:
            await asyncio.sleep(TICK_S)
            now_s = self._clock()
            # Not beyond a setpoint's life: whoever was held up for long has not flown meanwhile.
            self.move(min(now_s - before_s, 2.0 * TICK_S), now_s)
            before_s = now_s


async def run_lone(
    robot: WorldRobot, place: Place, ready: Callable[[], None] = lambda: None
) -> None:
    """Fly one simulated robot over Zenoh until cancelled.

    Raises:
        vehicles.agent.DuplicateRobotError: Somebody else flies this robot.
        vehicles.bus.BusError: Nobody answers where the settings say.
        ValueError: The engine does not do.
    """
    pilot = await pilot_for(robot.id, place.engine)
    body = LoneBody(robot, asyncio.get_running_loop().time)
    async with alongside(body.run()):
        await serve(body, pilot, place, ready)
