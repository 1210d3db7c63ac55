"""The programs that measure: small runs, and that the document has a place for every part."""

import numpy as np
import pytest

from benchmarks import agreement, core, performance
from solver import engines
from solver.objective import exact_cost


def test_the_document_has_a_place_for_every_part() -> None:
    document = performance.DOCUMENT.read_text(encoding="utf-8")
    for part in performance.PARTS:
        once = performance.inserted(document, part, "figures")
        assert performance.inserted(once, part, "figures") == once
        assert once.count("\nfigures\n") == 1


def test_a_part_without_a_place_is_refused() -> None:
    with pytest.raises(ValueError, match="no markers of core"):
        performance.inserted("nothing here", "core", "figures")


@pytest.mark.timeout(900)
def test_a_crowd_of_any_size_flies() -> None:
    tick = core.flown(core.crowd(6, 12), steps=4)
    assert (tick.robots, tick.targets, tick.ticks) == (6, 12, 4)
    assert 0.0 < tick.solve_median_ms < tick.median_ms <= tick.max_ms


@pytest.mark.timeout(900)
def test_recorded_ticks_are_compared_with_the_best_of_the_starts() -> None:
    source = agreement.Source("2, 2", 1, (2, 2))
    found = [
        agreement.referenced(agreement.Tick("generated", problem))
        for problem in agreement.recorded(source, 3)
    ]
    assert len(found) == 3
    for tick in found:
        assert tick.controls is not None
        assert tick.best == pytest.approx(exact_cost(tick.problem, tick.controls))
    values = agreement.gaps(found, engines.create("fast"))
    assert max(values) <= agreement.LIMIT
    assert "| all | 3 | 100.0 % |" in agreement.table(found, values)


def test_an_interrupted_comparison_goes_on_where_it_was() -> None:
    source = agreement.Source("2, 2", 1, (2, 2))
    found = [agreement.Tick("generated", problem) for problem in agreement.recorded(source, 3)]
    kept: list[int] = []

    def keep(ticks: list[agreement.Tick]) -> None:
        kept.append(sum(tick.best is not None for tick in ticks))

    agreement.complete(found, 2, 1, keep)
    first = [tick.best for tick in found[:2]]
    agreement.complete(found, 2, 1, keep)
    assert kept == [2, 3]
    assert [tick.best for tick in found[:2]] == first
    assert np.isfinite([tick.best or np.nan for tick in found]).all()
