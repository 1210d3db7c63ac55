"""What a simulated world and a robot that is flown elsewhere say to each other (docs/messages.md).

The robot tells where it is, the world what it would see there and what befalls it. These messages
never pass through simulated jamming: they are how the robot knows that it is jammed.
"""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from solver.zones import ZoneKind
from vehicles.fields import Id, Length, Position, Velocity
from vehicles.messages import Message, SightingPart, ZonePart


class Happening(StrEnum):
    """What the world does to a robot."""

    STRUCK = "struck"
    RECOVERED = "recovered"


class Pose(Message):
    """Where a robot that others fly really is."""

    robot_id: Id
    position: Position
    velocity: Velocity
    altitude_m: Length


class Senses(Message):
    """What a robot that others fly can do and sees at one moment of the world."""

    robot_id: Id
    sensing_failed: bool
    jammed: bool
    position: Position
    sightings: Annotated[tuple[SightingPart, ...], Field(max_length=4096)] | None


class Incident(Message):
    """Something the world did to a robot that others fly."""

    robot_id: Id
    happening: Happening
    kind: ZoneKind
    zone: ZonePart | None
