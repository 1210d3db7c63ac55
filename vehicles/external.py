"""Robots of a simulated world that are flown elsewhere, by a MAVLink autopilot for example.

The world takes their places from what they tell, senses for them and tells them what befalls
them. A robot that has not told where it is for a second takes no part: it stays where it was last,
sees nothing, and nothing happens to it.
"""

import logging
from collections.abc import Iterable

from solver.observations import RobotState
from vehicles import translation
from vehicles import world_messages as wire
from vehicles.bus import Bus, Subscription
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.messages import MessageError, decode, encode
from vehicles.repetition import Repetition
from vehicles.world.state import WorldEvent
from vehicles.world.world import World

logger = logging.getLogger(__name__)

POSE_FRESH_S = 1.0
"""A robot whose last pose is older takes no part."""


class ExternalRobots:
    """The world's end of its links with robots that are flown elsewhere. `async with`.

    Args:
        robot_ids: Which robots of the world.
        bus: Open.
        keys: The team's.
        boot: Names this run.
    """

    def __init__(self, robot_ids: Iterable[int], bus: Bus, keys: TeamKeys, boot: str) -> None:
        self.refused = 0
        """Poses refused since the start: not valid, or of robots that are not external."""

        self._bus, self._keys = bus, keys
        self._refusals = Repetition(logger)
        self._sender = translation.Sender(boot)
        self._inbox = Inbox(keys.delivery)
        self._poses: dict[int, tuple[float, RobotState] | None] = dict.fromkeys(robot_ids)
        self._listening: Subscription | None = None

    async def __aenter__(self) -> "ExternalRobots":
        if self._poses:
            key = self._keys.external(None, Topic.POSE)
            self._listening = await self._bus.subscribe(key, self._inbox)
        return self

    async def __aexit__(self, *exception: object) -> None:
        if self._listening is not None:
            await self._listening.close()

    def absent(self, now_s: float) -> frozenset[int]:
        """Return the robots that take no part now."""
        return frozenset(
            robot_id
            for robot_id, pose in self._poses.items()
            if pose is None or now_s - pose[0] > POSE_FRESH_S
        )

    def place(self, world: World, now_s: float) -> None:
        """Put every robot where it last said it was."""
        for sample in self._inbox.drain():
            try:
                pose = decode(wire.Pose, sample.payload)
            except MessageError as error:
                self.refused += 1
                self._refusals.warn(now_s, "the world refuses a pose: %s", error)
                continue
            address = self._keys.parse(sample.key)
            own = address is not None and address.robot_id == pose.robot_id
            if not own or pose.robot_id not in self._poses:
                self.refused += 1
                words = "the world flies robot %d itself: pose refused"
                self._refusals.warn(now_s, words, pose.robot_id)
                continue
            self._poses[pose.robot_id] = (
                now_s,
                RobotState(
                    robot_id=pose.robot_id,
                    position=pose.position,
                    velocity=pose.velocity,
                    altitude_m=pose.altitude_m,
                    sensing_failed=False,
                ),
            )
        for known in self._poses.values():
            if known is not None:
                world.place(known[1])

    def tell_senses(self, world: World, now_s: float, *, looking: bool) -> None:
        """Tell every robot that takes part what it can do and what it sees.

        Args:
            world: Asked before the step ends.
            now_s: This machine's monotonic clock.
            looking: False while the world stands still: no moment is measured twice.
        """
        targets = [target.id for target in world.setup.targets]
        absent = self.absent(now_s)
        for robot_id, known in self._poses.items():
            if known is None or robot_id in absent:
                continue
            failures = world.failures(robot_id)
            seen = world.sense(robot_id, targets) if looking else None
            key = self._keys.external(robot_id, Topic.SENSES)
            header = self._sender.header(key, now_s)
            message = translation.senses_message(header, known[1], failures, seen)
            self._bus.publish(key, encode(message))

    def befall(self, event: WorldEvent, now_s: float) -> None:
        """Tell a robot what the world did to it."""
        key = self._keys.external(event.robot_id, Topic.INCIDENTS)
        message = translation.incident_message(self._sender.header(key, now_s), event)
        self._bus.publish(key, encode(message))
