"""The harness of mission quality: what it counts, and what it holds it against."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import ttest_1samp

from benchmarks.flights import Commands, Job, Run, Separations, changed, fly
from benchmarks.quality import (
    arguments,
    authors_figures,
    bars,
    main,
    mean_and_half_width,
    summary,
    table,
)
from benchmarks.sweep import write_csv
from server.mission.core import MissionCore
from server.scenarios import library
from solver.observations import Link, LinkChange
from solver.zones import Point
from tests.server.builders import mission_setup, straight_solution
from vehicles.world.state import Failures, TrueRobot, Truth

FINE = Failures(sensing=False, communication=False)


def truth(*positions: Point) -> Truth:
    robots = tuple(
        TrueRobot(21 + i, position, (0.0, 0.0), 1.0, FINE) for i, position in enumerate(positions)
    )
    return Truth(time_s=0.0, step=0, robots=robots, targets=(), zones=())


def run(seed: int, trace: float, scenario: str = "exp4") -> Run:
    return Run(scenario, seed, trace - 1.0, trace, 12, 4, 30.0, 0.07, None, 0.5, 0.3, 0.2)


def test_only_pairs_that_were_apart_while_connected_count_as_too_close() -> None:
    core = MissionCore(mission_setup())
    core.commit(straight_solution(core.begin(0.0)))
    watch = Separations(0.4)
    watch.look(core.snapshot, truth((0.0, 0.0), (0.3, 0.0)))
    assert watch.closest_m == float("inf"), "they started close"
    watch.look(core.snapshot, truth((0.0, 0.0), (0.5, 0.0)))
    watch.look(core.snapshot, truth((0.0, 0.0), (0.4, 0.0)))
    assert watch.closest_m == float("inf")
    watch.look(core.snapshot, truth((0.0, 0.0), (0.0, 0.35)))
    assert watch.closest_m == pytest.approx(0.35)


def test_a_jammed_robot_may_come_close_and_return_close() -> None:
    core = MissionCore(mission_setup())
    core.commit(straight_solution(core.begin(0.0)))
    watch = Separations(0.4)
    watch.look(core.snapshot, truth((0.0, 0.0), (0.5, 0.0)))
    for tick, link in enumerate((Link.JAMMED, Link.CONNECTED), start=1):
        core.observe(LinkChange(21, link, "test"))
        core.commit(straight_solution(core.begin(0.1 * tick)))
        watch.look(core.snapshot, truth((0.0, 0.0), (0.1, 0.0)))
    assert watch.closest_m == float("inf")


def test_intervals_are_students() -> None:
    values = [3.0, 5.0, 4.5, 7.0]
    mean, half = mean_and_half_width(values)
    interval = ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (mean - half, mean + half) == pytest.approx((interval.low, interval.high))
    assert np.isnan(mean_and_half_width([1.0])[1])


def test_the_bar_is_a_quarter_of_the_way_to_the_attack_free_trace() -> None:
    theirs = authors_figures()["exp4"]
    assert len(theirs["trace_authors"]) == 20
    limits = bars("exp4", theirs)
    assert limits["trace_authors"] == pytest.approx(0.75 * 119.52 + 0.25 * 88.1, abs=0.01)
    assert limits["sensing_attacks"] == pytest.approx(24.475)
    assert limits["position_error_m"] == pytest.approx(0.203, abs=0.001)


def test_a_bar_is_met_at_the_intervals_upper_end_by_the_mean_only_or_not() -> None:
    for traces, met, mark in (
        ((100.0, 101.0, 102.0), "yes", " "),
        ((90.0, 100.0, 130.0), "mean", " * "),
        ((120.0, 121.0, 122.0), "no", " ! "),
    ):
        rows = summary([run(seed, trace) for seed, trace in enumerate(traces)])
        assert rows[0]["trace_authors_met"] == met
        assert f"{mark}(119.5, bar 111.7)" in table(rows)
    foreign = summary([run(0, 5.0, "ours"), run(1, 7.0, "ours")])
    assert foreign[0]["trace_authors"] == 6.0
    assert foreign[0]["trace"] == 5.0
    assert "trace_authors_bar" not in foreign[0]


def test_a_run_is_flown_with_what_was_asked_for_and_written(tmp_path: Path) -> None:
    paper = (
        ("planner.horizon", 1),
        ("planner.sensing_failure_s", 0.0),
        ("planner.communication_failure_s", 0.0),
    )
    usual = fly(Job("ablation", 3, paper))
    lazy = fly(Job("ablation", 3, (*paper, ("weights.control", 5.0))))
    assert usual.scenario == "ablation"
    assert usual.seed == 3
    assert usual.trace > 80.0
    assert lazy.trajectory_length_m < usual.trajectory_length_m
    assert lazy.turning < usual.turning
    assert lazy.saturated < usual.saturated
    write_csv(tmp_path / "out.csv", [usual, lazy])
    lines = (tmp_path / "out.csv").read_text("utf-8").splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("scenario,seed,trace")


def test_what_a_scenario_cannot_have_is_refused() -> None:
    scenario = library.load("ablation")
    assert changed(scenario, (("filter.near_field", "moments"),)) != scenario
    with pytest.raises(ValidationError, match="horizont"):
        changed(scenario, (("planner.horizont", 1),))


def test_moves_at_the_bound_and_turns_are_counted() -> None:
    scenario = library.load("ablation")  # steps of 0.5 s, 0.5 m/s per axis
    watch = Commands(scenario)
    for place in ((0.0, 0.0), (0.25, 0.0), (0.25, 0.1), (0.25, 0.2)):
        robot = TrueRobot(0, place, (0.0, 0.0), 1.0, FINE)
        watch.look(Truth(time_s=0.0, step=0, robots=(robot,), targets=(), zones=()))
    assert watch.saturated == pytest.approx(1.0 / 3.0)
    assert watch.turning == pytest.approx(0.5 * np.hypot(0.5, 0.2))


def test_the_program_prints_a_table_and_writes_a_summary(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.json"
    given = ["ablation", "--seeds", "2", "--first-seed", "7", "--profile", "falconer"]
    assert main([*given, "--set", "steps=4", "--json", str(out)]) == 0
    assert "| ablation | " in capsys.readouterr().out
    (row,) = json.loads(out.read_text("utf-8"))
    assert (row["scenario"], row["seeds"]) == ("ablation", 2)
    with pytest.raises(SystemExit):
        arguments(["ablation", "--set", "steps"])
