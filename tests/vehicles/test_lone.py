"""A robot simulated by itself: it flies by its own clock and meets a world elsewhere."""

import asyncio
from time import monotonic

import pytest

from benchmarks.fleet import FALCONER, Fleet
from solver.observations import Detections, Link, LinkChange, RobotState
from solver.setpoints import Setpoint
from tests.patience import PATIENCE_S
from tests.vehicles.buses import LOOPBACK, until
from tests.vehicles.pilots import knowledge
from tests.vehicles.world.worlds import robot
from vehicles import messages as wire
from vehicles.keys import TeamKeys
from vehicles.link_monitor import LinkSettings
from vehicles.lone import LoneBody
from vehicles.messages import Mode, Order
from vehicles.team_link import TeamLink
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

HALL = TeamKeys("hall")


def test_it_flies_a_setpoint_for_as_long_as_it_lives_and_obeys() -> None:
    body = LoneBody(robot(21, 0.0), lambda: 0.0)
    body.follow(Setpoint(21, (1.0, 0.0), (0.5, 0.0), 11.5, 0.5), 0.0)
    for step in range(20):
        body.move(0.05, 0.05 * step)
    state = body.state(1.0)
    assert state is not None
    assert (state.mode, state.velocity) == (Mode.HOLDING, (0.0, 0.0))
    assert state.position == pytest.approx((0.5, 0.0), abs=0.06)
    body.order(Order.RETURN, 1.0, "c1")
    for step in range(100):
        body.move(0.05, 1.0 + 0.05 * step)
    home = body.state(6.0)
    assert home is not None
    assert home.position == pytest.approx((0.0, 0.0), abs=0.06)
    assert [event.order_id for event in body.take_events()] == ["c1"]


@pytest.mark.asyncio
async def test_held_up_it_does_not_leap() -> None:
    now_s = 0.0
    body = LoneBody(robot(21, 0.0), lambda: now_s)
    body.follow(Setpoint(21, (1.0, 0.0), (0.5, 0.0), 11.5, 10.0), 0.0)

    def east_m() -> float:
        state = body.state(5.0)
        assert state is not None
        return state.position[0]

    running = asyncio.create_task(body.run())
    await asyncio.sleep(0)
    now_s = 5.0
    await until(lambda: east_m() > 0.0)
    running.cancel()
    assert east_m() <= 0.1 + 1e-9


@pytest.mark.process
@pytest.mark.asyncio
async def test_as_a_process_it_flies_for_a_planner_in_a_world_elsewhere() -> None:
    """Robot 26 of the hall by itself, robot 21 and the targets in the world's process."""
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))
    async with ZenohBus(router, HALL.delivery) as bus, Fleet() as fleet:
        where = bus.endpoints[0]
        world = (*FALCONER, "sim", "hardware", "--connect", where, "--external", "26")
        lone = (*FALCONER, "vehicle", "sim", "hardware", "--robot", "26", "--zenoh-connect", where)
        link = TeamLink(bus, HALL, (21, 26), "p1", monotonic, LinkSettings())
        async with link:
            _, flown = await asyncio.gather(
                fleet.start("world", world), fleet.start("lone", lone, "announced")
            )
            seen: list[object] = []
            async with asyncio.timeout(PATIENCE_S):
                while not (_flies_and_sees(seen) and _speed_m_s(link) > 0.2):
                    seen += link.drain(0.0)
                    link.send_heartbeat("m1", 1, 0.0, wire.PlannerState.RUNNING)
                    link.send_setpoints((Setpoint(26, (0.3, 0.0), (0.0, 0.0), 1.7, 0.5),), "m1")
                    link.send_knowledge(knowledge(26))
                    await asyncio.sleep(0.1)
            assert LinkChange(26, Link.CONNECTED, "heard") in seen
            assert _speed_m_s(link) == pytest.approx(0.3, abs=0.01)
            assert await flown.end() == 0


def _flies_and_sees(seen: list[object]) -> bool:
    own = [what for what in seen if getattr(what, "robot_id", None) == 26]
    flies = any(isinstance(what, RobotState) and what.velocity[0] > 0.2 for what in own)
    return flies and any(isinstance(what, Detections) for what in own)


def _speed_m_s(link: TeamLink) -> float:
    """Return how fast the world says that robot 26 flies east."""
    truth = link.truth()
    return 0.0 if truth is None else truth.robots[1].velocity[0]
