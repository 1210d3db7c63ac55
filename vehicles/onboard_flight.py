"""Plans on board without holding up the event loop."""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass

from solver.problem import Budget
from solver.zones import Point, Zone
from vehicles.onboard import OnboardPilot

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class OnboardPlan:
    """Where to fly alone, planned from where the robot was `age_s` ago."""

    velocity: Point
    """m/s."""

    waypoint: Point
    """After one planning step, metres."""

    age_s: float


class OnboardFlight:
    """Owner of a pilot: one party at a time touches it, a solve in a worker thread included.

    Args:
        pilot: Nobody else's.
        budget: For each solve.
        wait_s: How long a step waits for its plan; a later one counts at a later step.
    """

    def __init__(self, pilot: OnboardPilot, budget: Budget, wait_s: float) -> None:
        self._pilot = pilot
        self._budget = budget
        self._wait_s = wait_s
        self._planning: asyncio.Future[tuple[Point, Point]] | None = None
        self._told: list[Callable[[OnboardPilot], None]] = []
        self._started_s = 0.0
        self._asked_s = 0.0
        self.plan_s: float | None = None
        """How long the last plan took, None before the first."""

    @property
    def targets(self) -> tuple[int, ...]:
        """Ids of the targets the robot was last assigned."""
        return self._pilot.targets

    @property
    def alone(self) -> bool:
        """Whether the pilot has all it needs to fly alone, and does."""
        return self._pilot.alone

    def tell(self, words: Callable[[OnboardPilot], None]) -> None:
        """Let something happen to the pilot, now or as soon as its solve has ended; in order."""
        self._told.append(words)
        if self._planning is None:
            self._catch_up()

    def reveal(self, zone: Zone) -> None:
        """Tell the pilot of a zone that has hit the robot."""
        self.tell(lambda pilot: pilot.reveal(zone))

    async def plan(self, now_s: float, position: Point, velocity: Point) -> OnboardPlan | None:
        """Return a plan, None when none is ready in time.

        A solve that takes longer goes on; its plan is returned by the step that finds it ready,
        and is then as old as it says.

        Args:
            now_s: This machine's monotonic clock.
            position: Where the robot is, metres.
            velocity: Its velocity, m/s.
        """
        if self._planning is None:
            self._asked_s = now_s
            self._planning = asyncio.ensure_future(
                asyncio.to_thread(self._pilot.plan, now_s, position, velocity, self._budget)
            )
            self._started_s = asyncio.get_running_loop().time()
        await asyncio.wait({self._planning}, timeout=self._wait_s)
        planned = self._finished()
        return None if planned is None else OnboardPlan(*planned, now_s - self._asked_s)

    async def close(self) -> None:
        """Wait for a solve that is under way."""
        if self._planning is not None:
            await asyncio.wait({self._planning})
            self._finished()

    def _finished(self) -> tuple[Point, Point] | None:
        planning = self._planning
        if planning is None or not planning.done():
            return None
        self._planning = None
        self.plan_s = asyncio.get_running_loop().time() - self._started_s
        self._catch_up()
        error = planning.exception()
        if error is not None:
            # The planner promises not to raise; should it, the robot holds when its last
            # setpoint expires.
            logger.error("the plan on board failed", exc_info=error)
            return None
        return planning.result()

    def _catch_up(self) -> None:
        told, self._told = self._told, []
        for words in told:
            words(self._pilot)
