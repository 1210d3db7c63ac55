"""What really happened in a window, in the gate's own measure."""

from dataclasses import dataclass

import numpy as np

from server.gate.merit import Merit
from solver.observations import Link
from solver.snapshot import Snapshot
from solver.zones import ZoneKind


@dataclass(frozen=True, slots=True)
class Reading:
    """Sums since the mission's start."""

    time_s: float = 0.0
    trace: float = 0.0
    sensing_hits: int = 0
    communication_hits: int = 0
    effort: float = 0.0

    def since(self, before: "Reading") -> Merit:
        """Return the merit of the window that began at an earlier reading."""
        return Merit(
            seconds=self.time_s - before.time_s,
            trace=self.trace - before.trace,
            sensing_hits=float(self.sensing_hits - before.sensing_hits),
            communication_hits=float(self.communication_hits - before.communication_hits),
            effort=self.effort - before.effort,
        )


class Odometer:
    """Owner of the sums. Hits are counted as the team learns of them.

    A robot is cut off once, however often it is hit before it returns; being blinded counts
    whenever it is reported.
    """

    def __init__(self) -> None:
        self.reading = Reading()
        self._links: tuple[Link, ...] = ()

    def look(self, snapshot: Snapshot) -> None:
        """Add one committed tick."""
        before, robots = self.reading, snapshot.robots
        elapsed_s = max(0.0, snapshot.time_s - before.time_s)
        cut_off = sum(
            new is Link.JAMMED and old is not Link.JAMMED
            for old, new in zip(self._links, robots.links, strict=False)
        )
        blinded = sum(attack.kind is ZoneKind.SENSING for attack in snapshot.attacks)
        self._links = robots.links
        self.reading = Reading(
            time_s=snapshot.time_s,
            trace=before.trace + snapshot.trace * elapsed_s,
            sensing_hits=before.sensing_hits + blinded,
            communication_hits=before.communication_hits + cut_off,
            effort=before.effort + float(np.sum(robots.setpoint_velocities**2)) * elapsed_s,
        )
