"""A live mission's figures, counted as a lockstep run's are.

What only a simulated world knows (hits, paths, errors) is read off the truth it tells; without
one, hits are those the robots reported, and what nobody can know stays empty.
"""

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from server.mission.setup import MissionSetup
from server.result import LoopTally, RunTally, WorldFigures, result_json
from solver.arrays import FloatArray
from solver.snapshot import Snapshot, TrackStatus
from solver.zones import ZoneKind
from vehicles.messages import Truth

_SEEN = frozenset({TrackStatus.TRACKED, TrackStatus.COASTING})


@dataclass(slots=True)
class LiveFigures:
    """Sums over the ticks of one live mission."""

    setup: MissionSetup
    tally: RunTally = field(default_factory=RunTally)
    reported: Counter[ZoneKind] = field(default_factory=Counter)
    """Hits that robots reported."""

    _truth: Truth | None = None
    _places: FloatArray | None = None
    _path_m: FloatArray | None = None
    _closest_m: float = math.inf

    def add(self, snapshot: Snapshot, truth: Truth | None) -> None:
        """Count one committed tick."""
        self.reported.update(attack.kind for attack in snapshot.attacks)
        errors_m: list[float] = []
        if truth is not None:
            errors_m = _errors_m(snapshot, truth)
            if self._truth is None or truth.step != self._truth.step:
                self._move(truth)
            self._truth = truth
        self.tally.step(snapshot, errors_m, 0.0)

    def hits(self) -> dict[ZoneKind, int]:
        """Return hits per kind: the world's count, or what was reported."""
        if self._truth is None:
            return {kind: self.reported[kind] for kind in ZoneKind}
        hits = self._truth.hits
        return {ZoneKind.SENSING: hits.sensing, ZoneKind.COMMUNICATION: hits.communication}

    def result(
        self, snapshot: Snapshot, task: LoopTally, action: LoopTally, wall_s: float
    ) -> dict[str, Any]:
        """Return the mission's one JSON object; `dt` is the live tick."""
        hits = self.hits()
        world = WorldFigures(
            sensing_attacks=hits[ZoneKind.SENSING],
            communication_attacks=hits[ZoneKind.COMMUNICATION],
            trajectory_length_m=0.0 if self._path_m is None else float(self._path_m.mean()),
            min_separation_m=self._closest_m if math.isfinite(self._closest_m) else None,
        )
        setup = replace(self.setup, tick_s=self.setup.live_tick_s)
        result = result_json(setup, snapshot, self.tally, world, task, action, wall_s)
        # The authors' accounting needs the private filters, which live on board.
        result.pop("accumulated_trace_authors", None)
        return result

    def _move(self, truth: Truth) -> None:
        """Add the way since the last step of the world."""
        places = np.array([robot.position for robot in truth.robots], dtype=float).reshape(-1, 2)
        if self._places is None or self._path_m is None or len(places) != len(self._places):
            self._path_m = np.zeros(len(places))
        else:
            self._path_m = self._path_m + np.hypot(*(places - self._places).T)
        self._places = places
        if len(places) > 1:
            gaps = np.hypot(*(places[:, None] - places[None, :]).transpose(2, 0, 1))
            np.fill_diagonal(gaps, np.inf)
            self._closest_m = min(self._closest_m, float(gaps.min()))


def _errors_m(snapshot: Snapshot, truth: Truth) -> list[float]:
    """Return the distance of each estimate to the truth."""
    where = {target.id: target.position for target in truth.targets}
    tracks = snapshot.tracks
    return [
        float(np.hypot(*(position - np.asarray(where[target_id]))))
        for target_id, position, status in zip(
            tracks.ids, tracks.positions, tracks.status, strict=True
        )
        if status in _SEEN and target_id in where
    ]
