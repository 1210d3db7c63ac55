"""The grid of questions: what is asked, what is counted, what is drawn."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from llm.chat import ChatReply, ChatRequest, ErrorKind, ModelError
from llm.styles import Examples
from server.experiments import questions
from server.experiments.campaign import Done
from server.experiments.questions import QuestionTrial
from server.experiments.reasoning import CellKey, Reasoning, ReasoningPlan, Score
from server.experiments.reasoning_figures import draw
from server.experiments.trials import key_of
from server.models import Manner
from solver import engines
from tests.server.experiments.pictures import inked

PLAN = ReasoningPlan(("mock",), ("mock",), (0,), engines.default_engine())


class Scripted:
    """A model that gives prepared answers and keeps what it was asked."""

    def __init__(self, *answers: str | ModelError) -> None:
        self.answers = list(answers)
        self.asked: list[ChatRequest] = []

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        self.asked.append(request)
        answer = self.answers[min(len(self.asked), len(self.answers)) - 1]
        if isinstance(answer, ModelError):
            raise answer
        return ChatReply(answer, tokens_in=100, tokens_out=10, latency_s=0.5)


def _performed(monkeypatch: pytest.MonkeyPatch, model: Scripted) -> list[dict[str, Any]]:
    @asynccontextmanager
    async def opened(*_: object, **__: object) -> AsyncIterator[Scripted]:
        yield model

    monkeypatch.setattr(questions, "open_model", opened)
    trial = replace(PLAN.trials()[0], llm="http://127.0.0.1:9/v1")
    answers: list[dict[str, Any]] = trial.perform()["answers"]
    return answers


def test_the_grid_is_the_papers() -> None:
    trials = PLAN.trials()
    assert sorted({(t.layout.targets / t.layout.robots, t.layout.zones) for t in trials}) == [
        (load, zones) for load in (0.5, 1.0, 2.0) for zones in (2, 4, 8)
    ]
    assert {t.layout.capacity for t in trials} == {3}
    assert len({key_of(trial) for trial in trials}) == 9


def test_a_situation_is_a_flown_one_with_every_zone_known() -> None:
    trial = PLAN.trials()[-1]
    view = asyncio.run(trial.situation(Manner()))
    snapshot = view.snapshot
    assert len(snapshot.zones) == 8
    assert snapshot.known.all()
    assert len(view.history) == 5
    assert snapshot.time_s == pytest.approx((trial.layout.steps - 1) * trial.layout.tick_s)


@pytest.fixture(scope="module")
def found() -> Reasoning:
    trials = [t for t in PLAN.trials() if t.layout.zones in (2, 8)]
    return Reasoning.of(PLAN, [Done(trial, trial.perform()) for trial in trials])


def test_the_mock_answers_every_cell_validly(found: Reasoning) -> None:
    cells = list(found.cells())
    assert len(cells) == 2 * 6, "with and without an example"
    for _, task, action in cells:
        for score in (task, action):
            assert (score.valid_first, score.valid, score.well_formed) == (100.0, 100.0, 100.0)
            assert score.tokens_out > 0


def test_an_example_in_the_prompt_costs_tokens(found: Reasoning) -> None:
    by_cell = {key: task for key, task, _ in found.cells()}
    for targets, zones in ((2, 2), (8, 8)):
        without = by_cell[CellKey("mock", Examples.WITHOUT.value, targets, zones)]
        worked = by_cell[CellKey("mock", Examples.WITH.value, targets, zones)]
        assert worked.tokens_in > without.tokens_in + 20


def test_more_targets_take_more_tokens(found: Reasoning) -> None:
    by_cell = {key: task for key, task, _ in found.cells()}
    few = by_cell[CellKey("mock", Examples.WITHOUT.value, 2, 2)]
    many = by_cell[CellKey("mock", Examples.WITHOUT.value, 8, 2)]
    assert many.tokens_out > few.tokens_out


def test_tables_and_figure(found: Reasoning) -> None:
    tables = found.tables()
    assert len(tables["summary"].rows) == 4
    assert len(tables["task"].rows) == len(tables["action"].rows) == 12
    json.dumps(found.as_json(), allow_nan=False)
    assert inked(draw(found)["reasoning"]) > 0.01


def test_retries_and_unreadable_answers_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    good = '{"assignment": {"0": [0, 1], "1": [0, 1], "2": [0, 1], "3": [0, 1]}, "feedback": "."}'
    model = Scripted("I would rather not say.", '{"assignment": {"0": []}, "feedback": "."}', good)
    answers = _performed(monkeypatch, model)
    first = answers[0]
    assert (first["loop"], first["valid_first"], first["valid"]) == ("task", False, True)
    assert (first["tries"], first["well_formed"]) == (3, 2)
    assert (first["tokens_in"], first["tokens_out"]) == (300, 30)
    score = Score.of([first])
    assert (score.valid_first, score.valid) == (0.0, 100.0)
    assert score.well_formed == pytest.approx(200 / 3)
    assert (score.tokens_in, score.tokens_out, score.latency_s) == (100.0, 10.0, 0.5)
    # The same answer is no answer for the action model: it is given up after its tries.
    action = next(a for a in answers if a["loop"] == "action")
    assert (action["valid"], action["tries"]) == (False, 3)


def test_a_silent_model_is_counted_as_invalid(monkeypatch: pytest.MonkeyPatch) -> None:
    model = Scripted(ModelError(ErrorKind.TIMEOUT, "no answer within 8 s"))
    answers = _performed(monkeypatch, model)
    assert {(a["valid"], a["well_formed"]) for a in answers} == {(False, 0)}
    assert Score.of(answers).well_formed == 0.0


def test_what_cannot_be_asked_fails_the_trial() -> None:
    trial = replace(PLAN.trials()[0], llm="none")
    assert isinstance(trial, QuestionTrial)
    with pytest.raises(ValueError, match="no model"):
        trial.perform()
