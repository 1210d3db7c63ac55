"""What a run amounts to: the JSON contract of `falconer run --lockstep --json`."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from llm.verification import beta
from server.mission.setup import Compat, MissionSetup
from solver.directives import CommentVerdict
from solver.problem import Rung
from solver.snapshot import CommentReceipt, Snapshot


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

    tokens_in: list[int] = field(default_factory=list)
    tokens_out: list[int] = field(default_factory=list)
    latencies_s: list[float] = field(default_factory=list)
    """From the question to the verified answer, or to giving up."""

    def as_json(self) -> dict[str, Any]:
        """Return the contract's object; means and rates are None at 0 calls."""
        return {
            "calls": self.calls,
            "tries": self.tries,
            "valid_first": self.valid_first,
            "valid": self.valid,
            "adopted": self.adopted,
            "success_rate": self.valid / self.calls if self.calls else None,
            "mean_tokens_in": _mean(self.tokens_in),
            "mean_tokens_out": _mean(self.tokens_out),
            "mean_latency_s": _mean(self.latencies_s),
        }


@dataclass(slots=True)
class RunTally:
    """Sums over the steps of one run."""

    trace: float = 0.0
    trace_authors: float = 0.0
    errors_m: list[float] = field(default_factory=list)
    solve_s: list[float] = field(default_factory=list)
    rungs: dict[Rung, int] = field(default_factory=lambda: dict.fromkeys(Rung, 0))

    def step(self, snapshot: Snapshot, errors_m: list[float], trace_authors: float) -> None:
        """Count one committed tick; `errors_m` are distances of estimates to the truth."""
        self.trace += snapshot.trace
        self.trace_authors += trace_authors
        self.errors_m.extend(errors_m)
        if snapshot.solve is not None:
            self.solve_s.append(snapshot.solve.solve_s)
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
    ticks = len(tally.solve_s)
    times_ms = 1e3 * np.asarray(tally.solve_s) if ticks else None
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
        "position_error_m": _mean(tally.errors_m),
        "wall_s": wall_s,
        "optimizer": {
            "ticks": ticks,
            "median_ms": None if times_ms is None else float(np.median(times_ms)),
            "p99_ms": None if times_ms is None else float(np.percentile(times_ms, 99)),
            "max_ms": None if times_ms is None else float(times_ms.max()),
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
    """Return what was in force at the end, and the beta(A) of it (paper, eq. 5)."""
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
        "task": _said(receipt.task, receipt.task_reason),
        "action": _said(receipt.action, receipt.action_reason),
    }


def _said(verdict: CommentVerdict | None, reason: str) -> dict[str, str] | None:
    return None if verdict is None else {"verdict": verdict.value, "reason": reason}


def _mean(values: list[float] | list[int]) -> float | None:
    return sum(values) / len(values) if values else None
