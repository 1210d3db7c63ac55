"""Flying alone: by plans of its own, when they are ready, at the altitude it was sent to."""

import asyncio
from dataclasses import replace
from threading import Event

import pytest

from solver.problem import Budget, Problem, Solution
from solver.zones import ZoneKind
from tests.patience import PATIENCE_S
from tests.vehicles.buses import until
from tests.vehicles.pilots import SENSING, Recorder
from tests.vehicles.rigs import TICK_S, rig
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles.settings import AgentSettings
from vehicles.world.setup import WorldSetup, WorldTarget

PAIR = world_setup((robot(21, 0.0), robot(26, 5.0)), (WorldTarget(122, (3.0, 4.0)),))

pytestmark = pytest.mark.asyncio


def jammed_at(x: float, attack_period_s: float) -> WorldSetup:
    """Return a world whose zone always jams in its centre and is over half a metre off."""
    jammer = zone("z1", ZoneKind.COMMUNICATION, (x, 0.0), ((0.01, 0.0), (0.0, 0.01)), margin=0.0)
    return replace(PAIR, zones=(jammer,), attack_period_s=attack_period_s)


async def test_alone_it_keeps_to_the_altitude_it_was_sent_to() -> None:
    async with rig(jammed_at(0.5, 0.01)) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick()
        made.tell(21, zones=())
        while (21, "jammed") not in made.links():
            await made.tick()
        world = made.simulation.world
        before_m = world.robot_state(21).altitude_m
        assert before_m > 2.0, "still on its way down to 1.5 m"
        await made.tick(4)
        assert world.failures(21).communication
        assert world.robot_state(21).altitude_m == pytest.approx(before_m - 4 * TICK_S * 0.5)


class Slow(Recorder):
    """A planner that answers when it is let."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = Event()

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        self.gate.wait(timeout=PATIENCE_S)
        return super().solve(problem, budget)


async def test_a_solve_that_takes_too_long_holds_nobody_up() -> None:
    slow = Slow()
    try:
        async with rig(jammed_at(0.8, 0.001), AgentSettings(plan_wait_s=0.001), slow) as made:
            made.velocities = {21: (1.0, 0.0), 26: (0.0, 0.1)}
            await made.tick()
            made.tell(21, zones=(SENSING,))
            await made.tick(13)
            assert made.velocity(21) == (0.0, 0.0), "no plan: it holds"
            assert made.velocity(26) == (0.0, 0.1), "the others fly on"
            slow.gate.set()
            await until(lambda: len(slow.problems) > 0)
            await asyncio.sleep(0.01)
            await made.tick()
            assert made.velocity(21) == (0.0, 0.0), "that plan is of a place of a second ago"
            for _ in range(round(PATIENCE_S / 0.005)):
                await made.tick()
                if made.velocity(21) == (0.1, 0.0):
                    break
                await asyncio.sleep(0.005)
            assert made.velocity(21) == (0.1, 0.0)
    finally:
        slow.gate.set()
