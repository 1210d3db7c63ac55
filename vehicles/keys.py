"""The keys of the bus: who says what where (docs/messages.md)."""

import re
from dataclasses import dataclass
from enum import StrEnum

TEAM = re.compile(r"[A-Za-z0-9_-]{1,64}")


class Delivery(StrEnum):
    """How a key's messages are carried."""

    LATEST = "latest"
    """The newest replaces the one before; droppable."""

    EVENT = "event"
    """In order, never dropped by us."""


class Topic(StrEnum):
    """What the messages on a key are about: the last word, or last but one, of the key."""

    STATE = "state"
    DETECTIONS = "detections"
    HEALTH = "health"
    EVENTS = "events"
    SETPOINT = "setpoint"
    KNOWLEDGE = "knowledge"
    COMMAND = "command"
    HEARTBEAT = "heartbeat"
    ALIVE = "alive"
    TRUTH = "truth"
    CONTROL = "control"
    POSE = "pose"
    SENSES = "senses"
    INCIDENTS = "incidents"


UPWARD = (Topic.STATE, Topic.DETECTIONS, Topic.HEALTH, Topic.EVENTS)
"""Topics a robot publishes."""

DOWNWARD = (Topic.SETPOINT, Topic.KNOWLEDGE, Topic.COMMAND)
"""Topics a robot listens to under its own id."""

EXTERNAL = (Topic.POSE, Topic.SENSES, Topic.INCIDENTS)
"""Topics between the simulated world and a robot that is flown elsewhere."""

_EVENTS = frozenset({Topic.EVENTS, Topic.COMMAND, Topic.ALIVE, Topic.CONTROL, Topic.INCIDENTS})


def delivery_of(topic: Topic) -> Delivery:
    """Return how messages of a topic are carried."""
    return Delivery.EVENT if topic in _EVENTS else Delivery.LATEST


@dataclass(frozen=True, slots=True)
class Address:
    """What a key says."""

    topic: Topic
    robot_id: int | None


class TeamKeys:
    """The keys of one team.

    Raises:
        ValueError: The name could not stand in a key.
    """

    def __init__(self, team: str) -> None:
        if not TEAM.fullmatch(team):
            raise ValueError(f"team name {team!r} is not 1 to 64 of A-Z a-z 0-9 _ -")
        self.team = team
        self._root = f"falconer/{team}"
        self._pattern = re.compile(
            rf"{re.escape(self._root)}/(?:robots/(?P<robot>\d{{1,10}})/(?P<topic>[a-z]+)"
            r"|alive/(?P<alive>\d{1,10})|planner/(?P<planner>heartbeat)"
            r"|world/(?P<world>truth|control)"
            r"|world/robots/(?P<external>\d{1,10})/(?P<link>pose|senses|incidents))"
        )

    def robot(self, robot_id: int | None, topic: Topic) -> str:
        """Return the key of one robot's topic, of every robot's for None."""
        return f"{self._root}/robots/{'*' if robot_id is None else robot_id}/{topic.value}"

    def alive(self, robot_id: int | None) -> str:
        """Return the key of one robot's liveliness token, of every robot's for None."""
        return f"{self._root}/alive/{'*' if robot_id is None else robot_id}"

    def external(self, robot_id: int | None, topic: Topic) -> str:
        """Return the key of one robot's link with the simulated world, of every robot's for None.

        Args:
            robot_id: A robot that is flown elsewhere.
            topic: One of `EXTERNAL`.
        """
        return f"{self._root}/world/robots/{'*' if robot_id is None else robot_id}/{topic.value}"

    @property
    def heartbeat(self) -> str:
        """The planner's sign of life."""
        return f"{self._root}/planner/heartbeat"

    @property
    def truth(self) -> str:
        """The simulated world as it is."""
        return f"{self._root}/world/truth"

    @property
    def control(self) -> str:
        """Orders to the simulated world."""
        return f"{self._root}/world/control"

    def parse(self, key: str) -> Address | None:
        """Return what a key is, None when it is not one of this team's."""
        found = self._pattern.fullmatch(key)
        if found is None:
            return None
        if found["alive"] is not None:
            return Address(Topic.ALIVE, int(found["alive"]))
        if found["robot"] is not None:
            topic = found["topic"]
            if topic not in (*UPWARD, *DOWNWARD):
                return None
            return Address(Topic(topic), int(found["robot"]))
        if found["external"] is not None:
            return Address(Topic(found["link"]), int(found["external"]))
        return Address(Topic(found["planner"] or found["world"]), None)

    def delivery(self, key: str) -> Delivery:
        """Return how messages on a key are carried; events for a key that is not ours."""
        address = self.parse(key)
        return Delivery.EVENT if address is None else delivery_of(address.topic)
