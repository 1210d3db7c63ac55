"""The benchmark of assignments: what it calls the best, and what it prints."""

import json
from pathlib import Path

import pytest

from benchmarks import assignment
from benchmarks.assignment import (
    SENSOR,
    SETTINGS,
    brute_force,
    long_search,
    main,
    matrix_of,
    measure,
    neighbourhoods,
    team_at_work,
    with_losses,
)
from solver.appraisal import Appraisal
from solver.assignment import assign
from solver.observations import Link
from solver.prospects import Prospects
from solver.roster import roster_of


def test_small_teams_get_what_brute_force_finds() -> None:
    trial = measure((2, 4, 2), "brute force", 3, lambda _, r, a, __: brute_force(r, a))
    assert trial.gap_max < 1e-9
    assert trial.best_share == 1.0
    assert trial.repair_max_ms > 0.0


def test_a_long_search_finds_the_best_from_a_bad_start() -> None:
    snapshot = team_at_work(3, 3, 6, 2)
    roster = roster_of(snapshot)
    appraisal = Appraisal(roster, Prospects(snapshot, roster, SENSOR, SETTINGS), SETTINGS)
    near = neighbourhoods(snapshot)
    found = long_search(roster, appraisal, roster.current, near, 600, 0)
    assert found == pytest.approx(brute_force(roster, appraisal), rel=1e-9)
    ours = matrix_of(roster, assign(snapshot, SENSOR, SETTINGS))
    assert float(appraisal.prices(ours[None])[0]) == pytest.approx(found, rel=1e-9)


def test_two_robots_are_lost_but_never_all() -> None:
    assert with_losses(team_at_work(0, 4, 8, 2)).robots.links.count(Link.LOST) == 2
    assert with_losses(team_at_work(0, 2, 4, 2)).robots.links.count(Link.LOST) == 1


def test_the_program_prints_a_table_and_writes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assignment, "SMALL", ((2, 3, 2),))
    monkeypatch.setattr(assignment, "MIDDLING", ((4, 8, 2),))
    monkeypatch.setattr(assignment, "LARGE", ((6, 12, 2),))
    out = tmp_path / "out.json"
    given = ["--teams", "2", "--large", "1", "--rounds", "50", "--json", str(out)]
    assert main(given) == 0
    rows = json.loads(out.read_text("utf-8"))
    assert [row["beside"] for row in rows] == ["brute force", "exact columns", "long search"]
    assert all(0.0 <= row["gap_max"] < 0.1 for row in rows)
    assert "| 2 | 3 | 2 | brute force | 2 |" in capsys.readouterr().out
