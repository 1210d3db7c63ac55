"""The harness of mission quality: what it counts, and what it holds it against."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from benchmarks.quality import (
    Job,
    Run,
    Separations,
    authors_figures,
    bars,
    fly,
    mean_and_half_width,
    summary,
    table,
    write,
)
from server.mission.core import MissionCore
from solver.directives import Weights
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
    return Run(scenario, seed, trace, 12, 4, 30.0, 0.07, None, 0.2)


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
    assert len(theirs["trace"]) == 20
    limits = bars("exp4", theirs)
    assert limits["trace"] == pytest.approx(0.75 * 119.52 + 0.25 * 88.1, abs=0.01)
    assert limits["sensing_attacks"] == pytest.approx(24.475)
    assert limits["position_error_m"] == pytest.approx(0.203, abs=0.001)


def test_a_bar_is_met_at_the_intervals_upper_end_by_the_mean_only_or_not() -> None:
    for traces, met, mark in (
        ((100.0, 101.0, 102.0), "yes", " "),
        ((90.0, 100.0, 130.0), "mean", " * "),
        ((120.0, 121.0, 122.0), "no", " ! "),
    ):
        rows = summary([run(seed, trace) for seed, trace in enumerate(traces)])
        assert rows[0]["trace_met"] == met
        assert f"{mark}(119.5, bar 111.7)" in table(rows)
    foreign = summary([run(0, 5.0, "ours"), run(1, 7.0, "ours")])
    assert foreign[0]["trace"] == 6.0
    assert "trace_bar" not in foreign[0]


def test_a_run_is_flown_with_what_was_asked_for_and_written(tmp_path: Path) -> None:
    changes = (("horizon", 1.0), ("sensing_failure_s", 0.0), ("communication_failure_s", 0.0))
    weights = Weights(10.0, 5.0, 50.0, 50.0)
    usual, lazy = (fly(Job("ablation", 3, changes, w)) for w in (None, weights))
    assert usual.scenario == "ablation"
    assert usual.seed == 3
    assert usual.trace > 80.0
    assert lazy.trajectory_length_m < usual.trajectory_length_m
    write(tmp_path / "out", [usual, lazy], summary([usual, lazy]))
    lines = (tmp_path / "out.csv").read_text("utf-8").splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("scenario,seed,trace")
    assert '"scenario": "ablation"' in (tmp_path / "out.json").read_text("utf-8")
