"""The filter is as sure as it may be, in short; `benchmarks.estimation` tries it at length."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from scipy.stats import chi2

from benchmarks import estimation
from benchmarks.consistency import Case, filter_settings, flown, reunited
from benchmarks.estimation import broken_promises, gated, main, wild
from solver.beliefs import MotionModel, NearField

EITHER = pytest.mark.parametrize("model", MotionModel)
RUNS, STEPS = 150, 40


@EITHER
@pytest.mark.parametrize("robots", [1, 2, 3])
def test_innovations_from_afar_are_chi_square(model: MotionModel, robots: int) -> None:
    """They are white if the filter is right, so the whole run is one sum of independent ones."""
    found = flown(Case(model, 4.0, robots), RUNS, STEPS)
    size = RUNS * STEPS * 2 * robots
    low, high = chi2.ppf([0.0005, 0.9995], size) / size
    assert low < found.nis < high
    assert found.nis_within > 0.8


@EITHER
@pytest.mark.parametrize("robots", [1, 2])
@pytest.mark.parametrize("distance_m", [6.0, 1.0, 0.35])
def test_errors_are_as_large_as_claimed(model: MotionModel, distance_m: float, robots: int) -> None:
    found = flown(Case(model, distance_m, robots), RUNS, STEPS)
    size = RUNS * (2 if model is MotionModel.RANDOM_WALK else 4)
    low, high = chi2.ppf([0.0005, 0.9995], size) / size
    assert low < found.nees < high
    assert found.error_m == pytest.approx(found.claimed_m, rel=0.1)
    assert found.inside == pytest.approx(0.95, abs=0.025)


def test_a_filter_that_believes_in_calmer_targets_is_found_out() -> None:
    case = Case(MotionModel.RANDOM_WALK, 4.0, 2)
    settings = filter_settings(case)
    calm = replace(settings, process_noise=0.3 * settings.process_noise)
    found = flown(case, RUNS, STEPS, believed=calm)
    size = RUNS * STEPS * 4
    assert found.nis > chi2.ppf(0.9995, size) / size
    assert found.nees > 1.5
    assert broken_promises([found], {}, [])


@EITHER
def test_a_returning_robots_knowledge_is_never_counted_twice(model: MotionModel) -> None:
    """What both knew before they were parted, and the targets' own moves, are in both errors."""
    met = reunited(model, 2.0, RUNS)
    assert met.intersected < 1.0
    assert met.error_m < met.error_team_m
    assert met.added > 1.1, "to take the two for independent would be optimistic"
    assert not broken_promises([], {model.value: [met]}, [])
    assert broken_promises([], {model.value: [replace(met, intersected=1.2)]}, [])


def test_the_gate_lets_truth_in_and_keeps_outliers_out() -> None:
    clean = gated(0.99, 0.0, 300, 40)
    assert clean.true_rejected == pytest.approx(0.01, abs=0.004)
    assert clean.outliers_rejected is None
    open_to_all, shut = gated(None, 0.05, 300, 40), gated(0.9999, 0.05, 300, 40)
    assert shut.true_rejected < 0.001
    assert shut.outliers_rejected is not None
    assert shut.outliers_rejected > 0.7
    assert shut.error_m < 0.85 * open_to_all.error_m


@EITHER
@pytest.mark.parametrize("near_field", NearField)
def test_wild_updates_break_no_covariance(model: MotionModel, near_field: NearField) -> None:
    done: list[int] = []
    survived = wild(model, near_field, 80_000, done.append)
    assert survived.broken == 0
    assert survived.least_ratio > 0.0
    assert done[-1] == survived.updates == 80_000


def test_the_program_tells_what_it_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case(MotionModel.RANDOM_WALK, 3.0, 1)
    monkeypatch.setattr(estimation, "consistency_cases", lambda: [case])
    out = tmp_path / "out.json"
    given = ["--runs", "100", "--steps", "20", "--updates", "4000", "--json", str(out)]
    assert main(given) == 0
    figures = json.loads(out.read_text("utf-8"))
    assert figures["consistency"][0]["nees"] == pytest.approx(1.0, abs=0.15)
    assert set(figures) == {"consistency", "reunions", "gates", "wild"}
    assert "| random_walk | 3 | 1 |" in capsys.readouterr().out


def test_caution_is_a_fault_but_right_above_a_target() -> None:
    above, beside = (
        replace(flown(Case(MotionModel.RANDOM_WALK, d, 1), 20, 5), nees=0.7) for d in (0.1, 1.0)
    )
    assert not broken_promises([above], {}, [])
    assert broken_promises([beside], {}, [])
    assert broken_promises([replace(above, nees=1.4)], {}, [])
