"""What the gate is worth and what it costs: the same missions with it and without it, in pairs.

    python -m benchmarks.gate exp4.yaml --seeds 20 --adviser mock careless --out gate

Every scenario is flown in lockstep under every adviser and every gate with the same seeds; the
differences to the first gate named come with 95 % intervals. `careless` is an adviser whose
answers are valid and random: assignments that pass verification, weights anywhere within their
bounds. It stands for the worst that a language model can do.
"""

import argparse
import asyncio
import json
import random
import statistics
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from benchmarks.quality import mean_and_half_width
from benchmarks.sweep import swept, write_csv
from llm.chat import ChatReply, ChatRequest
from server.lockstep.advice import VirtualAdvice
from server.lockstep.assembly import open_advice
from server.lockstep.council import Council
from server.lockstep.driver import Advice, Lockstep
from server.lockstep.job import PAPER_LATENCY
from server.mission.core import MissionCore
from server.mission.setup import GateMode, MissionSetup
from server.mission.tape import NoTape, TapedCore
from server.scenarios import library
from server.settings import Settings
from solver import engines
from solver.planner import Planner
from solver.streams import Streams
from vehicles.world.world import World

CARELESS = "careless"
FIGURES = ("trace", "sensing_attacks", "communication_attacks")


@dataclass(frozen=True, slots=True)
class Job:
    """One run to do."""

    scenario: str
    seed: int
    adviser: str
    gate: str
    margin: float | None


@dataclass(frozen=True, slots=True)
class Run:
    """What one run came to."""

    scenario: str
    seed: int
    adviser: str
    gate: str
    trace: float
    """Accumulated; by the authors' accounting in their scenarios."""

    sensing_attacks: int
    communication_attacks: int
    changing: int
    gone_into_force: int
    refused_by_gate: int
    forecasts: int
    forecast_median_ms: float
    """Thread time of one prediction of both sides; 0 where none was made."""

    speed: float
    """Mission time per wall time."""


class Careless:
    """A model whose answers are valid and random."""

    def __init__(self, setup: MissionSetup) -> None:
        self._setup = setup
        self._dice = random.Random(setup.seed)

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        """Answer as the schema asks, at random."""
        task = request.schema is not None and "assignment" in request.schema["properties"]
        return ChatReply(self._assignment() if task else self._weights(), 0, 0, 0.0)

    def _assignment(self) -> str:
        """Deal the targets to robots that have room, as long as any has."""
        room = {robot.id: robot.capacity for robot in self._setup.robots}
        lines = []
        for target in self._dice.sample(self._setup.target_ids, len(self._setup.target_ids)):
            free = [robot_id for robot_id, left in room.items() if left > 0]
            if free:
                robot_id = self._dice.choice(free)
                room[robot_id] -= 1
                lines.append(f"Drone {robot_id} should track Target {target}.")
        return "\n".join(lines)

    def _weights(self) -> str:
        bounds = zip(self._setup.weight_lower, self._setup.weight_upper, strict=True)
        weights = [low * (high / low) ** self._dice.random() for low, high in bounds]
        return json.dumps(weights)


def fly(job: Job) -> Run:
    """Do one run in lockstep."""
    scenario = library.load(job.scenario).varied(seed=job.seed)
    setup = replace(scenario.mission_setup(), gate=GateMode(job.gate))
    if job.margin is not None:
        setup = replace(setup, merit=replace(setup.merit, margin=job.margin))
    engine = setup.planner.engine or engines.default_engine()
    council = Council(
        TapedCore(MissionCore(setup), NoTape()), setup.gate, Planner(engines.create(engine))
    )
    world = World(scenario.world_setup(), Streams(setup.seed))

    async def flown() -> dict[str, object]:
        if job.adviser == CARELESS:
            return await with_advice(VirtualAdvice(council, Careless(setup), PAPER_LATENCY))
        async with open_advice(job.adviser, Settings(), council, PAPER_LATENCY) as advice:
            return await with_advice(advice)

    async def with_advice(advice: Advice | None) -> dict[str, object]:
        mission = Lockstep(setup, world, council, Planner(engines.create(engine)), advice)
        return await mission.run(lambda _: None)

    result = asyncio.run(flown())
    return _run_of(job, result)


def _run_of(job: Job, result: dict[str, object]) -> Run:
    values: dict[str, float] = {k: v for k, v in result.items() if isinstance(v, int | float)}
    gate = result["gate"]
    assert isinstance(gate, dict)
    return Run(
        scenario=Path(job.scenario).stem,
        seed=job.seed,
        adviser=job.adviser,
        gate=job.gate,
        trace=values.get("accumulated_trace_authors", values["accumulated_trace"]),
        sensing_attacks=int(values["sensing_attacks"]),
        communication_attacks=int(values["communication_attacks"]),
        changing=gate["changing"],
        gone_into_force=gate["gone_into_force"],
        refused_by_gate=gate["refused"].get("gate", 0),
        forecasts=gate["forecasts"],
        forecast_median_ms=gate["forecast_median_ms"] or 0.0,
        speed=values["steps"] * values["dt"] / values["wall_s"],
    )


def table(runs: list[Run]) -> str:
    """Return the comparison as Markdown: means, and paired differences to the first gate."""
    head = (
        "scenario",
        "adviser",
        "gate",
        "trace",
        "sensing",
        "communication",
        "changing",
        "in force",
        "refused by gate",
        "forecast (ms)",
        "x real time",
    )
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    groups = dict.fromkeys((run.scenario, run.adviser) for run in runs)
    for scenario, adviser in groups:
        own = [r for r in runs if (r.scenario, r.adviser) == (scenario, adviser)]
        first = own[0].gate
        for gate in dict.fromkeys(run.gate for run in own):
            mine = [run for run in own if run.gate == gate]
            cells = [scenario, adviser, gate]
            base = {run.seed: run for run in own if run.gate == first}
            cells += [_figure(mine, base, name) for name in FIGURES]
            cells += [
                f"{statistics.fmean(getattr(run, name) for run in mine):.1f}"
                for name in ("changing", "gone_into_force", "refused_by_gate")
            ]
            cells += [
                f"{statistics.median(run.forecast_median_ms for run in mine):.1f}",
                f"{statistics.median(run.speed for run in mine):.0f}",
            ]
            lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines)


def _figure(mine: list[Run], base: dict[int, Run], name: str) -> str:
    mean = statistics.fmean(getattr(run, name) for run in mine)
    if mine[0].gate == next(iter(base.values())).gate:
        return f"{mean:.1f}"
    pairs = [float(getattr(run, name) - getattr(base[run.seed], name)) for run in mine]
    difference, half = mean_and_half_width(pairs)
    return f"{mean:.1f} ({difference:+.1f} ± {half:.1f})"


def main() -> None:
    """Fly, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gate", description=__doc__)
    parser.add_argument("scenarios", nargs="+", help="names or files")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--adviser", nargs="+", default=["mock", CARELESS])
    parser.add_argument("--gate", nargs="+", default=["off", "auto"])
    parser.add_argument("--margin", type=float, help="instead of the scenario's")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="writes OUT.csv")
    asked = parser.parse_args()
    jobs = [
        Job(scenario, seed, adviser, gate, asked.margin)
        for scenario, adviser, gate, seed in product(
            asked.scenarios, asked.adviser, asked.gate, range(asked.seeds)
        )
    ]
    runs = swept(fly, jobs, asked.jobs)
    print(table(runs))
    if asked.out:
        write_csv(asked.out.with_suffix(".csv"), runs)


if __name__ == "__main__":
    main()
