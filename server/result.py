"""What a run amounts to: the JSON contract of `falconer run --lockstep --json`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from server.durations import Average, Durations
from server.encoding import loop_answers
from server.mission.setup import Compat, MissionSetup
from solver.problem import Rung
from solver.snapshot import CommentReceipt, Snapshot, TrackStatus
from solver.zones import Point

_SEEN = frozenset({TrackStatus.TRACKED, TrackStatus.COASTING})


@dataclass(slots=True)
class LoopTally:
    """One model loop, counted as the paper counts. Times are the loop's own (virtual) ones."""

    calls: int = 0
    """Logical calls that ended."""

    tries: int = 0
    """Requests sent for them."""

    valid_first: int = 0
    valid: int = 0
    adopted: int = 0
    """Valid answers that went into force."""

    tokens_in: Average = field(default_factory=Average)
    tokens_out: Average = field(default_factory=Average)
    latency_s: Average = field(default_factory=Average)
    """From the question to the verified answer, or to giving up."""

    def plus(self, other: "LoopTally") -> "LoopTally":
        """Return the account of both together."""
        return LoopTally(
            calls=self.calls + other.calls,
            tries=self.tries + other.tries,
            valid_first=self.valid_first + other.valid_first,
            valid=self.valid + other.valid,
            adopted=self.adopted + other.adopted,
            tokens_in=self.tokens_in.plus(other.tokens_in),
            tokens_out=self.tokens_out.plus(other.tokens_out),
            latency_s=self.latency_s.plus(other.latency_s),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the contract's object; means and rates are None at 0 calls."""
        return {
            "calls": self.calls,
            "tries": self.tries,
            "valid_first": self.valid_first,
            "valid": self.valid,
            "adopted": self.adopted,
            "success_rate": self.valid / self.calls if self.calls else None,
            "mean_tokens_in": self.tokens_in.mean,
            "mean_tokens_out": self.tokens_out.mean,
            "mean_latency_s": self.latency_s.mean,
        }


@dataclass(slots=True)
class RunTally:
    """Sums over the steps of one run."""

    trace: float = 0.0
    trace_authors: float = 0.0
    error_m: Average = field(default_factory=Average)
    solve: Durations = field(default_factory=Durations)
    rungs: dict[Rung, int] = field(default_factory=lambda: dict.fromkeys(Rung, 0))

    def step(self, snapshot: Snapshot, errors_m: list[float], trace_authors: float) -> None:
        """Count one committed tick; `errors_m` are distances of estimates to the truth."""
        self.trace += snapshot.trace
        self.trace_authors += trace_authors
        for error_m in errors_m:
            self.error_m.add(error_m)
        if snapshot.solve is not None:
            self.solve.add(snapshot.solve.solve_s)
            self.rungs[snapshot.solve.rung] += 1


@dataclass(frozen=True, slots=True)
class WorldFigures:
    """What the world counted."""

    sensing_attacks: int
    communication_attacks: int
    trajectory_length_m: float
    """Mean over robots of the path length."""

    min_separation_m: float | None
    """Smallest distance of any two robots at any time, None for one robot."""


def position_errors_m(snapshot: Snapshot, places: Mapping[int, Point]) -> list[float]:
    """Return how far the estimates of targets that are tracked or coast lie from the truth.

    Args:
        snapshot: With the estimates, metres.
        places: Where targets really are at that moment, by id; others are left out.
    """
    tracks = snapshot.tracks
    rows = [
        row
        for row, (target_id, status) in enumerate(zip(tracks.ids, tracks.status, strict=True))
        if status in _SEEN and target_id in places
    ]
    true = np.reshape([places[tracks.ids[row]] for row in rows], (-1, 2))
    errors_m: list[float] = np.hypot(*(tracks.positions[rows] - true).T).tolist()
    return errors_m


def result_json(
    setup: MissionSetup,
    last: Snapshot,
    tally: RunTally,
    world: WorldFigures,
    task: LoopTally,
    action: LoopTally,
    wall_s: float,
) -> dict[str, Any]:
    """Return the run's one JSON object, keys as promised to users."""
    ticks = tally.solve.count
    result: dict[str, Any] = {
        "scenario": setup.name,
        "seed": setup.seed,
        "steps": ticks,
        "dt": setup.tick_s,
        "robots": len(setup.robots),
        "targets": len(setup.targets),
        "accumulated_trace": tally.trace,
        "sensing_attacks": world.sensing_attacks,
        "communication_attacks": world.communication_attacks,
        "trajectory_length_m": world.trajectory_length_m,
        "min_separation_m": world.min_separation_m,
        "position_error_m": tally.error_m.mean,
        "wall_s": wall_s,
        "optimizer": {
            "ticks": ticks,
            "median_ms": _ms(tally.solve.quantile_s(0.5)),
            "p99_ms": _ms(tally.solve.quantile_s(0.99)),
            "max_ms": _ms(tally.solve.longest_s if ticks else None),
            "success_rate": tally.rungs[Rung.CONVERGED] / ticks if ticks else None,
            "rungs": {rung.value: count for rung, count in tally.rungs.items()},
        },
        "task_llm": task.as_json(),
        "action_llm": action.as_json(),
    }
    if setup.compat is Compat.AUTHORS:
        result["accumulated_trace_authors"] = tally.trace_authors
    result["directives"] = directives_json(last)
    result["comments"] = [receipt_json(r) for r in (*last.closed, *last.receipts)]
    return result


def directives_json(snapshot: Snapshot) -> dict[str, Any]:
    """Return what was in force at the end, and the beta(A) of it (paper, eq. 4)."""
    # The web side reads results and never makes one; verification brings half of SciPy along.
    from llm.verification import beta

    directives = snapshot.directives
    return {
        "assignment": {str(rid): directives.targets_of(rid) for rid in snapshot.robots.ids},
        "assignment_source": directives.assignment_source.value,
        "beta": beta(directives.assignment, snapshot),
        "weights": directives.weights._asdict(),
        "weights_source": directives.weights_source.value,
    }


def receipt_json(receipt: CommentReceipt) -> dict[str, Any]:
    """Return what became of a comment."""
    return {
        "id": receipt.comment.id,
        "time_s": receipt.comment.time_s,
        "text": receipt.comment.text,
        "status": receipt.status,
        **loop_answers(receipt),
    }


def _ms(duration_s: float | None) -> float | None:
    return None if duration_s is None else 1e3 * duration_s
