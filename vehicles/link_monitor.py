"""How each robot of a team is reached: connected, jammed or lost. Sans-I/O.

Three silences are told apart. A robot that is silent while its liveliness token is there is alive
and cannot speak: *jammed*. One whose token has gone is *lost* as soon as it is silent. One that
never showed a token (a vehicle that has none) is jammed at first and lost after a while.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from solver.observations import Link, LinkChange


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """When silence means what. Seconds."""

    silent_after_s: float = 0.5
    """Nothing heard for longer is silence."""

    lost_after_s: float = 3.0
    """A silent robot that never showed a token is lost after this long."""

    jam_limit_s: float = 120.0
    """A token is believed for this long; a robot silent for longer is lost all the same."""

    duplicate_s: float = 1.0
    """A second run of a robot is refused while the first was heard no longer ago."""


class Standing(StrEnum):
    """What a message's sender is to us."""

    KNOWN = "known"
    UNKNOWN = "unknown"
    """Not of this team."""

    DUPLICATE = "duplicate"
    """A second run of a robot that is there already."""


@dataclass(slots=True)
class _Robot:
    boot: str | None = None
    heard_s: float | None = None
    token: bool = False
    tokens_seen: bool = False
    link: Link | None = None


class LinkMonitor:
    """Owner of every robot's link. Times are on one monotonic clock.

    Args:
        robot_ids: The team.
        settings: When silence means what.
        now_s: When it begins to listen.
    """

    def __init__(self, robot_ids: Iterable[int], settings: LinkSettings, now_s: float) -> None:
        self.settings = settings
        self._began_s = now_s
        self._robots = {robot_id: _Robot() for robot_id in robot_ids}

    def knows(self, robot_id: int) -> bool:
        """Tell whether a robot is of this team."""
        return robot_id in self._robots

    def heard(self, robot_id: int, boot: str, now_s: float) -> Standing:
        """Take a sign of life; return whether its sender is to be listened to."""
        robot = self._robots.get(robot_id)
        if robot is None:
            return Standing.UNKNOWN
        second = robot.boot is not None and robot.boot != boot
        if second and now_s - (robot.heard_s or 0.0) < self.settings.duplicate_s:
            return Standing.DUPLICATE
        robot.boot, robot.heard_s = boot, now_s
        return Standing.KNOWN

    def appeared(self, robot_id: int) -> None:
        """Take that a robot's token is there. An unknown robot changes nothing."""
        robot = self._robots.get(robot_id)
        if robot is not None:
            robot.token = robot.tokens_seen = True

    def disappeared(self, robot_id: int) -> None:
        """Take that a robot's token has gone: its next run is welcome at once."""
        robot = self._robots.get(robot_id)
        if robot is not None:
            robot.token = False
            robot.boot = None

    def link(self, robot_id: int) -> Link | None:
        """Return how a robot was reached at the last `changes`, None before it."""
        robot = self._robots.get(robot_id)
        return None if robot is None else robot.link

    def changes(self, now_s: float) -> tuple[LinkChange, ...]:
        """Return the links that have changed since the last call, in team order.

        The first word on a robot comes when it is first heard, or when it is late.
        """
        found = []
        for robot_id, robot in self._robots.items():
            link, reason = self._judge(robot, now_s)
            if link is not None and link is not robot.link:
                robot.link = link
                found.append(LinkChange(robot_id, link, reason))
        return tuple(found)

    def _judge(self, robot: _Robot, now_s: float) -> tuple[Link | None, str]:
        limits = self.settings
        silent_s = now_s - (self._began_s if robot.heard_s is None else robot.heard_s)
        if silent_s <= limits.silent_after_s:
            return (None, "") if robot.heard_s is None else (Link.CONNECTED, "heard")
        if robot.token:
            if silent_s > limits.jam_limit_s:
                return Link.LOST, f"silent for {silent_s:.0f} s"
            return Link.JAMMED, "silent, but alive"
        if robot.tokens_seen:
            return Link.LOST, "gone: its token has disappeared"
        if silent_s > limits.lost_after_s:
            return Link.LOST, "never heard" if robot.heard_s is None else "silent for too long"
        return (None, "") if robot.heard_s is None else (Link.JAMMED, "silent")
