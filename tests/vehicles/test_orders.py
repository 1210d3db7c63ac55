"""An operator's order and its answer, over a real bus."""

import asyncio

import pytest

from tests.patience import PATIENCE_S
from tests.vehicles.buses import KEYS, LOOPBACK, Reader, until
from vehicles import messages as wire
from vehicles import translation
from vehicles.keys import Topic
from vehicles.orders import OrderRefused, OrderUnanswered, give
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

ROUTER = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))

pytestmark = [pytest.mark.asyncio, pytest.mark.sockets]


async def answered(codes: tuple[str, ...], patience_s: float = PATIENCE_S) -> str:
    """Give robot 7 an order; it answers with these codes, the first for somebody else's order."""
    heard = Reader()
    async with ZenohBus(ROUTER, KEYS.delivery) as robot:
        await robot.announce(KEYS.alive(7))
        await robot.subscribe(KEYS.robot(7, Topic.COMMAND), heard.inbox)
        client = ZenohSettings(connect=robot.endpoints)
        asking = asyncio.create_task(give(client, "red", 7, wire.Order.LAND, patience_s))
        await until(lambda: heard.take())
        command = wire.decode(wire.Command, heard.take()[0].payload)
        assert (command.robot_id, command.command) == (7, wire.Order.LAND)
        sender, key = translation.Sender("b7"), KEYS.robot(7, Topic.EVENTS)
        robot.publish(key, b"{")
        for number, code in enumerate(codes):
            part = wire.NoticePart(
                code=code,
                text=f"{code} {number}",
                command_id=command.command_id if number else "another",
            )
            event = wire.Event(**sender.header(key, 1.0), robot_id=7, age_s=0.0, event=part)
            robot.publish(key, wire.encode(event))
        return await asking


async def test_only_the_answer_to_this_order_counts() -> None:
    assert await answered(("done", "battery", "done")) == "done 2"


async def test_a_refusal_is_raised_with_its_reason() -> None:
    with pytest.raises(OrderRefused, match="robot 7 refuses: refused 1"):
        await answered(("done", "refused"))


async def test_without_an_answer_it_gives_up() -> None:
    with pytest.raises(OrderUnanswered, match="land is not done after 2 s"):
        await answered(("done", "battery"), 2.0)


async def test_a_robot_that_is_not_there_is_told() -> None:
    async with ZenohBus(ROUTER, KEYS.delivery) as bus:
        client = ZenohSettings(connect=bus.endpoints)
        with pytest.raises(OrderUnanswered, match="robot 8 of team red is not on the bus"):
            await give(client, "red", 8, wire.Order.HOLD, 1.0)
