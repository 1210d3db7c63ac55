"""Somebody at the far site who hears its bus and takes no part: twenty JSON lines a second.

    python -m benchmarks.field.observer ENDPOINT TEAM

A line holds `at_s` (this machine's monotonic clock) and per robot its mode, its speed, how long it
has been silent, and its setpoints: how many were heard, the longest wait for one since the last
line, how many it refused.
"""

import asyncio
import json
import math
import sys
from time import monotonic

from benchmarks.mixed import Watch, counting_inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

_EVERY_S = 0.05


async def observe(endpoint: str, team: str) -> None:
    """Tell what is heard, until nobody reads it."""
    keys = TeamKeys(team)
    settings = ZenohSettings(connect=(endpoint,), open_timeout_s=60.0)
    async with ZenohBus(settings, keys.delivery) as bus:
        watch = Watch(counting_inbox(keys))
        for topic in (Topic.STATE, Topic.HEALTH, Topic.EVENTS, Topic.SETPOINT):
            await bus.subscribe(keys.robot(None, topic), watch.inbox)
        while True:
            watch.hear(keys)
            sys.stdout.write(json.dumps(_line(watch)) + "\n")
            sys.stdout.flush()
            watch.events.clear()
            watch.longest_s.clear()
            await asyncio.sleep(_EVERY_S)


def _line(watch: Watch) -> dict[str, object]:
    now_s = monotonic()
    return {
        "at_s": now_s,
        "robots": {
            robot_id: {
                "mode": state.mode.value,
                "speed_m_s": math.hypot(*state.velocity),
                "setpoints": watch.setpoints.get(robot_id, 0),
                "wait_s": watch.longest_s.get(robot_id, 0.0),
                "refused": watch.healths[robot_id].refused if robot_id in watch.healths else 0,
            }
            for robot_id, state in watch.states.items()
        },
    }


if __name__ == "__main__":
    asyncio.run(observe(*sys.argv[1:]))
