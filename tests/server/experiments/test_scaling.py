import pytest

from server.experiments.campaign import Done
from server.experiments.scaling import WARM_UP, Scaling, ScalingPlan
from solver import engines
from tests.server.experiments.pictures import inked

PLAN = ScalingPlan(largest=6, seeds=(0,), engine=engines.default_engine(), steps=WARM_UP + 5)


@pytest.fixture(scope="module")
def found() -> Scaling:
    return Scaling.of(PLAN, [Done(trial, trial.perform()) for trial in PLAN.trials()])


def test_sizes_double_up_to_the_largest() -> None:
    assert PLAN.sizes() == (2, 4, 6)
    assert ScalingPlan(2, (0,), "fast", 10).sizes() == (2,)
    assert ScalingPlan(1000, (0,), "fast", 10).sizes()[-2:] == (512, 1000)
    assert [trial.layout.robots for trial in PLAN.trials()] == [6, 4, 2], "the longest first"


def test_the_parts_make_the_tick(found: Scaling) -> None:
    for row in found.table().records():
        parts = sum(float(row[f"{part}_ms"] or 0.0) for part in ("estimate", "optimize", "commit"))
        assert parts > 0.0
        # The median of sums is near the sum of medians, and no part is left out or counted twice.
        assert float(row["median_ms"] or 0.0) == pytest.approx(parts, rel=0.5)
        assert float(row["p99_ms"] or 0.0) >= float(row["median_ms"] or 0.0)


def test_warm_up_is_not_counted(found: Scaling) -> None:
    assert {record["ticks"] for times in found.times.values() for record in times} == {5}


def test_table_and_figure(found: Scaling) -> None:
    assert [row["robots"] for row in found.table().records()] == [2, 4, 6]
    assert inked(found.draw()["scaling"]) > 0.01
    assert found.as_json()["tables"]["scaling"][0]["targets"] == 4
