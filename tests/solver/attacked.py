"""Robots that wander through zones and are hit by the law of attacks, for tests of what is
inferred of it. Written apart from the code that is tested: plain loops, exact steps."""

from dataclasses import dataclass, field

import numpy as np

from solver.hazards import HazardMap
from solver.hypotheses import Law
from solver.inferences import Exposure

FIELD = ((-10.0, -6.0), (10.0, 6.0))
STEP_S = 0.1
LAW = Law(
    period_s=1.0,
    step_s=STEP_S,
    recover_density=0.02,
    per_m2=2.0 / 240.0,
    fault_rate=2.0 / 3600.0,
)

TrueZone = tuple[np.ndarray, np.ndarray]


@dataclass
class Wandering:
    """Robots on random ways, half of them to the places that they are drawn to."""

    zones: list[TrueZone]
    seed: int
    robots: int = 3
    drawn_to: tuple[tuple[float, float], ...] = ()
    steps: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    """Per step places, hits, whose failure went on, whose ended."""

    def __post_init__(self) -> None:
        self._dice = np.random.default_rng(self.seed)
        self._where = np.array([self._goal() for _ in range(self.robots)])
        self._goals = np.array([self._goal() for _ in range(self.robots)])
        self._failed = np.zeros(self.robots, dtype=bool)

    def walk(self, hazards: HazardMap, seconds: float) -> None:
        """Let the robots fly and tell a map what happens to them."""
        for _ in range(round(seconds / STEP_S)):
            self._fly()
            hits = np.zeros(self.robots, dtype=int)
            inside = np.zeros(self.robots, dtype=bool)
            for robot in range(self.robots):
                for centre, covariance in self.zones:
                    density = normal_density(self._where[robot], centre, covariance)
                    chance = min(1.0, density * STEP_S / LAW.period_s)
                    hits[robot] += self._dice.random() < chance
                    inside[robot] |= density >= LAW.recover_density
            before = self._failed
            recovered = before & (hits == 0) & ~inside
            self._failed = (before | (hits > 0)) & ~recovered
            step = (self._where.copy(), hits, before & ~recovered, recovered)
            self.steps.append(step)
            hazards.observe(
                Exposure(step[0], np.full(self.robots, STEP_S), hits, step[2], recovered),
                len(self.steps) * STEP_S,
            )
            hazards.update()

    @property
    def hits(self) -> int:
        """All hits so far."""
        return int(sum(step[1].sum() for step in self.steps))

    def _fly(self) -> None:
        for robot in range(self.robots):
            way = self._goals[robot] - self._where[robot]
            if np.linalg.norm(way) < 0.3:
                self._goals[robot] = self._goal()
            self._where[robot] += 0.05 * way / max(np.linalg.norm(way), 0.05)

    def _goal(self) -> np.ndarray:
        if self.drawn_to and self._dice.random() < 0.5:
            place = self.drawn_to[self._dice.integers(len(self.drawn_to))]
            return np.asarray(place) + self._dice.normal(0.0, 1.2, 2)
        return self._dice.uniform(*FIELD)


def normal_density(place: np.ndarray, centre: np.ndarray, covariance: np.ndarray) -> float:
    """Return the density of one zone at one place."""
    offset = place - centre
    distance = offset @ np.linalg.solve(covariance, offset)
    return float(np.exp(-0.5 * distance) / (2.0 * np.pi * np.sqrt(np.linalg.det(covariance))))


def hazard_map(memory_s: float = 1e5) -> HazardMap:
    """Return an empty map of the field."""
    return HazardMap(LAW, *FIELD, memory_s)
