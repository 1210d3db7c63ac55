"""The world in real time: truth, pause, reset, and the clock."""

import asyncio

import pytest

from solver.observations import Detections
from solver.zones import ZoneKind
from tests.server.live.virtual import VirtualLoop, run
from tests.vehicles.rigs import rig
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles.world.setup import WorldTarget

SETUP = world_setup(
    (robot(21, 0.0), robot(26, 5.0)),
    (WorldTarget(122, (3.0, 4.0), (1.0, 0.0)),),
    (zone("s1", ZoneKind.SENSING, (0.0, 0.0), ((0.01, 0.0), (0.0, 0.01))),),
)


@pytest.mark.asyncio
async def test_the_truth_is_told() -> None:
    async with rig(SETUP) as made:
        assert made.link.truth() is None
        await made.tick(10)
        truth = made.link.truth()
        assert truth is not None
        assert truth.step == 10
        assert truth.time_s == pytest.approx(1.0)
        assert truth.state is wire.WorldState.RUNNING
        assert [r.id for r in truth.robots] == [21, 26]
        assert truth.robots[0].sensing_failed
        assert truth.targets[0].position == pytest.approx((4.0, 4.0))
        assert truth.hits.sensing == made.simulation.world.hits(ZoneKind.SENSING) > 0
        assert [z.id for z in truth.zones] == ["s1"]


@pytest.mark.asyncio
async def test_a_paused_world_stands_still_and_its_robots_hold() -> None:
    async with rig(SETUP) as made:
        made.tell(26, targets=(122,))
        made.velocities = {26: (0.0, 1.0)}
        await made.tick(5)
        made.link.control_world(wire.WorldAction.PAUSE)
        await made.tick(2)
        where, hits = made.position(26), made.simulation.world.hits(ZoneKind.SENSING)
        heard = await made.tick(10)
        assert made.position(26) == where
        assert made.simulation.world.hits(ZoneKind.SENSING) == hits
        assert not [o for o in heard if isinstance(o, Detections)], "no moment is measured twice"
        assert len([o for o in heard if type(o).__name__ == "RobotState"]) == 20, "still alive"
        truth = made.link.truth()
        assert truth is not None
        assert truth.state is wire.WorldState.PAUSED
        made.link.control_world(wire.WorldAction.RESUME)
        await made.tick(5)
        assert made.position(26)[1] > where[1]


@pytest.mark.asyncio
async def test_a_reset_begins_again_with_the_seed_it_is_given() -> None:
    async with rig(SETUP) as made:
        made.velocities = {26: (0.0, 1.0)}
        await made.tick(5)
        first = made.simulation.world
        made.link.control_world(wire.WorldAction.RESET, 7)
        made.velocities = {}
        await made.tick()
        assert made.simulation.world is not first
        assert made.simulation.world.step == 1
        assert made.position(26) == (5.0, 0.0)
        made.velocities = {26: (0.0, 1.0)}
        await made.tick(12)
        assert made.position(26)[1] > 0.8, "the same planner flies it on"
        assert not [n for n in made.notices if n.code == "duplicate"]
        assert made.links() == [(21, "connected"), (26, "connected")]


@pytest.mark.asyncio
async def test_a_wrong_order_to_the_world_is_refused() -> None:
    async with rig(SETUP) as made:
        await made.tick(2)
        made.hub.publish("falconer/red/world/control", b'{"v":1,"action":"explode"}')
        await made.tick(2)
        assert made.simulation.world.step == 4


@pytest.mark.parametrize(("held_up_ticks", "late"), [(0.0, 0), (0.5, 0), (6.5, 4)])
def test_in_real_time_it_keeps_its_rate_and_counts_what_it_skips(
    held_up_ticks: float, late: int
) -> None:
    """Held up for six ticks and a half, it lives the first and the last of them and skips four."""

    async def live() -> tuple[int, int]:
        async with rig(SETUP) as made:
            tick_s = made.simulation.settings.tick_s
            running = asyncio.ensure_future(made.simulation.run())
            await asyncio.sleep(5.1 * tick_s)
            loop = asyncio.get_running_loop()
            assert isinstance(loop, VirtualLoop)
            loop.jump(held_up_ticks * tick_s)
            await asyncio.sleep((15.4 - held_up_ticks) * tick_s)
            running.cancel()
            with pytest.raises(asyncio.CancelledError):
                await running
            return made.simulation.world.step, made.simulation.late

    steps, skipped = run(live())
    assert skipped == late
    assert steps + skipped == 21
