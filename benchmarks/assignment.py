"""The assignment solver beside the best that can be found, and how long it takes.

    python -m benchmarks.assignment --json assignment.json

Small teams: every assignment is priced (brute force). Middling teams: the search for large
teams beside the exact choice of columns. Large teams, where nobody knows the best: beside the
best of a long random search from many starts, told as a distance. And the least repair after
losses, whose time is what a tick has to bear. Times are of the thread's CPU.
"""

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import combinations, product
from pathlib import Path

import numpy as np

from server.cli.progress import progress_bar
from solver.appraisal import Appraisal
from solver.arrays import BoolArray, IntArray, frozen, frozen_bool
from solver.assignment import AssignmentSettings, assign, repair
from solver.directives import Directives, Pairing, Weights
from solver.observations import HoldState, Link
from solver.problem import SensorModel
from solver.prospects import Prospects
from solver.roster import Roster, cover, roster_of
from solver.snapshot import Guidance, RobotTable, Snapshot, TrackStatus, TrackTable

SENSOR = SensorModel()
SETTINGS = AssignmentSettings()
_AREA_PER_ROBOT = 16.0

HEAD = (
    "| robots | targets | capacity | beside | teams | gap median | gap max | best | time (ms) "
    "| longest (ms) | repair (ms) | longest repair (ms) |"
)

SMALL = ((2, 4, 2), (3, 3, 1), (3, 3, 2), (3, 6, 2), (2, 6, 3), (4, 4, 2))
MIDDLING = ((5, 10, 2), (6, 12, 2), (6, 12, 3))
LARGE = ((16, 32, 2), (16, 32, 3), (64, 128, 2), (64, 128, 3))


@dataclass(frozen=True, slots=True)
class Trial:
    """One size of team. Gaps are relative distances of the price from the best one known."""

    robots: int
    targets: int
    capacity: int
    beside: str
    teams: int
    gap_median: float
    gap_max: float
    best_share: float
    """Share of teams for which nothing better is known."""

    median_ms: float
    max_ms: float
    repair_median_ms: float
    repair_max_ms: float


def team_at_work(seed: int, robots: int, targets: int, capacity: int) -> Snapshot:
    """Return a random team of a set density, its targets dealt out at random."""
    rng = np.random.default_rng(seed)
    room = 0.5 * float(np.sqrt(_AREA_PER_ROBOT * robots))
    ids, target_ids = tuple(range(1, robots + 1)), tuple(range(1001, 1001 + targets))
    holders = np.resize(rng.permutation(robots), min(targets, robots * capacity))
    dealt = rng.permutation(target_ids).tolist()
    factors = 0.5 * rng.normal(size=(targets, 2, 2))
    still = frozen(np.zeros((robots, 2)))
    return Snapshot(
        mission="benchmark",
        tick=0,
        time_s=0.0,
        robots=RobotTable(
            ids=ids,
            positions=frozen(rng.uniform(-room, room, size=(robots, 2))),
            velocities=still,
            altitudes=frozen(np.ones(robots)),
            sensing_failed=frozen_bool(np.zeros(robots)),
            links=(Link.CONNECTED,) * robots,
            state_age_s=frozen(np.zeros(robots)),
            setpoint_velocities=still,
            waypoints=still,
        ),
        tracks=TrackTable(
            ids=target_ids,
            positions=frozen(rng.uniform(-room, room, size=(targets, 2))),
            velocities=frozen(0.1 * rng.normal(size=(targets, 2))),
            covariances=frozen(factors @ np.swapaxes(factors, 1, 2) + 0.05 * np.eye(2)),
            unseen_s=frozen(np.zeros(targets)),
            status=(TrackStatus.TRACKED,) * targets,
        ),
        zones=(),
        known=frozen_bool(np.zeros((robots, 0))),
        directives=Directives(
            assignment=frozenset(
                Pairing(ids[i], t) for i, t in zip(holders.tolist(), dealt, strict=False)
            ),
            weights=Weights(10.0, 0.05, 50.0, 50.0),
            capacities=tuple((robot_id, capacity) for robot_id in ids),
        ),
        hold=HoldState.FLYING,
        trace=0.0,
        solve=None,
        attacks=(),
        receipts=(),
        guidance=Guidance.SOLVER,
        guidance_age_s=0.0,
    )


