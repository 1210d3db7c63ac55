"""What the optimizer, the assignment solver, a model and a person are worth (paper, Table I).

Rows by seeds: nobody advises, our own assignment solver, each model, each model with a person
who comments. Every row meets the same worlds, so rows are compared by differences per seed.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from server.experiments.campaign import Done
from server.experiments.merit import COMMUNICATION, FIGURES, SENSING, Figure, figures_of
from server.experiments.missions import MissionTrial, PlannerChange, Policy
from server.experiments.statistics import Estimate, estimate, paired
from server.experiments.tables import Cell, Column, Table
from server.lockstep.job import PAPER_LATENCY, Latency, ScriptedComment
from server.mission.setup import GateMode
from server.models import EXACT, NOBODY
from server.scenarios.schema import Scenario
from solver.directives import Weights

PAPER_COMMENT = "Focus more on tracking targets; The trace is not good."
PERIODS_BETWEEN_COMMENTS = 3
"""The paper's person speaks "at a lower frequency" than the models: after the first period of
the task model, and then at every third, so that they can adapt in between."""

SAFETY_FACTORS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0)
"""On both weights of safety, for the trade-off between trace and attacks."""

PAPER_PROBLEM = "paper-problem"
WITHOUT = "without"
SOLVER = "exact"
TRADE_OFF = "safety-"


@dataclass(frozen=True, slots=True)
class AblationPlan:
    """What is flown."""

    scenario: Scenario
    llms: tuple[str, ...]
    seeds: tuple[int, ...]
    gate: GateMode
    engine: str
    comments: tuple[ScriptedComment, ...]
    """What the person says, and when."""

    latency: Latency = PAPER_LATENCY
    trade_off: bool = False
    """Also fly the assignment solver with other weights of safety."""

    @property
    def title(self) -> str:
        """What the report is called."""
        return f"Ablation on {self.scenario.name}"

    @property
    def notes(self) -> str:
        """What a reader of the tables should know."""
        said = ", ".join(f"{comment.time_s:g} s" for comment in self.comments) or "never"
        texts = " / ".join(dict.fromkeys(f'"{comment.text}"' for comment in self.comments))
        rule_model = " The mock is a rule model, no language model." * ("mock" in self.llms)
        return (
            f"{len(self.seeds)} seeds, {self.scenario.steps} steps of {self.scenario.tick_s:g} s, "
            f"engine {self.engine}, gate {self.gate.value}. The person says {texts} at {said}. "
            "Merit is the gate's yardstick on what happened, as an accumulated trace."
            f"{rule_model}"
        )

    def policies(self) -> tuple[Policy, ...]:
        """Return the rows: baselines, then each model without and with the person."""
        rows = [
            Policy(PAPER_PROBLEM, NOBODY, planner=PlannerChange(horizon=1, priced=False)),
            Policy(WITHOUT, NOBODY),
            Policy(SOLVER, EXACT),
        ]
        for name, llm in zip(model_names(self.llms), self.llms, strict=True):
            rows += [Policy(name, llm), Policy(with_person(name), llm, self.comments)]
        if self.trade_off:
            rows += [
                Policy(f"{TRADE_OFF}{factor:g}", EXACT, weights=self._safer(factor))
                for factor in SAFETY_FACTORS
            ]
        return tuple(rows)

    def trials(self) -> list[MissionTrial]:
        """Return every run, seed by seed, so that a part of them can be compared already."""
        return [
            MissionTrial(policy, self.scenario, seed, self.gate, self.engine, self.latency)
            for seed in self.seeds
            for policy in self.policies()
        ]

    def _safer(self, factor: float) -> Weights:
        weights = self.scenario.weights.weights()
        return weights._replace(
            sensing=factor * weights.sensing, communication=factor * weights.communication
        )


def person(scenario: Scenario) -> tuple[ScriptedComment, ...]:
    """Return what the paper's person says, and when, until the mission ends."""
    first_s = scenario.loops.task_period_s
    pause_s = PERIODS_BETWEEN_COMMENTS * first_s
    count = math.ceil((scenario.steps * scenario.tick_s - first_s) / pause_s)
    return tuple(ScriptedComment(first_s + pause_s * i, PAPER_COMMENT) for i in range(count))


def model_names(llms: Sequence[str]) -> tuple[str, ...]:
    """Return a row's name for each model: llm-mock, llm-local; endpoints are numbered."""
    names = []
    for number, llm in enumerate(llms, start=1):
        names.append(f"llm-{llm}" if llm.isalnum() else f"llm-endpoint-{number}")
    return tuple(names)


def with_person(name: str) -> str:
    """Return the name of a model's row with the person."""
    return f"{name}-human"


