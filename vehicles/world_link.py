"""A robot's link with the simulated world that senses for it, wherever the robot is flown.

A robot whose body is not simulated (a MAVLink autopilot's is not, to the world) tells the world
where it is, and hears what it would see there and what befalls it: `vehicles.senses.Senses`. The
link is not the robot's radio, so simulated jamming does not touch it: it is how a jammed robot
knows that it is jammed.
"""

import logging
from collections.abc import Iterable

from solver.observations import Detections, Sighting
from solver.zones import ZoneKind
from vehicles import translation
from vehicles import world_messages as wire
from vehicles.body import BodyState
from vehicles.bus import Bus, Subscription
from vehicles.inbox import Inbox, Sample
from vehicles.keys import TeamKeys, Topic
from vehicles.messages import MessageError, decode, encode
from vehicles.repetition import Repetition
from vehicles.senses import Incident, Recovered, Struck
from vehicles.world.state import Failures

logger = logging.getLogger(__name__)

WORLD_SILENT_S = 1.0
"""A world not heard for so long does nothing to a robot any more."""


class WorldLink:
    """The robot's end of its link with a simulated world. `async with`.

    Args:
        robot_id: Whose.
        bus: Open, and never jammed.
        keys: The team's.
        boot: Names this run.
    """

    def __init__(self, robot_id: int, bus: Bus, keys: TeamKeys, boot: str) -> None:
        self.refused = 0
        """Messages of the world refused since the start."""

        self._refusals = Repetition(logger)
        self._robot_id, self._bus, self._keys = robot_id, bus, keys
        self._sender = translation.Sender(boot)
        self._inbox = Inbox(keys.delivery)
        self._heard_s = float("-inf")
        self._failures = Failures()
        self._seen: Detections | None = None
        self._incidents: list[Incident] = []
        self._listening: list[Subscription] = []

    async def __aenter__(self) -> "WorldLink":
        for topic in (Topic.SENSES, Topic.INCIDENTS):
            key = self._keys.external(self._robot_id, topic)
            self._listening.append(await self._bus.subscribe(key, self._inbox))
        return self

    async def __aexit__(self, *exception: object) -> None:
        for subscription in self._listening:
            await subscription.close()

    def tell(self, state: BodyState, now_s: float) -> None:
        """Tell the world where the robot is."""
        key = self._keys.external(self._robot_id, Topic.POSE)
        pose = wire.Pose(
            **self._sender.header(key, now_s),
            robot_id=self._robot_id,
            position=state.position,
            velocity=state.velocity,
            altitude_m=state.altitude_m,
        )
        self._bus.publish(key, encode(pose))

    def listen(self, now_s: float) -> None:
        """Take what the world has said; a world that has fallen silent lets go of the robot."""
        for sample in self._inbox.drain():
            try:
                self._take(sample, now_s)
            except MessageError as error:
                self.refused += 1
                words = "robot %d refuses a word of the world: %s"
                self._refusals.warn(now_s, words, self._robot_id, error)
        if now_s - self._heard_s > WORLD_SILENT_S:
            self._let_go()

    # ------------------------------------------------------------------ the senses

    def failures(self) -> Failures:
        """Return what the robot cannot do now, by the world's last word."""
        return self._failures

    def detect(self, target_ids: Iterable[int]) -> Detections | None:
        """Return what it saw of these targets since the last call, None when nothing is new."""
        seen, self._seen = self._seen, None
        if seen is None:
            return None
        wanted = frozenset(target_ids)
        kept = tuple(one for one in seen.sightings if one.target_id in wanted)
        return Detections(seen.robot_id, seen.position, kept)

    def take_incidents(self) -> tuple[Incident, ...]:
        """Return what has befallen it since the last call, oldest first."""
        incidents, self._incidents = tuple(self._incidents), []
        return incidents

    # ------------------------------------------------------------------ inside

    def _take(self, sample: Sample, now_s: float) -> None:
        address = self._keys.parse(sample.key)
        if address is None:
            return
        if address.topic is Topic.INCIDENTS:
            incident = decode(wire.Incident, sample.payload)
            zone = None if incident.zone is None else translation.zone_of(incident.zone)
            struck = incident.happening is wire.Happening.STRUCK
            self._incidents.append(
                Struck(incident.kind, zone) if struck else Recovered(incident.kind)
            )
            return
        senses = decode(wire.Senses, sample.payload)
        self._heard_s = now_s
        self._failures = Failures(senses.sensing_failed, senses.jammed)
        self._seen = None
        if senses.sightings is not None:
            sightings = tuple(
                Sighting(one.target_id, one.range_m, one.bearing_rad) for one in senses.sightings
            )
            self._seen = Detections(self._robot_id, senses.position, sightings)

    def _let_go(self) -> None:
        failed, self._failures, self._seen = self._failures, Failures(), None
        self._incidents.extend(Recovered(kind) for kind in ZoneKind if failed.of(kind))
