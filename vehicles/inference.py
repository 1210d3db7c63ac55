"""What a robot that is cut off infers of the zone that did it (docs/hazards.md).

Where it was heard, where it fell silent and where it is not heard yet is evidence that nobody
else has for as long as it is away. Sans-I/O, deterministic; frame ENU, metres, seconds.
"""

from dataclasses import dataclass
from math import dist

import numpy as np

from solver.hazards import HazardMap
from solver.hypotheses import Law
from solver.inferences import Exposure
from solver.zones import Point, Zone, ZoneKind

OWN = "own"
"""Names of zones that a robot has inferred by itself begin so; nobody else hears them."""

APART_M = 0.2
MOST_PLACES = 128
"""Where it was silent is remembered so finely, and so many places of one spell."""

LONGEST_STEP_S = 0.5
"""A place stands for the time since the last one, but not for more."""


@dataclass(frozen=True, slots=True)
class InferenceRules:
    """How a robot infers communication zones, and what it takes them to have."""

    law: Law
    memory_s: float
    """Time after which evidence counts for 1/e."""

    confidence: float
    """What a zone needs to be believed in."""

    risk: float
    risk_single: float


class JammingMap:
    """Owner of one robot's own map of communication zones.

    Args:
        rules: How it is drawn.
        lower: South-west corner of the field.
        upper: North-east corner.
    """

    def __init__(self, rules: InferenceRules, lower: Point, upper: Point) -> None:
        self._rules = rules
        self._map = HazardMap(rules.law, lower, upper, rules.memory_s)
        self._noted_s: float | None = None
        self._silent = False
        self._places: list[Point] = []

    @property
    def silent(self) -> tuple[Point, ...]:
        """Places where it is not heard, some way apart, metres; none once it is heard again."""
        return tuple(self._places)

    def note(self, now_s: float, position: Point, *, heard: bool) -> None:
        """Take where the robot is, and whether it is heard there."""
        before_s = now_s if self._noted_s is None else self._noted_s
        struck, back = not heard and not self._silent, heard and self._silent
        seconds = min(max(now_s - before_s, 0.0), LONGEST_STEP_S) if heard else 0.0
        self._map.observe(
            Exposure(
                positions=np.array([position]),
                seconds=np.array([seconds]),
                hits=np.array([int(struck)]),
                failing=np.array([not heard and not struck]),
                recovered=np.array([back]),
            ),
            now_s,
        )
        self._noted_s, self._silent = now_s, not heard
        if heard:
            self._places.clear()
        elif len(self._places) < MOST_PLACES:
            away = (dist(position, place) for place in self._places)
            if min(away, default=APART_M) >= APART_M:
                self._places.append(position)

    def zones(self, told: tuple[Zone, ...]) -> tuple[Zone, ...]:
        """Think for a bounded time, that of one fit; return the zones that are believed in.

        What happens in those that the robot was told of needs no other.
        """
        rules = self._rules
        self._map.told(
            tuple((z.mean, z.covariance) for z in told if z.kind is ZoneKind.COMMUNICATION)
        )
        self._map.update()
        return tuple(
            Zone(
                id=f"{OWN}{estimate.key}",
                kind=ZoneKind.COMMUNICATION,
                mean=estimate.mean,
                covariance=estimate.covariance,
                margin=0.0,
                risk=rules.risk,
                risk_single=rules.risk_single,
            )
            for estimate in self._map.estimates
            if estimate.confidence >= rules.confidence
        )
