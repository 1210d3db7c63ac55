"""An operator's order to one robot, and what becomes of it."""

import asyncio
from time import monotonic
from uuid import uuid4

from vehicles import messages as wire
from vehicles import translation
from vehicles.bus import Bus
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

LOOK_S = 0.05
ANSWERS = frozenset({"done", "refused"})
"""Codes of the notice that ends an order."""


class OrderRefused(Exception):
    """Raised when the robot does not carry out an order; says why."""


class OrderUnanswered(Exception):
    """Raised when a robot is not there, or has not carried out an order in time."""


async def give(
    bus_settings: ZenohSettings, team: str, robot_id: int, order: wire.Order, patience_s: float
) -> str:
    """Give an order; return what the robot says once it has carried it out.

    Raises:
        OrderRefused: It refuses.
        OrderUnanswered: It is not on the bus, or says nothing in time.
        vehicles.bus.BusError: Nobody answers where the settings say.
        ValueError: The team's name does not do.
    """
    keys = TeamKeys(team)
    inbox = Inbox(keys.delivery)
    async with ZenohBus(bus_settings, keys.delivery) as bus:
        if not await bus.present(keys.alive(robot_id)):
            raise OrderUnanswered(f"robot {robot_id} of team {team} is not on the bus")
        await bus.subscribe(keys.robot(robot_id, Topic.EVENTS), inbox)
        command_id = send(bus, keys, robot_id, order, "command line", monotonic())
        deadline_s = monotonic() + patience_s
        while monotonic() < deadline_s:
            answer = _answer(inbox, command_id)
            if answer is not None and answer.code == "refused":
                raise OrderRefused(f"robot {robot_id} refuses: {answer.text}")
            if answer is not None:
                return answer.text
            await asyncio.sleep(LOOK_S)
    raise OrderUnanswered(f"robot {robot_id}: {order.value} is not done after {patience_s:g} s")


def send(
    bus: Bus, keys: TeamKeys, robot_id: int, order: wire.Order, author: str, now_s: float
) -> str:
    """Send one robot an order at `now_s`; return its id, which the robot's notices name."""
    command_id = uuid4().hex
    key = keys.robot(robot_id, Topic.COMMAND)
    command = wire.Command(
        **translation.Sender(uuid4().hex[:16]).header(key, now_s),
        robot_id=robot_id,
        command=order,
        command_id=command_id,
        author=author,
    )
    bus.publish(key, wire.encode(command))
    return command_id


def _answer(inbox: Inbox, command_id: str) -> wire.NoticePart | None:
    """Return the notice that ends an order, None while there is none."""
    for sample in inbox.drain():
        try:
            event = wire.decode(wire.Event, sample.payload).event
        except wire.MessageError:
            continue
        if (
            isinstance(event, wire.NoticePart)
            and event.command_id == command_id
            and event.code in ANSWERS
        ):
            return event
    return None