def with_losses(snapshot: Snapshot) -> Snapshot:
    """Return the snapshot after two robots (one, in a team of two) were lost."""
    links = list(snapshot.robots.links)
    links[: min(2, len(links) - 1)] = [Link.LOST] * min(2, len(links) - 1)
    return replace(snapshot, robots=replace(snapshot.robots, links=tuple(links)))


def matrix_of(roster: Roster, pairs: frozenset[Pairing]) -> BoolArray:
    """Return pairs as a matrix (M, N)."""
    row = {robot_id: i for i, robot_id in enumerate(roster.robot_ids)}
    column = {target_id: j for j, target_id in enumerate(roster.target_ids)}
    matrix = np.zeros((len(row), len(column)), dtype=np.bool_)
    for pair in pairs:
        matrix[row[pair.robot_id], column[pair.target_id]] = True
    return matrix


def brute_force(roster: Roster, appraisal: Appraisal) -> float:
    """Return the least price of all assignments."""
    targets = range(len(roster.target_ids))
    rows = [
        [s for size in range(capacity + 1) for s in combinations(targets, size)]
        for capacity in roster.capacity.tolist()
    ]
    matrices = np.zeros((int(np.prod([len(r) for r in rows])), *roster.current.shape), np.bool_)
    for at, sets in enumerate(product(*rows)):
        for i, chosen in enumerate(sets):
            matrices[at, i, list(chosen)] = True
    return min(
        float(appraisal.prices(matrices[at : at + 2000]).min())
        for at in range(0, len(matrices), 2000)
    )


def long_search(
    roster: Roster,
    appraisal: Appraisal,
    start: BoolArray,
    near: IntArray,
    rounds: int,
    seed: int,
) -> float:
    """Return the least price that simulated annealing meets on its way from a matrix.

    Args:
        roster: Who may track what.
        appraisal: What matrices cost.
        start: Matrix (M, N).
        near: (M, K) robots near each robot: only they exchange anything.
        rounds: Changes tried.
        seed: Of the dice.
    """
    rng = np.random.default_rng(seed)
    matrix, price = start.copy(), float(appraisal.prices(start[None])[0])
    best = price
    heat = 0.01 * price / max(1, len(roster.target_ids))
    for k in range(rounds):
        trial = _neighbour(matrix, near, rng)
        if (trial.sum(axis=1) > roster.capacity).any() or not trial.any(axis=0).all():
            continue
        new = float(appraisal.prices(trial[None])[0])
        cooled = heat * (1.0 - k / rounds)
        if new < price or rng.random() < np.exp(-(new - price) / max(cooled, 1e-12)):
            matrix, price = trial, new
            best = min(best, price)
    return best


def _neighbour(matrix: BoolArray, near: IntArray, rng: np.random.Generator) -> BoolArray:
    """Return the matrix after one change at random: two robots near each other deal anew."""
    trial = matrix.copy()
    i = int(rng.integers(len(matrix)))
    k = int(rng.choice(near[i]))
    ours, theirs = np.flatnonzero(matrix[i] & ~matrix[k]), np.flatnonzero(matrix[k] & ~matrix[i])
    kind = rng.random()
    if len(ours) and kind < 0.8:
        given = int(rng.choice(ours))
        trial[i, given], trial[k, given] = False, True
    if len(theirs) and kind > 0.2:
        taken = int(rng.choice(theirs))
        trial[i, taken] = True
        # Mostly an exchange; otherwise the target gets a second robot.
        trial[k, taken] = kind > 0.9
    return trial


def neighbourhoods(snapshot: Snapshot) -> IntArray:
    """Return (M, 8) the robots nearest to each robot."""
    x = snapshot.robots.positions
    gap = np.linalg.norm(x[:, None] - x[None], axis=-1)
    np.fill_diagonal(gap, np.inf)
    return np.argsort(gap, axis=1)[:, : min(8, len(x) - 1)]


