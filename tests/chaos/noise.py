"""Faults of another sort: what is said by those who should be silent, or is no sense at all."""

import asyncio
import random
from time import monotonic

from tests.chaos.ear import Unreported, noticed
from tests.chaos.schedule import Strike
from tests.chaos.team import ARDUPILOT, ROBOTS, Team
from tests.patience import busy
from vehicles import messages as wire
from vehicles.keys import Topic
from vehicles.mavlink.protocol import mavlink

STRANGER = 99
"""No robot of the team, and no system of MAVLink that belongs to it."""

GARBAGE_TOPICS = (
    Topic.STATE,
    Topic.DETECTIONS,
    Topic.HEALTH,
    Topic.EVENTS,
    Topic.SETPOINT,
    Topic.KNOWLEDGE,
    Topic.COMMAND,
)
ALMOST = (
    b"",
    b"{",
    b"[]",
    b"null",
    b'{"v":2}',
    b'{"v":1,"velocity":[1e999,0]}',
    b'{"v":1,"boot":"x","seq":-1,"stamp_s":NaN}',
    b"\xff\xfe" * 50,
)


async def speak_twice(team: Team, strike: Strike) -> str:
    """Speak under a robot's id: it must hold."""
    robot, since_s, boot = strike.robot, monotonic(), f"second-{strike.seed}"
    team.watch.known_boots.add(boot)
    team.watch.away.add(robot)
    key = team.watch.keys.robot(robot, Topic.STATE)
    state = team.watch.states[robot]
    for seq in range(round(10.0 * strike.seconds)):
        update = {"boot": boot, "seq": seq, "stamp_s": monotonic()}
        said = state.model_copy(update=update)
        team.session.publish(key, wire.encode(said))
        await asyncio.sleep(0.1)
    return (await team.ear.until(noticed("duplicate", robot), since_s, f"two of {robot}")).text


async def garble_mavlink(team: Team, strike: Strike) -> str:
    """Send a bridge noise, frames of other systems and nonsense in its autopilot's name."""
    robot, dice, since_s = strike.robot, random.Random(strike.seed), monotonic()
    link = team.links[robot]
    stranger = mavlink.MAVLink(None, srcSystem=STRANGER, srcComponent=1)
    own = mavlink.MAVLink(None, srcSystem=robot, srcComponent=1)
    far = mavlink.MAVLink_local_position_ned_message(1, 5000.0, 5000.0, -2.0, 0.0, 0.0, 0.0)
    nowhere = mavlink.MAVLink_local_position_ned_message(1, *(float("nan"),) * 6)
    until_s = since_s + strike.seconds
    while monotonic() < until_s:
        frame = nowhere.pack(own)
        torn = frame[: dice.randrange(1, len(frame))]
        for datagram in (dice.randbytes(40), far.pack(stranger), frame, torn):
            link.to_bridge(datagram)
        await asyncio.sleep(0.05)
    return (await team.ear.until(noticed("noise", robot), since_s, "garbage on MAVLink")).text


async def garble_bus(team: Team, strike: Strike) -> str:
    """Put on every kind of key what is no message."""
    dice, before = random.Random(strike.seed), await team.ear.dropped()
    keys, until_s = team.watch.keys, monotonic() + strike.seconds
    while monotonic() < until_s:
        for topic in GARBAGE_TOPICS:
            payload = dice.choice((*ALMOST, dice.randbytes(dice.randrange(1, 400))))
            team.session.publish(keys.robot(dice.choice(ROBOTS), topic), payload)
        team.session.publish(keys.heartbeat, dice.choice(ALMOST))
        team.session.publish(keys.control, dice.choice(ALMOST))
        team.session.publish(keys.truth, dice.choice(ALMOST))
        await asyncio.sleep(0.05)
    return await _counted(team, before, "garbage on the bus")


async def flood_bus(team: Team, strike: Strike) -> str:
    """Say some two thousand sound messages a second in the name of a robot that nobody knows."""
    boot, before = f"flood-{strike.seed}", await team.ear.dropped()
    team.watch.known_boots.add(boot)
    keys, seq = team.watch.keys, 0
    sound = team.watch.states[ARDUPILOT].model_copy(update={"robot_id": STRANGER, "boot": boot})
    event = wire.Event(
        v=1, boot=boot, seq=0, stamp_s=0.0, robot_id=STRANGER, age_s=0.0,
        event=wire.NoticePart(code="flood", text="x" * 200),
    )  # fmt: skip
    until_s = monotonic() + strike.seconds
    while monotonic() < until_s:
        for _ in range(10):
            seq += 1
            for topic, message in ((Topic.STATE, sound), (Topic.EVENTS, event)):
                said = message.model_copy(update={"seq": seq})
                team.session.publish(keys.robot(STRANGER, topic), wire.encode(said))
        await asyncio.sleep(0.01)
    return await _counted(team, before, "flood on the bus")


async def _counted(team: Team, before: float, what: str) -> str:
    """Wait until the server's metrics tell of messages that were refused.

    What was read before may have been the count of a planner that had just ended: its successor's
    begins at 0.
    """
    until_s = monotonic() + 20.0 * busy()
    while monotonic() < until_s:
        counted = await team.ear.dropped()
        refused = counted - before if counted >= before else counted
        if refused > 0:
            return f"{refused:.0f} more messages counted as refused or dropped"
        await asyncio.sleep(0.2)
    raise Unreported(f"{what}: nothing is counted as refused")