@dataclass(frozen=True, slots=True)
class Ablation:
    """The figures of every row by seed, and the tables made of them."""

    plan: AblationPlan
    figures: Mapping[str, Mapping[int, Mapping[str, float]]]
    """Row -> seed -> figure."""

    @classmethod
    def of(cls, plan: AblationPlan, finished: Iterable[Done]) -> "Ablation":
        """Gather what has been flown; missing runs are left out of their row."""
        figures: dict[str, dict[int, Mapping[str, float]]] = {p.name: {} for p in plan.policies()}
        for done in finished:
            trial = done.trial
            if isinstance(trial, MissionTrial):
                row = figures[trial.policy.name]
                row[trial.seed] = figures_of(done.result, trial.setup())
        return cls(plan, figures)

    def rows(self) -> tuple[str, ...]:
        """Return the names of the table's rows, as far as they were flown."""
        hidden = (PAPER_PROBLEM, TRADE_OFF)
        return tuple(
            name for name, row in self.figures.items() if row and not name.startswith(hidden)
        )

    def by_seed(self, row: str, figure: Figure) -> dict[int, float]:
        """Return one figure of a row by seed."""
        return {seed: values[figure.key] for seed, values in self.figures[row].items()}

    def mean(self, row: str, figure: Figure) -> Estimate | None:
        """Return the mean of a row's figure."""
        return estimate(list(self.by_seed(row, figure).values()))

    def attacks(self, row: str) -> Estimate | None:
        """Return the mean number of attacks of both kinds in a row."""
        sensing, communication = self.by_seed(row, SENSING), self.by_seed(row, COMMUNICATION)
        return estimate([sensing[seed] + communication[seed] for seed in sensing])

    def difference(self, row: str, base: str, figure: Figure) -> Estimate | None:
        """Return by how much a row's figure is above another's, paired over the seeds."""
        return paired(self.by_seed(row, figure), self.by_seed(base, figure))

    # ------------------------------------------------------------------ tables

    def means_table(self) -> Table:
        """Return the paper's Table I, with intervals."""
        return Table(
            "Means and 95 % intervals",
            (Column("row", "row"), Column("seeds", "seeds"), *_columns()),
            [
                self._means(name) | {"row": name, "seeds": len(self.figures[name])}
                for name in self.rows()
            ],
        )

    def differences_table(self) -> Table:
        """Return every row against the one without advice, and people against their model."""
        pairs = [(row, WITHOUT) for row in self.rows() if row != WITHOUT]
        for name in model_names(self.plan.llms):
            pairs += [(name, SOLVER), (with_person(name), name)]
        return Table(
            "Differences, paired over seeds",
            (Column("row", "row"), Column("against", "against"), *_columns(signed=True)),
            [self._compared(row, base) for row, base in pairs],
        )

    def attribution_table(self) -> Table:
        """Return whose gain is whose, step by step from the paper's problem to the person."""
        steps = [
            ("the optimizer (look-ahead, price of exposure)", WITHOUT, PAPER_PROBLEM),
            ("the assignment solver", SOLVER, WITHOUT),
        ]
        for name, llm in zip(model_names(self.plan.llms), self.plan.llms, strict=True):
            steps += [
                (f"the model ({llm}) in place of nobody", name, WITHOUT),
                (f"the model ({llm}) beyond the assignment solver", name, SOLVER),
                (f"the person beside {llm}", with_person(name), name),
            ]
        return Table(
            "Whose gain it is (negative is better)",
            (Column("gain", "gain of"), *_columns(signed=True)),
            [self._compared(row, base) | {"gain": words} for words, row, base in steps],
        )

    def trade_off_table(self) -> Table | None:
        """Return trace against attacks over weights of safety; None where it was not flown."""
        flown = [n for n, row in self.figures.items() if row and n.startswith(TRADE_OFF)]
        if not flown:
            return None
        return Table(
            "Trade-off: the assignment solver with other weights of safety",
            (Column("factor", "safety weights times"), *_columns()),
            [self._means(name) | {"factor": name.removeprefix(TRADE_OFF)} for name in flown],
        )

    def _means(self, row: str) -> dict[str, Cell]:
        return {figure.key: self.mean(row, figure) for figure in FIGURES}

    def _compared(self, row: str, base: str) -> dict[str, Cell]:
        cells: dict[str, Cell] = {"row": row, "against": base}
        return cells | {figure.key: self.difference(row, base, figure) for figure in FIGURES}

    def tables(self) -> dict[str, Table]:
        """Return every table by the name of its file."""
        tables = {
            "means": self.means_table(),
            "differences": self.differences_table(),
            "attribution": self.attribution_table(),
        }
        trade_off = self.trade_off_table()
        return tables if trade_off is None else tables | {"trade-off": trade_off}

    def as_json(self) -> dict[str, Any]:
        """Return what was flown and every table as plain records."""
        plan = self.plan
        return {
            "experiment": "ablation",
            "scenario": plan.scenario.name,
            "seeds": list(plan.seeds),
            "gate": plan.gate.value,
            "engine": plan.engine,
            "comments": [[comment.time_s, comment.text] for comment in plan.comments],
            "tables": {name: table.records() for name, table in self.tables().items()},
        }


def _columns(*, signed: bool = False) -> tuple[Column, ...]:
    return tuple(Column(f.key, f.head, f.digits, signed) for f in FIGURES)
