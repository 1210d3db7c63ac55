"""The ablation on missions of a few steps: rows, pairing, tables, figures."""

from pathlib import Path

import pytest

from server.experiments.ablation import (
    PAPER_COMMENT,
    Ablation,
    AblationPlan,
    model_names,
    person,
)
from server.experiments.ablation_figures import draw
from server.experiments.campaign import Done, Workers, outcomes
from server.experiments.merit import FIGURES, MERIT, TRACE, figures_of
from server.experiments.missions import MissionTrial
from server.experiments.store import TrialStore
from server.lockstep.job import ScriptedComment
from server.mission.setup import GateMode
from server.scenarios import library
from solver import engines
from tests.server.experiments.pictures import inked

SCENARIO = library.named("ablation").varied(steps=6)
PLAN = AblationPlan(
    scenario=SCENARIO,
    llms=("mock",),
    seeds=(0, 1),
    gate=GateMode.OFF,
    engine=engines.default_engine(),
    comments=(ScriptedComment(0.5, PAPER_COMMENT),),
    trade_off=True,
)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Ablation:
    store = TrialStore(tmp_path_factory.mktemp("ablation"))
    store.open()
    done = [o for o in outcomes(PLAN.trials(), store, Workers()) if isinstance(o, Done)]
    assert len(done) == len(PLAN.trials())
    return Ablation.of(PLAN, done)


def test_every_row_is_flown_under_every_seed(found: Ablation) -> None:
    assert found.rows() == ("without", "exact", "llm-mock", "llm-mock-human")
    assert all(set(row) == {0, 1} for row in found.figures.values())


def test_the_paper_s_person_speaks_less_often_than_the_task_model() -> None:
    whole = library.named("ablation")
    said = person(whole)
    assert [comment.time_s for comment in said] == [10.0, 40.0, 70.0, 100.0, 130.0]
    assert {comment.text for comment in said} == {PAPER_COMMENT}
    assert person(SCENARIO) == ()


def test_the_person_was_heard(found: Ablation) -> None:
    tracking = {
        name: trial.perform()["directives"]["weights"]["tracking"]
        for trial in PLAN.trials()
        if trial.seed == 0 and (name := trial.policy.name).startswith("llm")
    }
    assert tracking["llm-mock-human"] > tracking["llm-mock"]


def test_differences_are_paired_over_seeds(found: Ablation) -> None:
    seeds = [
        found.figures["exact"][seed]["trace"] - found.figures["without"][seed]["trace"]
        for seed in (0, 1)
    ]
    difference = found.difference("exact", "without", TRACE)
    assert difference is not None
    assert difference.mean == pytest.approx(sum(seeds) / 2)
    assert difference.count == 2


def test_the_merit_prices_every_hit_and_knows_no_weights() -> None:
    setup = MissionTrial(PLAN.policies()[0], SCENARIO, 0, GateMode.OFF, "fast").setup()
    result = {
        "accumulated_trace": 1.0,
        "accumulated_trace_authors": 100.0,
        "sensing_attacks": 3,
        "communication_attacks": 2,
        "trajectory_length_m": 10.0,
        "position_error_m": None,
        "steps": 300,
    }
    calm = figures_of(result | {"sensing_attacks": 0, "communication_attacks": 0}, setup)
    assert calm["trace"] == 100.0
    hit = figures_of(result, setup)[MERIT.key]
    sensing = figures_of(result | {"communication_attacks": 0}, setup)[MERIT.key]
    assert 100.0 < calm[MERIT.key] < sensing < hit


def test_the_tables_hold_the_rows(found: Ablation) -> None:
    tables = found.tables()
    assert set(tables) == {"means", "differences", "attribution", "trade-off"}
    means = tables["means"].records()
    assert [row["row"] for row in means] == list(found.rows())
    for row in means:
        assert row["trace"] is not None
        assert row["trace_half_width"] is not None
    gains = [row["gain"] for row in tables["attribution"].records()]
    assert any("optimizer" in str(gain) for gain in gains)
    assert any("person" in str(gain) for gain in gains)
    assert len(tables["trade-off"].rows) == 8
    for table in tables.values():
        heads = table.markdown().splitlines()[0]
        assert all(figure.head in heads for figure in FIGURES)


def test_the_figures_are_pictures(found: Ablation, tmp_path: Path) -> None:
    drawn = draw(found)
    assert set(drawn) == {"ablation", "trade-off"}
    for name, picture in drawn.items():
        (tmp_path / f"{name}.png").write_bytes(picture)
        assert inked(picture) > 0.01, name


def test_a_row_without_runs_is_left_out() -> None:
    empty = Ablation.of(PLAN, [])
    assert empty.rows() == ()
    assert empty.trade_off_table() is None
    assert empty.tables()["means"].rows == []


def test_models_have_names_that_files_can_bear() -> None:
    names = model_names(("mock", "local", "http://127.0.0.1:8081/v1"))
    assert names == ("llm-mock", "llm-local", "llm-endpoint-3")
