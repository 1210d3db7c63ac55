"""How well models reason (paper, section IV-A2): task load by number of zones.

Four robots of capacity 3; 2, 4 and 8 targets (loads 0.5, 1 and 2) among 2, 4 and 8 zones; with
and without a worked example in the prompt. A situation is generated from its seed and flown
for a while, so that the prompt holds what prompts hold. Both models are asked, and refused
answers are tried again, exactly as in a mission.
"""

import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from llm.styles import Examples, Loop
from server.experiments.campaign import Done
from server.experiments.generation import Layout
from server.experiments.questions import QuestionTrial
from server.experiments.tables import Cell, Column, Table

ROBOTS = 4
CAPACITY = 3
TARGETS = (2, 4, 8)
ZONES = (2, 4, 8)

Answer = dict[str, Any]


@dataclass(frozen=True, slots=True)
class ReasoningPlan:
    """What is asked."""

    llms: tuple[str, ...]
    names: tuple[str, ...]
    """Of the models, for tables and files."""

    seeds: tuple[int, ...]
    engine: str

    @property
    def title(self) -> str:
        """What the report is called."""
        return "Reasoning of the models"

    @property
    def notes(self) -> str:
        """What a reader of the tables should know."""
        rule_model = " The mock is a rule model, no language model." * ("mock" in self.llms)
        return (
            f"{ROBOTS} robots of capacity {CAPACITY}, {len(self.seeds)} situations per cell. "
            "An answer is valid when it passes verification: at once, or after the retries of "
            f"a mission. Tokens and latency are those of one request.{rule_model}"
        )

    def trials(self) -> list[QuestionTrial]:
        """Return every situation for every model."""
        return [
            QuestionTrial(llm, name, Layout(ROBOTS, targets, zones, CAPACITY), seed, self.engine)
            for seed in self.seeds
            for llm, name in zip(self.llms, self.names, strict=True)
            for targets in TARGETS
            for zones in ZONES
        ]


@dataclass(frozen=True, slots=True, order=True)
class CellKey:
    """One cell of the grid for one model and one kind of prompt."""

    name: str
    examples: str
    targets: int
    zones: int

    @property
    def load(self) -> float:
        """Targets per robot."""
        return self.targets / ROBOTS


@dataclass(frozen=True, slots=True)
class Score:
    """What one loop's answers in a cell came to; shares in percent."""

    calls: int
    valid_first: float
    valid: float
    well_formed: float
    """Of all answers, retries included."""

    tokens_in: float
    tokens_out: float
    latency_s: float
    """Per request."""

    @classmethod
    def of(cls, answers: Sequence[Answer]) -> "Score":
        """Count a cell's answers, at least one."""
        tries = sum(answer["tries"] for answer in answers)
        return cls(
            calls=len(answers),
            valid_first=100.0 * statistics.fmean(a["valid_first"] for a in answers),
            valid=100.0 * statistics.fmean(a["valid"] for a in answers),
            well_formed=100.0 * sum(a["well_formed"] for a in answers) / tries,
            tokens_in=sum(a["tokens_in"] for a in answers) / tries,
            tokens_out=sum(a["tokens_out"] for a in answers) / tries,
            latency_s=sum(a["latency_s"] for a in answers) / tries,
        )


@dataclass(frozen=True, slots=True)
class Reasoning:
    """The answers by cell and loop, and the tables made of them."""

    plan: ReasoningPlan
    answers: dict[CellKey, dict[str, list[Answer]]]

    @classmethod
    def of(cls, plan: ReasoningPlan, finished: Iterable[Done]) -> "Reasoning":
        """Gather what was answered."""
        answers: dict[CellKey, dict[str, list[Answer]]] = {}
        for done in finished:
            trial = done.trial
            if not isinstance(trial, QuestionTrial):
                continue
            for answer in done.result["answers"]:
                layout = trial.layout
                key = CellKey(trial.name, answer["examples"], layout.targets, layout.zones)
                answers.setdefault(key, {}).setdefault(answer["loop"], []).append(answer)
        return cls(plan, answers)

    def cells(self) -> Iterator[tuple[CellKey, Score, Score]]:
        """Yield every cell with its scores of the task and the action model, in order."""
        for name in self.plan.names:
            for key in sorted(key for key in self.answers if key.name == name):
                task, action = (Score.of(self.answers[key][loop.value]) for loop in Loop)
                yield key, task, action

    def grid_table(self, loop: Loop) -> Table:
        """Return one half of the paper's figure as a table: one row per cell."""
        rows: list[dict[str, Cell]] = [
            _cell(key) | _score(task if loop is Loop.TASK else action)
            for key, task, action in self.cells()
        ]
        return Table(f"The {loop.value} model by cell", (*_CELL_COLUMNS, *_SCORE_COLUMNS), rows)

    def summary_table(self) -> Table:
        """Return each model's figures over the whole grid."""
        rows: list[dict[str, Cell]] = []
        for name in self.plan.names:
            for examples in Examples:
                keys = [k for k in self.answers if (k.name, k.examples) == (name, examples.value)]
                if not keys:
                    continue
                for loop in Loop:
                    every = [answer for key in keys for answer in self.answers[key][loop.value]]
                    row: dict[str, Cell] = {"model": name, "examples": examples.value}
                    rows.append(row | {"loop": loop.value} | _score(Score.of(every)))
        columns = (*_CELL_COLUMNS[:2], Column("loop", "loop"), *_SCORE_COLUMNS)
        return Table("Over the whole grid", columns, rows)

    def tables(self) -> dict[str, Table]:
        """Return every table by the name of its file."""
        return {
            "summary": self.summary_table(),
            **{loop.value: self.grid_table(loop) for loop in Loop},
        }

    def as_json(self) -> dict[str, Any]:
        """Return what was asked and every table as plain records."""
        return {
            "experiment": "reasoning",
            "models": dict(zip(self.plan.names, self.plan.llms, strict=True)),
            "seeds": list(self.plan.seeds),
            "robots": ROBOTS,
            "capacity": CAPACITY,
            "tables": {name: table.records() for name, table in self.tables().items()},
        }


_CELL_COLUMNS = (
    Column("model", "model"),
    Column("examples", "example"),
    Column("load", "load", 1),
    Column("zones", "zones"),
)
_SCORE_COLUMNS = (
    Column("calls", "calls"),
    Column("valid_first", "valid at once (%)", 0),
    Column("valid", "valid (%)", 0),
    Column("well_formed", "well formed (%)", 0),
    Column("tokens_in", "tokens in", 0),
    Column("tokens_out", "tokens out", 0),
    Column("latency_s", "latency (s)", 2),
)


def _cell(key: CellKey) -> dict[str, Cell]:
    return {"model": key.name, "examples": key.examples, "load": key.load, "zones": key.zones}


def _score(score: Score) -> dict[str, Cell]:
    return {column.key: getattr(score, column.key) for column in _SCORE_COLUMNS}
