"""The paper's Table II from loops that really run: rate, run time and success of each module.

A mission is flown live as `falconer run` flies one: the planner in one process, the simulated
world and its vehicles in another, the bus between them; only the web side is left out.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from server.api.catalogue import Definition
from server.encoding import MissionState
from server.errors import BadInput
from server.experiments.tables import Cell, Column, Table
from server.live.channel import ChannelClosed, ChannelError
from server.live.host import START_S, ProcessHost
from server.live.outbox import Frame
from server.live.world import WorldHost

MISSION = "runtime"
REQUEST_S = 10.0
SPARE_S = 60.0
"""A mission must not end by itself before it is stopped."""

PAPER = {
    "task_llm": (0.05, 1.3639, 1.0),
    "action_llm": (0.2, 0.8911, 1.0),
    "optimizer": (10.0, 0.0034, 1.0),
}
"""Frequency (Hz), mean run time (s) and success rate in the paper's Table II."""

_NAMES = {
    "task_llm": "task LLM",
    "action_llm": "action LLM",
    "optimizer": "optimizer, whole tick",
    "solve": "optimizer, solve alone",
}


class FlightFailed(BadInput):
    """Raised when a live mission cannot be started or does not last."""


@dataclass(frozen=True, slots=True)
class Flight:
    """What a live mission told at its end."""

    scenario: str
    llm: str
    duration_s: float
    loops: Mapping[str, Mapping[str, Any]]
    """The loops' own reports, by name."""

    result: Mapping[str, Any]


async def fly(definition: Definition, duration_s: float, progress: Callable[[int], None]) -> Flight:
    """Fly live for so many seconds; `progress` is told every second.

    Cancellation ends both processes before it is over. Raises FlightFailed.
    """
    pair = _Processes(definition)
    trouble: ChannelError | None = None
    async with asyncio.TaskGroup() as group:
        try:
            await pair.start(group)
            for second in range(1, round(duration_s) + 1):
                await asyncio.sleep(1.0)
                progress(second)
                if not pair.flying:
                    raise ChannelClosed("it has ended before its time")
            answer = await pair.planner.request("stop", {"author": MISSION}, timeout_s=REQUEST_S)
        except ChannelError as error:
            trouble = error
        finally:
            pair.end()
    if trouble is not None or pair.snapshot is None:
        raise FlightFailed(f"the live mission broke off: {trouble or 'it told nothing'}")
    return Flight(
        scenario=definition.scenario,
        llm=definition.llm,
        duration_s=duration_s,
        loops=pair.snapshot["loops"],
        result=answer["result"],
    )


class _Processes:
    """Owner of the planner's and the world's process."""

    def __init__(self, definition: Definition) -> None:
        self.planner = ProcessHost()
        self.snapshot: dict[str, Any] | None = None
        """The newest snapshot message."""

        self._definition = definition
        self._tasks: list[asyncio.Task[int]] = []

    async def start(self, group: asyncio.TaskGroup) -> None:
        """Start both and let the mission go. Raises ChannelError."""
        self._tasks.append(group.create_task(self.planner.run(self._receive), name="planner"))
        job: dict[str, Any] = {"mission": MISSION, "job": self._definition.planner}
        answer = await self.planner.request("prepare", job, timeout_s=START_S)
        if self._definition.world is not None:
            world = WorldHost()
            self._tasks.append(group.create_task(world.run(self._receive), name="world"))
            job = {"job": self._definition.world, "endpoint": answer["endpoint"]}
            await world.request("start", job, timeout_s=START_S)
        await self.planner.request("start", timeout_s=REQUEST_S)

    @property
    def flying(self) -> bool:
        """Whether both processes run and the mission is not over."""
        over = self.snapshot is not None and self.snapshot["state"] == MissionState.ENDED
        return not over and not any(task.done() for task in self._tasks)

    def end(self) -> None:
        """Ask both to end; whoever waits for their tasks sees them gone."""
        for task in self._tasks:
            task.cancel()

    def _receive(self, said: Frame) -> None:
        if said.is_snapshot:
            self.snapshot = said.data


def table(flight: Flight) -> Table:
    """Return the paper's Table II with its own figures beside ours."""
    rows: list[dict[str, Cell]] = []
    optimizer = flight.result["optimizer"]
    for key, name in _NAMES.items():
        paper = PAPER.get("optimizer" if key == "solve" else key)
        row: dict[str, Cell] = {"module": name}
        if key == "solve":
            row |= {
                "mean_s": None if optimizer["median_ms"] is None else 1e-3 * optimizer["median_ms"],
                "success": _percent(optimizer["success_rate"]),
                "calls": optimizer["ticks"],
            }
        elif (loop := flight.loops.get(key)) is not None:
            row |= {
                "rate_hz": loop["rate_hz"],
                "mean_s": loop["mean_s"],
                "success": _percent(loop["success_rate"]),
                "adopted": _percent(loop["adopted_rate"]),
                "calls": loop["calls"],
                "missed": loop["missed"],
            }
        if paper is not None:
            row |= {"paper_hz": paper[0], "paper_s": paper[1], "paper_success": 100.0 * paper[2]}
        rows.append(row)
    return Table("Modules of a live mission, and the paper's", _COLUMNS, rows)


_COLUMNS = (
    Column("module", "module"),
    Column("rate_hz", "frequency (Hz)", 3),
    Column("mean_s", "run time (s)", 4),
    Column("success", "success (%)", 1),
    Column("adopted", "adopted (%)", 1),
    Column("calls", "calls"),
    Column("missed", "missed"),
    Column("paper_hz", "paper (Hz)", 2),
    Column("paper_s", "paper (s)", 4),
    Column("paper_success", "paper (%)", 0),
)


def as_json(flight: Flight) -> dict[str, Any]:
    """Return what was flown, the loops' reports and the result as one object."""
    return {
        "experiment": "runtime",
        "scenario": flight.scenario,
        "llm": flight.llm,
        "duration_s": flight.duration_s,
        "loops": dict(flight.loops),
        "result": dict(flight.result),
        "tables": {"runtime": table(flight).records()},
    }


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share
