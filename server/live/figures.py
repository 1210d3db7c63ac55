"""A live mission's figures, counted as a lockstep run's are.

What only a simulated world knows (hits, paths, errors) is read off the truth it tells; without
one, hits are those the robots reported, and what nobody can know stays empty.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from llm.styles import Loop
from server.durations import Average, Durations
from server.mission.setup import MissionSetup
from server.result import LoopTally, RunTally, WorldFigures, position_errors_m, result_json
from solver.arrays import FloatArray
from solver.problem import Rung
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles.messages import Truth
from vehicles.world.spacing import closest_m


@dataclass(frozen=True, slots=True)
class KeptFigures:
    """What a checkpoint keeps of the figures, so that they go on after a crash."""

    trace: float
    error_m: Average
    solves: dict[int, int]
    """`server.durations.Durations.bins`."""

    longest_solve_s: float
    rungs: dict[Rung, int]
    reported: dict[ZoneKind, int]
    hits: dict[ZoneKind, int] | None
    """Told by the simulated world, None without one ..."""

    earlier: dict[ZoneKind, int]
    """... and by those before it, since each counts from 0."""

    world_step: int | None
    """Newest step of the simulated world."""

    places: tuple[tuple[float, float], ...]
    path_m: tuple[float, ...]
    closest_m: float | None
    wall_s: float
    loops: dict[str, LoopTally]


class FiguresError(ValueError):
    """Raised when an object does not hold kept figures; the message names the fields."""


_KEPT: Final = TypeAdapter(KeptFigures)


def read_figures(values: object) -> KeptFigures:
    """Return what a checkpoint has kept. Raises FiguresError."""
    try:
        return _KEPT.validate_python(values)
    except ValidationError as error:
        places = {".".join(map(str, e["loc"])) or "figures" for e in error.errors()}
        raise FiguresError(f"not kept figures: {', '.join(sorted(places))}") from None


@dataclass(slots=True)
class LiveFigures:
    """Sums over the ticks of one live mission, those before a crash included."""

    setup: MissionSetup
    tally: RunTally = field(default_factory=RunTally)
    reported: Counter[ZoneKind] = field(default_factory=Counter)
    """Hits that robots reported."""

    before: KeptFigures | None = None
    """What was counted before the mission was broken off."""

    _hits: dict[ZoneKind, int] | None = None
    _earlier: Counter[ZoneKind] = field(default_factory=Counter)
    _step: int | None = None
    _places: FloatArray | None = None
    _path_m: FloatArray | None = None
    _closest_m: float = math.inf

    @classmethod
    def after(cls, setup: MissionSetup, before: KeptFigures | None) -> "LiveFigures":
        """Return figures that go on from what was kept, or begin."""
        figures = cls(setup, before=before)
        if before is None:
            return figures
        figures.tally = RunTally(
            trace=before.trace,
            error_m=replace(before.error_m),
            solve=Durations.restored(before.solves, before.longest_solve_s),
            rungs={rung: before.rungs.get(rung, 0) for rung in Rung},
        )
        figures.reported = Counter(before.reported)
        figures._hits, figures._step = before.hits, before.world_step
        figures._earlier = Counter(before.earlier)
        figures._closest_m = math.inf if before.closest_m is None else before.closest_m
        if before.places and len(before.places) == len(before.path_m):
            figures._places = np.array(before.places, dtype=float)
            figures._path_m = np.array(before.path_m, dtype=float)
        return figures

    def kept(self, loops: Mapping[str, LoopTally], wall_s: float) -> dict[str, Any]:
        """Return what a checkpoint keeps, as JSON values."""
        tally = self.tally
        kept = KeptFigures(
            trace=tally.trace,
            error_m=tally.error_m,
            solves=dict(tally.solve.bins),
            longest_solve_s=tally.solve.longest_s,
            rungs=tally.rungs,
            reported=dict(self.reported),
            hits=self._hits,
            earlier=dict(self._earlier),
            world_step=self._step,
            places=() if self._places is None else tuple(map(tuple, self._places.tolist())),
            path_m=() if self._path_m is None else tuple(self._path_m.tolist()),
            closest_m=self._closest_m if math.isfinite(self._closest_m) else None,
            wall_s=self._wall_s(wall_s),
            loops={loop.value: self._account(loop, loops) for loop in Loop},
        )
        values: dict[str, Any] = _KEPT.dump_python(kept, mode="json")
        return values

    def add(self, snapshot: Snapshot, truth: Truth | None) -> None:
        """Count one committed tick."""
        self.reported.update(attack.kind for attack in snapshot.attacks)
        errors_m: list[float] = []
        if truth is not None:
            places = {target.id: target.position for target in truth.targets}
            errors_m = position_errors_m(snapshot, places)
            if truth.step != self._step:
                self._see_world(truth)
                self._move(truth)
        self.tally.step(snapshot, errors_m, 0.0)

    def hits(self) -> dict[ZoneKind, int]:
        """Return hits per kind: the world's count, or what was reported."""
        if self._hits is None:
            return {kind: self.reported[kind] for kind in ZoneKind}
        return {kind: self._hits[kind] + self._earlier[kind] for kind in ZoneKind}

    def result(
        self, snapshot: Snapshot, loops: Mapping[str, LoopTally], wall_s: float
    ) -> dict[str, Any]:
        """Return the mission's one JSON object; `dt` is the live tick.

        `loops` and `wall_s` are of this process; what was kept before is added.
        """
        hits = self.hits()
        world = WorldFigures(
            sensing_attacks=hits[ZoneKind.SENSING],
            communication_attacks=hits[ZoneKind.COMMUNICATION],
            trajectory_length_m=0.0 if self._path_m is None else float(self._path_m.mean()),
            min_separation_m=self._closest_m if math.isfinite(self._closest_m) else None,
        )
        setup = replace(self.setup, tick_s=self.setup.live_tick_s)
        task, action = (self._account(loop, loops) for loop in (Loop.TASK, Loop.ACTION))
        wall_s = self._wall_s(wall_s)
        result = result_json(setup, snapshot, self.tally, world, task, action, wall_s)
        # The authors' accounting needs the private filters, which live on board.
        result.pop("accumulated_trace_authors", None)
        return result

    def _account(self, loop: Loop, loops: Mapping[str, LoopTally]) -> LoopTally:
        """Return a model's whole account."""
        own = loops.get(loop.value, LoopTally())
        earlier = None if self.before is None else self.before.loops.get(loop.value)
        return own if earlier is None else earlier.plus(own)

    def _wall_s(self, own_s: float) -> float:
        return own_s if self.before is None else self.before.wall_s + own_s

    def _see_world(self, truth: Truth) -> None:
        """Take a new step; a world that was started again counts its hits from 0."""
        if self._hits is not None and self._step is not None and truth.step < self._step:
            self._earlier.update(self._hits)
        hits = truth.hits
        self._hits = {ZoneKind.SENSING: hits.sensing, ZoneKind.COMMUNICATION: hits.communication}
        self._step = truth.step

    def _move(self, truth: Truth) -> None:
        """Add the way since the last step of the world."""
        places = np.array([robot.position for robot in truth.robots], dtype=float).reshape(-1, 2)
        if self._places is None or self._path_m is None or len(places) != len(self._places):
            self._path_m = np.zeros(len(places))
        else:
            self._path_m = self._path_m + np.hypot(*(places - self._places).T)
        self._places = places
        self._closest_m = min(self._closest_m, closest_m(places))
