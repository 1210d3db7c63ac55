"""The hazard map: danger zones inferred from where robots failed and where they did not.

One map per kind of attack. It finds how many zones there are, and of each its centre, extent and
strength, with the uncertainty of all of these and the probability that it exists. Each zone has a
posterior of its own (`solver.hypotheses`), given the evidence (`solver.encounters`) and the mean
density of the others; a hit that no zone explains founds another one, two that explain no more
together than one would become one, and what the evidence speaks against goes. Frame ENU, metres,
seconds. Deterministic: no dice.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solver import hypotheses
from solver.arrays import BoolArray, FloatArray
from solver.densities import Shape, density, gaussian, halves, reach_m
from solver.encounters import Encounters, Layer
from solver.hypotheses import Background, Cloud, Known, Law, Proposal
from solver.inferences import Exposure, HazardEstimate, KeptHazard
from solver.zones import Matrix2, Point

MOST_ZONES = 24
"""Of one kind; further hits found no more."""

MOST_WAITING = 64
"""Hits that wait to be explained; of more at once the oldest only count as evidence."""

REFIT_S = 1.0
"""Unless something was hit, one zone at most is looked at again so often."""

NEWS = 0.03
"""A zone is looked at again when so many hits were expected of it since, and did not come."""

GONE = 0.05
"""A zone that is less likely than this is none."""

MOST_LOOKS = 8
"""In a row at a zone whose posterior is not found."""

_FIRST_ROUNDS = 4
_NEXT_ROUNDS = 2
_APART = 3.0
"""Zones whose centres are closer, in deviations of both together, may be one."""


@dataclass(slots=True)
class _Believed:
    """One zone of the map."""

    cloud: Cloud
    since_s: float
    missed: float = 0.0
    """Hits expected of it since it was last looked at."""

    looks: int = 0
    """In a row, none of which has converged."""

    urgent: bool = False
    contested: bool = False
    """Whether it is to be asked if it and a neighbour are one."""

    known: Known | None = None
    """What was known of it when this map began, or when evidence of it was let go of."""

    def shape(self) -> Shape:
        """Return centre, covariance and mass of its mean density."""
        cloud = self.cloud
        return cloud.centre, cloud.predictive, cloud.strength * _probability(cloud.log_odds)


class HazardMap:
    """Owner of what is believed of the zones of one kind.

    Args:
        law: How they attack, and what is expected before.
        lower: South-west corner of the field.
        upper: North-east corner.
        memory_s: Time after which evidence counts for 1/e.
    """

    def __init__(self, law: Law, lower: Point, upper: Point, memory_s: float) -> None:
        self._law = law
        self._encounters = Encounters(lower, upper, memory_s)
        self._believed: dict[int, _Believed] = {}
        self._told: tuple[Shape, ...] = ()
        self._count = 0
        self._now_s: float | None = None
        self._looked_s = -np.inf
        self._unexplained: deque[FloatArray] = deque(maxlen=MOST_WAITING)
        self._work: Iterator[None] = iter(())

    @property
    def estimates(self) -> tuple[HazardEstimate, ...]:
        """Every zone that is believed in, oldest first."""
        return tuple(_estimate(key, zone) for key, zone in self._believed.items())

    def told(self, zones: tuple[tuple[Point, Matrix2], ...]) -> None:
        """Take means and covariances of all zones that somebody else vouches for.

        What they do needs no other explanation.
        """
        self._told = tuple((np.asarray(m), np.asarray(S), 1.0) for m, S in zones)

    def observe(self, exposure: Exposure, now_s: float) -> None:
        """Take what happened in one step that ended at `now_s`."""
        if self._now_s is not None and now_s > self._now_s:
            self._encounters.fade(now_s - self._now_s)
        self._now_s = now_s
        where, hit = exposure.positions, exposure.hits > 0
        if not len(where):
            return
        self._note(Layer.HIT, where, exposure.hits.astype(np.float64))
        self._note(Layer.CLEAR, where, np.where(hit, 0.0, exposure.seconds))
        self._note(Layer.INSIDE, where, exposure.failing & ~hit)
        self._note(Layer.OUTSIDE, where, exposure.recovered & ~hit)
        self._unexplained += [where[row] for row in np.flatnonzero(hit)]
        rim = (exposure.failing & ~hit) | exposure.recovered
        rate = exposure.seconds / self._law.period_s
        for zone in self._believed.values():
            centre, covariance, mass = zone.shape()
            expected = mass * gaussian(where, centre, covariance)
            zone.missed += float(expected @ (rate * ~hit))
            if rim.any():
                away = np.hypot(*(where[rim] - centre).T)
                zone.missed += NEWS * bool((away < reach_m(covariance)).any())

    def update(self) -> bool:
        """Think for a bounded time, that of one fit; return whether that changed anything."""
        for _ in self._work:
            return True
        self._work = self._thoughts(0.0 if self._now_s is None else self._now_s)
        for _ in self._work:
            return True
        return False

    def kept(self) -> tuple[KeptHazard, ...]:
        """Return what another map needs to know the same zones."""
        return tuple(_kept(key, zone) for key, zone in self._believed.items())

    def restore(self, kept: tuple[KeptHazard, ...], now_s: float) -> None:
        """Take over zones that another map has believed in; evidence begins anew."""
        self._now_s = now_s
        for one in kept:
            mean, covariance = np.asarray(one.mean), np.asarray(one.covariance)
            if mean.shape != (6,) or covariance.shape != (6, 6):
                continue
            known = Known(Proposal(mean, covariance), one.log_odds)
            cloud = hypotheses.remembered(known)
            self._believed[one.key] = _Believed(cloud, one.since_s, known=known)
            self._count = max(self._count, one.key)

    def forget(self, key: int) -> None:
        """Let go of a zone and of all evidence around it: it comes back when it hits again.

        What that evidence has told of its neighbours stays known of them.
        """
        zone = self._believed.pop(key, None)
        if zone is None:
            return
        centre, covariance, _ = zone.shape()
        reach = reach_m(covariance)
        self._encounters.forget(_point(centre), reach)
        for other in self._believed.values():
            if np.abs(other.cloud.centre - centre).max() <= reach:
                other.known = Known(other.cloud.proposal, other.cloud.log_odds)

    # ------------------------------------------------------------------ inside

    def _note(self, layer: Layer, where: FloatArray, weights: FloatArray | BoolArray) -> None:
        counts = np.asarray(weights, dtype=np.float64)
        rows = counts > 0.0
        if rows.any():
            self._encounters.add(layer, where[rows], counts[rows])

    def _thoughts(self, now_s: float) -> Iterator[None]:
        """Do what is most in need of being done; every step is one fit."""
        while self._unexplained:
            yield from self._explain(self._unexplained.popleft(), now_s)
        key = self._next(now_s)
        if key is None:
            return
        self._looked_s = now_s
        zone = self._believed[key]
        contested, zone.contested = zone.contested, False
        if contested and zone.known is None:
            yield from self._contest(key)
        if key in self._believed:
            self._look_again(key)
            yield

    def _next(self, now_s: float) -> int | None:
        """Return the zone that is most in need of being looked at, None when none is."""
        urgent = [key for key, zone in self._believed.items() if zone.urgent]
        if urgent:
            return urgent[0]
        if now_s < self._looked_s + REFIT_S - 1e-9 or not self._believed:
            return None
        key, zone = max(self._believed.items(), key=lambda item: item[1].missed)
        return key if zone.missed >= NEWS else None

    def _explain(self, place: FloatArray, now_s: float) -> Iterator[None]:
        """Find the zones that may have caused a hit, or believe in another one."""
        causes = {
            key: mass * float(gaussian(place[None], centre, covariance)[0])
            for key, zone in self._believed.items()
            for centre, covariance, mass in (zone.shape(),)
        }
        vouched = float(density(self._told, place[None])[0])
        likely = max(causes.values(), default=0.0)
        if max(likely, vouched) >= self._law.per_m2 or len(self._believed) >= MOST_ZONES:
            for key, share in causes.items():
                if share >= 0.1 * likely and share > 0.0:
                    zone = self._believed[key]
                    zone.urgent = zone.contested = True
                    zone.looks = 0
            return
        cloud = self._fitted(hypotheses.around(place, self._law), (), _FIRST_ROUNDS)
        if _probability(cloud.log_odds) >= GONE:
            self._count += 1
            self._believed[self._count] = _Believed(cloud, now_s, urgent=True, contested=True)
        yield

    def _look_again(self, key: int) -> None:
        zone = self._believed[key]
        zone.cloud = self._fitted(zone.cloud.proposal, (key,), _NEXT_ROUNDS, known=zone.known)
        # What is not found at once is looked for in the next ticks: one fit in each.
        zone.looks = 0 if zone.cloud.converged else zone.looks + 1
        zone.missed, zone.urgent = 0.0, 0 < zone.looks < MOST_LOOKS
        if _probability(zone.cloud.log_odds) < GONE:
            del self._believed[key]

    def _contest(self, key: int) -> Iterator[None]:
        """Make one zone of two neighbours, or two of one, where the evidence is for it."""
        zone = self._believed[key]
        centre, covariance, _ = zone.shape()
        for other, neighbour in self._believed.items():
            if other == key or neighbour.known is not None:
                continue
            there, also, _ = neighbour.shape()
            offset = there - centre
            if offset @ np.linalg.solve(covariance + also, offset) < _APART**2:
                yield from self._join(min(key, other), max(key, other))
                return
        yield from self._divide(key)

    def _join(self, older: int, younger: int) -> Iterator[None]:
        """Let the older of two zones explain what both do, if that is likelier."""
        both = (older, younger)
        first, second = self._believed[older].cloud, self._believed[younger].cloud
        one = self._fitted(_between(first, second), both, _FIRST_ROUNDS)
        yield
        alone = self._fitted(first.proposal, both, _NEXT_ROUNDS)
        yield
        beside = self._fitted(second.proposal, (younger,), _NEXT_ROUNDS)
        yield
        there = older in self._believed and younger in self._believed
        if there and one.log_odds > alone.log_odds + beside.log_odds:
            self._believed[older].cloud = one
            self._believed[older].urgent = True
            del self._believed[younger]

    def _divide(self, key: int) -> Iterator[None]:
        """Believe in two zones instead of one, if that is likelier."""
        zone = self._believed[key]
        centre, covariance, _ = zone.shape()
        marks = self._encounters.near(_point(centre), reach_m(covariance)).hits
        groups = halves(marks.points, marks.weights)
        if groups is None or len(self._believed) >= MOST_ZONES:
            return
        whole, without = zone.cloud, (key,)
        first = self._fitted(hypotheses.around(groups[0], self._law), without, _NEXT_ROUNDS)
        yield
        start = hypotheses.around(groups[1], self._law)
        second = self._fitted(start, without, _NEXT_ROUNDS, (_shape(first),))
        yield
        first = self._fitted(first.proposal, without, _NEXT_ROUNDS, (_shape(second),))
        yield
        alone = self._fitted(second.proposal, without, _NEXT_ROUNDS)
        yield
        if key in self._believed and first.log_odds + alone.log_odds > whole.log_odds:
            zone.cloud = first
            self._count += 1
            self._believed[self._count] = _Believed(second, self._now_s or 0.0, urgent=True)

    def _fitted(
        self,
        start: Proposal,
        without: tuple[int, ...],
        rounds: int,
        beside: tuple[Shape, ...] = (),
        known: Known | None = None,
    ) -> Cloud:
        """Return the posterior of a zone, the others (but `without` some) being as they are."""
        spread = start.covariance[:2, :2] + np.exp(2.0 * start.mean[2]) * np.eye(2)
        evidence = self._encounters.near(_point(start.mean[:2]), reach_m(spread))
        others = (
            *self._told,
            *beside,
            *(zone.shape() for key, zone in self._believed.items() if key not in without),
        )
        background = Background(
            hits=density(others, evidence.hits.points),
            inside=density(others, evidence.inside.points),
        )
        return hypotheses.fitted(self._law, evidence, background, start, rounds, known)


def _shape(cloud: Cloud) -> Shape:
    return cloud.centre, cloud.predictive, cloud.strength


def _estimate(key: int, zone: _Believed) -> HazardEstimate:
    cloud = zone.cloud
    return HazardEstimate(
        key=key,
        mean=_point(cloud.centre),
        centre_covariance=_matrix(cloud.centre_covariance),
        extent=_matrix(cloud.extent),
        strength=cloud.strength,
        strength_deviation=cloud.strength_deviation,
        confidence=_probability(cloud.log_odds),
        since_s=zone.since_s,
    )


def _kept(key: int, zone: _Believed) -> KeptHazard:
    found = zone.cloud.proposal
    return KeptHazard(
        key=key,
        mean=tuple(found.mean.tolist()),
        covariance=tuple(map(tuple, found.covariance.tolist())),
        log_odds=zone.cloud.log_odds,
        since_s=zone.since_s,
    )


def _probability(log_odds: float) -> float:
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -500.0, 500.0))))


def _between(first: Cloud, second: Cloud) -> Proposal:
    """Return where to look for one zone instead of two."""
    a, b = first.proposal, second.proposal
    offset = 0.5 * (a.mean - b.mean)
    covariance = 0.5 * (a.covariance + b.covariance) + np.outer(offset, offset)
    return Proposal(0.5 * (a.mean + b.mean), covariance)


def _point(values: FloatArray) -> Point:
    return float(values[0]), float(values[1])


def _matrix(values: FloatArray) -> Matrix2:
    (a, b), (_, d) = values.tolist()
    return ((a, b), (b, d))
