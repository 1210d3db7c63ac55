"""What the mission infers of zones that nobody has shown to it: from failures, and their absence.

Of robots in reach the places are known at every report, and their sensing failures with them. A
robot that falls silent was hit where it was last; when it returns it has come out, and tells where
it was not heard. Zones likely enough become known zones under names of their own (`i1`, `i2`, ...),
as wide as their extent and the doubt about it.
"""

import re
from collections import Counter
from typing import Final

import numpy as np

from server.mission.checkpoint import KeptZone
from server.mission.knowledge import ZoneKnowledge
from server.mission.setup import HazardSetup, MissionSetup
from server.mission.team import TeamBook
from solver.hazards import HazardMap
from solver.hypotheses import Law
from solver.inferences import Exposure, HazardEstimate
from solver.observations import Attack, Link, LinkChange
from solver.snapshot import InferredZone
from solver.zones import Point, Zone, ZoneKind

LATE_S: Final = 0.5
"""Word of a hit that is older tells of a place that is not known any more."""

KEEP: Final = 0.6
"""Share of the confidence asked for at which a zone that is known already stays so."""

_NAME = re.compile(r"i\d+")


class HazardBook:
    """Owner of the hazard maps, one per kind, and of the names of what they find.

    Without `MissionSetup.hazards` there are none, and it does nothing.
    """

    def __init__(self, setup: MissionSetup) -> None:
        self._setup = setup
        asked = setup.hazards
        self._least = 1.0 if asked is None else asked.confidence
        self._maps = {} if asked is None else {kind: _map(setup, asked) for kind in ZoneKind}
        self._names: dict[tuple[ZoneKind, int], str] = {}
        self._count = 0
        self._struck: Counter[int] = Counter()
        self._cut_off: set[int] = set()
        self._back: set[int] = set()
        self._blind: set[int] = set()
        self._unheard: list[Point] = []
        self._noted_s: dict[int, float] = {}
        self._vouched: tuple[Zone, ...] = ()
        self._shown: dict[str, InferredZone] = {}

    @property
    def zones(self) -> tuple[InferredZone, ...]:
        """What is known of each inferred zone that the team goes by."""
        return tuple(self._shown.values())

    def owns(self, zone_id: str) -> bool:
        """Whether a zone's name is one that is given here."""
        return bool(self._maps) and _NAME.fullmatch(zone_id) is not None

    def struck(self, attack: Attack, now_s: float) -> None:
        """Take that a robot in reach was blinded by nobody knows what."""
        if attack.kind is ZoneKind.SENSING and now_s - attack.time_s <= LATE_S:
            self._struck[attack.robot_id] += 1

    def relinked(self, change: LinkChange, before: Link | None) -> None:
        """Take that a robot fell silent or is heard again."""
        if change.link is Link.JAMMED and before is Link.CONNECTED:
            self._cut_off.add(change.robot_id)
        elif change.link is Link.CONNECTED and before is Link.JAMMED:
            self._back.add(change.robot_id)

    def unheard(self, places: tuple[Point, ...]) -> None:
        """Take where a robot that has returned was not heard, metres."""
        if self._maps:
            self._unheard += places

    def release(self, zone_id: str) -> None:
        """Leave a zone to people, who have erased or changed it."""
        for (kind, key), name in tuple(self._names.items()):
            if name == zone_id:
                self._maps[kind].forget(key)
                del self._names[kind, key]
        self._shown.pop(zone_id, None)

    def infer(
        self, team: TeamBook, known: ZoneKnowledge, now_s: float, elapsed_s: float
    ) -> tuple[str, ...]:
        """Let the maps see what happened up to now, and think; make known what they find.

        Returns the names of zones that are believed in no more.
        """
        if not self._maps:
            return ()
        self._heed(known)
        heard = [robot_id for robot_id in team.ids if team.heard_at(robot_id, now_s)]
        self._maps[ZoneKind.SENSING].observe(self._sensing(team, heard, now_s), now_s)
        self._maps[ZoneKind.COMMUNICATION].observe(
            self._communication(team, heard, now_s, elapsed_s), now_s
        )
        self._noted_s.update(dict.fromkeys(heard, now_s))
        self._blind = {robot_id for robot_id in team.ids if team.is_blind(robot_id)}
        self._struck.clear()
        self._cut_off.clear()
        self._back.clear()
        self._unheard.clear()
        # One fit in a tick: where the first map has thought, the second waits.
        if not any(hazards.update() for hazards in self._maps.values()):
            return ()
        return self._publish(known, team.links())

    def kept(self) -> tuple[KeptZone, ...]:
        """Return what another book needs to go on."""
        return tuple(
            KeptZone(self._names.get((kind, one.key), ""), kind, one)
            for kind, hazards in self._maps.items()
            for one in hazards.kept()
        )

    def restore(self, kept: tuple[KeptZone, ...], now_s: float) -> None:
        """Go on with what another book has kept."""
        for kind, hazards in self._maps.items():
            own = tuple(one for one in kept if one.kind is kind)
            hazards.restore(tuple(one.hazard for one in own), now_s)
            for one in own:
                if _NAME.fullmatch(one.name):
                    self._names[kind, one.hazard.key] = one.name
                    self._count = max(self._count, int(one.name[1:]))
            for estimate in hazards.estimates:
                name = self._names.get((kind, estimate.key))
                if name is not None:
                    self._shown[name] = _inferred(name, estimate)

    # ------------------------------------------------------------------ inside

    def _publish(self, known: ZoneKnowledge, links: dict[int, Link]) -> tuple[str, ...]:
        """Make known what is likely enough; return the names of zones that are no more."""
        shown: dict[str, InferredZone] = {}
        for kind, hazards in self._maps.items():
            for estimate in hazards.estimates:
                name = self._names.get((kind, estimate.key))
                if estimate.confidence < self._least * (1.0 if name is None else KEEP):
                    continue
                if name is None:
                    self._count += 1
                    name = self._names[kind, estimate.key] = f"i{self._count}"
                known.learn(self._zone(name, kind, estimate), links)
                shown[name] = _inferred(name, estimate)
        gone = tuple(name for name in self._shown if name not in shown)
        for name in gone:
            known.forget(name)
        self._names = {place: name for place, name in self._names.items() if name in shown}
        self._shown = shown
        return gone

    def _heed(self, known: ZoneKnowledge) -> None:
        """Take note of the zones that somebody vouches for: what they do is explained."""
        vouched = tuple(zone for zone in known.zones if zone.id not in self._shown)
        if vouched == self._vouched:
            return
        self._vouched = vouched
        for kind, hazards in self._maps.items():
            own = (zone for zone in vouched if zone.kind is kind)
            hazards.told(tuple((zone.mean, zone.covariance) for zone in own))

    def _sensing(self, team: TeamBook, heard: list[int], now_s: float) -> Exposure:
        still = [i in self._blind and team.is_blind(i) for i in heard]
        again = [i in self._blind and not team.is_blind(i) for i in heard]
        return Exposure(
            positions=team.positions_of(team.rows_of(heard)),
            seconds=self._seconds(heard, now_s),
            hits=np.array([self._struck[i] for i in heard], dtype=np.intp),
            failing=np.array(still, dtype=np.bool_),
            recovered=np.array(again, dtype=np.bool_),
        )

    def _communication(
        self, team: TeamBook, heard: list[int], now_s: float, elapsed_s: float
    ) -> Exposure:
        there = [i for i in heard if i not in self._cut_off]
        struck = [i for i in team.ids if i in self._cut_off]
        rows = team.rows_of([*there, *struck])
        positions = np.array(team.positions_of(rows))
        # Its last report was from one tick before the silence, in which it flew as it was told.
        positions[len(there) :] += min(elapsed_s, LATE_S) * team.commanded(rows[len(there) :])
        parts = [len(there), len(struck), len(self._unheard)]
        back = [i in self._back for i in (*there, *struck)]
        return Exposure(
            positions=np.concatenate((positions, np.reshape(self._unheard, (-1, 2)))),
            seconds=np.append(self._seconds(there, now_s), np.zeros(sum(parts[1:]))),
            hits=np.repeat([0, 1, 0], parts),
            failing=np.repeat([False, False, True], parts),
            recovered=np.append(back, np.zeros(parts[2])).astype(np.bool_),
        )

    def _seconds(self, heard: list[int], now_s: float) -> np.ndarray:
        """Return the time since each robot's last report, as far as its place stands for it."""
        tick_s = self._setup.tick_s
        since = [now_s - self._noted_s.get(robot_id, now_s - tick_s) for robot_id in heard]
        return np.clip(since, 0.0, max(LATE_S, tick_s))

    def _zone(self, name: str, kind: ZoneKind, estimate: HazardEstimate) -> Zone:
        defaults = self._setup.zone_defaults(kind)
        return Zone(
            id=name,
            kind=kind,
            mean=estimate.mean,
            covariance=estimate.covariance,
            margin=defaults.margin,
            risk=defaults.risk,
            risk_single=defaults.risk_single,
        )


def attack_law(setup: MissionSetup, asked: HazardSetup) -> Law:
    """Return how zones attack in a mission, and what is expected of them before."""
    width, height = np.subtract(setup.field_upper, setup.field_lower).tolist()
    return Law(
        period_s=setup.planner.attack_period_s,
        step_s=setup.tick_s,
        recover_density=asked.recover_density,
        per_m2=asked.expected_zones / (width * height),
        fault_rate=asked.faults_per_hour / 3600.0,
        deviation_m=asked.deviation_m,
    )


def _map(setup: MissionSetup, asked: HazardSetup) -> HazardMap:
    return HazardMap(attack_law(setup, asked), setup.field_lower, setup.field_upper, asked.memory_s)


def _inferred(name: str, estimate: HazardEstimate) -> InferredZone:
    return InferredZone(
        zone_id=name,
        confidence=estimate.confidence,
        centre_covariance=estimate.centre_covariance,
        extent=estimate.extent,
        strength=estimate.strength,
        strength_deviation=estimate.strength_deviation,
        since_s=estimate.since_s,
    )
