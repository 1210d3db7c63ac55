"""Our own solver in the place of a silent task model, in a mission that goes on."""

import asyncio
from dataclasses import replace

from server.live.relief import stand_in
from server.mission.core import MissionCore
from solver.directives import Proposal
from solver.snapshot import Snapshot
from tests.server.builders import mission_setup, robot_state, straight_solution
from tests.server.live.flights import DeadModel
from tests.server.live.virtual import run
from tests.server.waiting import eventually

BEGUN_S = 300.0


def going_on() -> Snapshot:
    """What is known of a mission that was brought back after five minutes."""
    core = MissionCore(mission_setup())
    for robot in core.setup.robots:
        core.observe(robot_state(robot.id, robot.position))
    core.commit(straight_solution(core.begin(BEGUN_S)))
    return core.snapshot


def test_a_mission_that_is_brought_back_gives_its_model_two_periods() -> None:
    proposed: list[Proposal] = []

    async def propose(proposal: Proposal) -> object:
        proposed.append(proposal)
        raise RuntimeError("no card is needed here")

    async def fly() -> None:
        setup = mission_setup()
        limit_s = 2.0 * setup.loops.task_period_s
        snapshot = going_on()
        now = asyncio.get_running_loop().time
        made = stand_in(DeadModel(), setup, lambda: snapshot, propose, now)  # type: ignore[arg-type]
        assert made is not None
        flying = asyncio.Event()
        flying.set()
        loop = asyncio.create_task(made.run(flying))
        for since_s in (0.0, 1.0, limit_s - 0.1):
            snapshot = replace(snapshot, time_s=BEGUN_S + since_s)
            made.look(snapshot.time_s)
            await asyncio.sleep(0.1)
        assert proposed == []
        made.look(BEGUN_S + limit_s)
        await eventually(lambda: bool(proposed))
        loop.cancel()
        await asyncio.gather(loop, return_exceptions=True)

    run(fly())
    assert proposed[0].id == "x1"