def measure(
    shape: tuple[int, int, int],
    beside: str,
    teams: int,
    best: Callable[[Snapshot, Roster, Appraisal, BoolArray], float],
    settings: AssignmentSettings = SETTINGS,
) -> Trial:
    """Assign and repair random teams of one size, each beside the best price known of it."""
    gaps, taken, repaired = [], [], []
    assign(team_at_work(0, *shape), SENSOR, settings)
    for seed in range(teams):
        snapshot = team_at_work(seed, *shape)
        began = time.thread_time()
        pairs = assign(snapshot, SENSOR, settings)
        taken.append(1e3 * (time.thread_time() - began))
        shaken = with_losses(snapshot)
        began = time.thread_time()
        mended = repair(shaken)
        repaired.append(1e3 * (time.thread_time() - began))
        _check_cover(shaken, mended)
        roster = roster_of(snapshot)
        appraisal = Appraisal(roster, Prospects(snapshot, roster, SENSOR, SETTINGS), SETTINGS)
        found = matrix_of(roster, pairs)
        price = float(appraisal.prices(found[None])[0])
        gaps.append(price / min(price, best(snapshot, roster, appraisal, found)) - 1.0)
    return Trial(
        *shape,
        beside=beside,
        teams=teams,
        gap_median=statistics.median(gaps),
        gap_max=max(gaps),
        best_share=statistics.fmean(gap < 1e-9 for gap in gaps),
        median_ms=statistics.median(taken),
        max_ms=max(taken),
        repair_median_ms=statistics.median(repaired),
        repair_max_ms=max(repaired),
    )


def _check_cover(snapshot: Snapshot, pairs: frozenset[Pairing]) -> None:
    """Raise RuntimeError when a repair leaves out what there is room for."""
    roster = roster_of(snapshot)
    held, _ = cover(roster, matrix_of(roster, pairs))
    if held < min(len(roster.target_ids), int(roster.capacity.sum())):
        raise RuntimeError(f"a repair covers {held} targets only")


def table(trials: list[Trial]) -> str:
    """Return Markdown."""
    lines = [HEAD, "|" + " --- |" * (HEAD.count("|") - 1)]
    lines += [
        f"| {t.robots} | {t.targets} | {t.capacity} | {t.beside} | {t.teams} "
        f"| {100 * t.gap_median:.2f} % | {100 * t.gap_max:.2f} % | {100 * t.best_share:.0f} % "
        f"| {t.median_ms:.1f} | {t.max_ms:.1f} | {t.repair_median_ms:.2f} "
        f"| {t.repair_max_ms:.2f} |"
        for t in trials
    ]
    return "\n".join(lines)


def main(given: list[str]) -> int:
    """Measure all sizes, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.assignment", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--teams", type=int, default=20, help="random teams per small size")
    parser.add_argument("--large", type=int, default=4, help="random teams per large size")
    parser.add_argument("--rounds", type=int, default=20_000, help="of the long search")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    asked = parser.parse_args(given)

    def exact(snapshot: Snapshot, roster: Roster, appraisal: Appraisal, _: BoolArray) -> float:
        pairs = assign(snapshot, SENSOR, SETTINGS)
        return float(appraisal.prices(matrix_of(roster, pairs)[None])[0])

    def searched(shot: Snapshot, roster: Roster, appraisal: Appraisal, found: BoolArray) -> float:
        near = neighbourhoods(shot)
        return min(
            long_search(roster, appraisal, found, near, asked.rounds, seed) for seed in range(2)
        )

    trials: list[Trial] = []
    by_search = replace(SETTINGS, most_columns=0)
    with progress_bar("sizes", len(SMALL) + len(MIDDLING) + len(LARGE)) as progress:
        for shape in SMALL:
            trials.append(
                measure(shape, "brute force", asked.teams, lambda _, r, a, __: brute_force(r, a))
            )
            progress(len(trials))
        for shape in MIDDLING:
            trials.append(measure(shape, "exact columns", asked.teams, exact, by_search))
            progress(len(trials))
        for shape in LARGE:
            trials.append(measure(shape, "long search", asked.large, searched))
            progress(len(trials))
    sys.stdout.write(table(trials) + "\n")
    if asked.json:
        records = [asdict(trial) for trial in trials]
        asked.json.write_text(json.dumps(records, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
