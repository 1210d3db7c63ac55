"""What a robot's camera sees of targets that carry tags, as its agent's senses."""

from collections.abc import Iterable, Mapping
from typing import Final, Protocol

from solver.observations import Detections
from vehicles.localization.measurements import Stance, TagSighting
from vehicles.localization.tags import target_sightings
from vehicles.senses import Incident
from vehicles.world.state import Failures

PICTURE_S: Final = 0.05
"""Messages about one picture come within this time; a robot moves a few centimetres meanwhile."""


class Standing(Protocol):
    """Knows where the robot is: a `TagAligner` or a `Localizer`."""

    def stance(self, now_s: float) -> Stance | None:
        """Return where the camera looks from, None while that is not known."""
        ...


class TagSenses:
    """Senses of a robot that sees tags on targets: `vehicles.senses.Senses`.

    It notices no attacks: whoever knows of failures of a real robot tells its body.

    Args:
        robot_id: Whose.
        targets: Target by tag.
        standing: Where the robot is.
    """

    def __init__(self, robot_id: int, targets: Mapping[int, int], standing: Standing) -> None:
        self._robot_id = robot_id
        self._targets = dict(targets)
        self._standing = standing
        self._seen: Detections | None = None
        self._picture: list[TagSighting] = []
        self._taken_s = float("-inf")

    def see(self, sighting: TagSighting, now_s: float) -> None:
        """Take one tag, from the body, where a camera tells of them one by one.

        Tags that come within `PICTURE_S` of the first, and before anybody asked, are one picture.
        """
        if now_s - self._taken_s > PICTURE_S:
            self._picture, self._taken_s = [], now_s
        self._picture.append(sighting)
        self.look(self._picture, now_s)

    def look(self, seen: Iterable[TagSighting], now_s: float) -> None:
        """Take the tags of one picture, from the body; called whenever there is a new one.

        A picture that nobody has asked for gives way to the next.
        """
        self._seen = None
        stance = self._standing.stance(now_s)
        if stance is None:
            return
        found = target_sightings(seen, stance.attitude, stance.attitude_variance, self._targets)
        if found:
            position = (float(stance.position[0]), float(stance.position[1]))
            sightings = tuple(one.sighting for one in found)
            self._seen = Detections(self._robot_id, position, sightings)

    def failures(self) -> Failures:
        """Return that nothing fails."""
        return Failures()

    def detect(self, target_ids: Iterable[int]) -> Detections | None:
        """Return what the newest picture shows of these targets, None when there is no new one."""
        seen, self._seen = self._seen, None
        self._picture = []
        if seen is None:
            return None
        wanted = frozenset(target_ids)
        kept = tuple(one for one in seen.sightings if one.target_id in wanted)
        return Detections(seen.robot_id, seen.position, kept)

    def take_incidents(self) -> tuple[Incident, ...]:
        """Return that nothing befell it."""
        return ()
