"""Where a tick's time goes as teams grow: the whole chain, stage by stage, and what it sends.

    python -m benchmarks.scale [--quick] [--most-robots N] [--picture FILE.svg] [--json FILE]

Missions at constant density (`core.crowd`) are flown in lockstep. Beside each tick runs what the
live mission does around it, on a bus inside this process: the robots' states and detections are
read off it, setpoints and knowledge are put on it, the snapshot is encoded for the stream. Times
are CPU time of the thread, first ticks left out; what the network takes is in `benchmarks.bus`.
"""

import argparse
import asyncio
import gc
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.core import crowd
from benchmarks.report import machine
from llm.prompts import PromptView, task_request
from server.encoding import MissionState, snapshot_message, truth_object
from server.live.channel import frame
from server.lockstep.council import Council
from server.lockstep.driver import LOCKSTEP_BUDGET, Lockstep
from server.mission.core import MissionCore
from server.mission.downlink import KNOWLEDGE_TICKS, Briefing
from server.mission.setup import GateMode, MissionSetup
from server.mission.tape import NoTape, TapedCore
from solver import engines
from solver.observations import Link
from solver.planner import Planner
from solver.problem import Budget, Problem, Solution
from solver.setpoints import Setpoint
from solver.snapshot import Snapshot
from solver.streams import Streams
from solver.zones import ZoneKind
from vehicles import messages as wire
from vehicles import translation
from vehicles.keys import TeamKeys, Topic
from vehicles.link_monitor import LinkSettings
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.team_link import TeamLink
from vehicles.world.world import World

SIZES = ((8, 16), (64, 128), (128, 256), (256, 512), (512, 1024), (1000, 2000))
STAGES = ("hear", "estimate", "solve", "commit", "setpoints", "knowledge", "snapshot")
WORDS = {
    "hear": "hear: decode and check what robots say",
    "estimate": "estimate: filter, hazards, problem",
    "solve": "optimize",
    "commit": "commit: setpoints, picture",
    "setpoints": "encode the setpoints",
    "knowledge": "knowledge for a tenth of the team",
    "snapshot": "encode the snapshot for people",
}
TICK_MS = 100.0
_WARM_UP = 5
_MANY = 256
"""Larger teams fly fewer ticks: their simulated world takes seconds for each."""


@dataclass(slots=True)
class Scale:
    """Figures of one size. Milliseconds and bytes per tick."""

    robots: int
    targets: int
    ticks: int
    median_ms: dict[str, float] = field(default_factory=dict)
    p99_ms: dict[str, float] = field(default_factory=dict)
    round_ms: float = 0.0
    """Knowledge for the whole team at once, as after a change."""

    bytes_up: float = 0.0
    bytes_down: float = 0.0
    bytes_knowledge: float = 0.0
    """Of one message."""

    bytes_snapshot: float = 0.0
    prompt_chars: int = 0
    """Of one question to the task model."""

    prompt_ms: float = 0.0
    world_ms: float = 0.0
    """All that is not the planner's: the simulated world and the robots on board."""

    refused: str = ""
    """Why nothing could be flown, if so."""

    @property
    def tick_ms(self) -> float:
        """Median of the whole chain."""
        return self.median_ms.get("tick", float("nan"))


class _Clock:
    """Times the stages of each tick."""

    def __init__(self) -> None:
        self.ticks: list[dict[str, float]] = []
        self._now: dict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        began = time.thread_time()
        yield
        self._now[name] += 1e3 * (time.thread_time() - began)

    def end(self) -> None:
        """The tick is over."""
        self.ticks.append(dict(self._now))
        self._now.clear()


class _TimedPlanner(Planner):
    clock: _Clock

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        with self.clock.stage("solve"):
            return super().solve(problem, budget)


class _TimedCore(TapedCore):
    clock: _Clock
    setpoints: tuple[Setpoint, ...] = ()

    def begin(self, now_s: float) -> Problem:
        with self.clock.stage("estimate"):
            return super().begin(now_s)

    def commit(self, solution: Solution) -> tuple[Setpoint, ...]:
        with self.clock.stage("commit"):
            self.setpoints = super().commit(solution)
        return self.setpoints


class _Bus(LocalBus):
    """Counts what is put on it."""

    sent = 0

    def publish(self, key: str, payload: bytes) -> None:
        self.sent += len(payload)
        super().publish(key, payload)


class _Around:
    """What the live mission does around a tick: hear, tell, show."""

    def __init__(self, setup: MissionSetup, core: _TimedCore, link: TeamLink, bus: _Bus) -> None:
        self._setup, self._core, self._link, self._bus = setup, core, link, bus
        self._keys = TeamKeys(setup.team)
        self._senders = {i: translation.Sender(f"robot{i}") for i in setup.robot_ids}
        self.clock = core.clock
        self.up: list[int] = []
        self.down: list[int] = []
        self.knowledge: list[int] = []
        self.shown: list[int] = []

    def look(self, snapshot: Snapshot, world: World) -> None:
        """Do all of it for one tick."""
        before = self._bus.sent
        self._speak(snapshot, world)
        self.up.append(self._bus.sent - before)
        with self.clock.stage("hear"):
            self._link.drain(snapshot.time_s)
        before = self._bus.sent
        with self.clock.stage("setpoints"):
            self._link.send_setpoints(self._core.setpoints, snapshot.mission)
        self.down.append(self._bus.sent - before)
        self.tell(self._setup.robot_ids[snapshot.tick % KNOWLEDGE_TICKS :: KNOWLEDGE_TICKS])
        truth = world.truth()
        with self.clock.stage("snapshot"):
            told = truth_object(
                {robot.id: robot.position for robot in truth.robots},
                {target.id: target.position for target in truth.targets},
                truth.zones,
            )
            self.shown.append(len(_shown(snapshot, self._setup, told)))

    def tell(self, robot_ids: tuple[int, ...]) -> None:
        """Send some robots what they should know."""
        before = self._bus.sent
        with self.clock.stage("knowledge"):
            self._link.send_knowledge(*map(Briefing(self._core.core).of, robot_ids))
        if robot_ids:
            self.knowledge.append((self._bus.sent - before) // len(robot_ids))

    def _speak(self, snapshot: Snapshot, world: World) -> None:
        """Let every robot that can be heard say where it is and what it sees."""
        rows = snapshot.directives.rows()
        for robot_id, link in zip(snapshot.robots.ids, snapshot.robots.links, strict=True):
            if link is not Link.CONNECTED:
                continue
            sender = self._senders[robot_id]
            key = self._keys.robot(robot_id, Topic.STATE)
            header = sender.header(key, snapshot.time_s)
            state = world.robot_state(robot_id)
            message = translation.state_message(header, state, wire.Mode.FLYING)
            self._bus.publish(key, wire.encode(message))
            seen = world.sense(robot_id, rows.get(robot_id, ()))
            if seen is not None:
                key = self._keys.robot(robot_id, Topic.DETECTIONS)
                header = sender.header(key, snapshot.time_s)
                self._bus.publish(key, wire.encode(translation.detections_message(header, seen)))


def _shown(snapshot: Snapshot, setup: MissionSetup, truth: dict[str, object]) -> str:
    """Return the stream's message."""
    return frame(
        snapshot_message(
            snapshot,
            mission="m1",
            state=MissionState.RUNNING,
            loops={},
            field=(setup.field_lower, setup.field_upper),
            weight_bounds=(setup.weight_lower, setup.weight_upper),
            severity_bounds=setup.severity_bounds,
            zone_defaults={kind: setup.zone_defaults(kind) for kind in ZoneKind},
            attacks={},
            truth=truth,
            stamp_s=snapshot.time_s,
        )
    ).text


async def flown(robots: int, targets: int, steps: int) -> Scale:
    """Fly a mission of one size; return its figures."""
    scenario = crowd(robots, targets)
    setup = replace(scenario.mission_setup(), steps=steps + _WARM_UP)
    clock = _Clock()
    planner = _TimedPlanner(engines.create("fast"))
    planner.clock = clock
    core = _TimedCore(MissionCore(setup), NoTape())
    core.clock = clock
    world = World(scenario.world_setup(), Streams(setup.seed))
    scale = Scale(robots, targets, steps)
    walls: list[float] = []
    async with _Bus(LocalHub()) as bus:
        keys = TeamKeys(setup.team)
        boot, settings = "planner", LinkSettings()
        async with TeamLink(bus, keys, setup.robot_ids, boot, time.monotonic, settings) as link:
            around = _Around(setup, core, link, bus)
            council = Council(core, GateMode.OFF, Planner(engines.create("fast")))
            mission = Lockstep(setup, world, council, planner, None)
            # As the mission's process does before it flies.
            gc.unfreeze()
            gc.collect()
            gc.freeze()
            for step in range(setup.steps):
                began = time.thread_time()
                await mission.step(step * setup.tick_s)
                walls.append(1e3 * (time.thread_time() - began))
                around.look(mission.snapshot, world)
                clock.end()
            around.tell(setup.robot_ids)
            clock.end()
            scale.round_ms = clock.ticks.pop()["knowledge"]
    ticks = clock.ticks[_WARM_UP:]
    own = ("estimate", "solve", "commit")
    times = {name: np.array([tick.get(name, 0.0) for tick in ticks]) for name in STAGES}
    times["tick"] = sum(times.values(), np.zeros(len(ticks)))
    scale.median_ms = {name: float(np.median(spent)) for name, spent in times.items()}
    scale.p99_ms = {name: float(np.percentile(spent, 99)) for name, spent in times.items()}
    planned = np.array([sum(tick.get(name, 0.0) for name in own) for tick in ticks])
    scale.world_ms = float(np.median(np.array(walls[_WARM_UP:]) - planned))
    scale.bytes_up, scale.bytes_down = float(np.mean(around.up)), float(np.mean(around.down))
    scale.bytes_knowledge = float(np.mean(around.knowledge))
    scale.bytes_snapshot = float(np.mean(around.shown))
    began = time.thread_time()
    request = task_request(PromptView(mission.snapshot, core.core.limits))
    scale.prompt_ms = 1e3 * (time.thread_time() - began)
    scale.prompt_chars = sum(len(message.content) for message in request.messages)
    return scale


def table(rows: list[Scale]) -> str:
    """Return the figures as Markdown: a column per size."""
    sizes = " | ".join(f"{row.robots}, {row.targets}" for row in rows)
    lines = [f"| CPU time per tick, median (p99), ms | {sizes} |", "|---|" + "---|" * len(rows)]
    for name in (*STAGES, "tick"):
        figures = [f"{_ms(row.median_ms[name])} ({_ms(row.p99_ms[name])})" for row in rows]
        lines.append(f"| {WORDS.get(name, '**all of it**')} | {' | '.join(figures)} |")
    others = (
        ("knowledge for all at once, after a change, ms", lambda row: _ms(row.round_ms)),
        ("from robots, kB/s", lambda row: f"{row.bytes_up / 100.0:,.0f}"),
        ("setpoints, kB/s", lambda row: f"{row.bytes_down / 100.0:,.0f}"),
        (
            "knowledge, each robot once a second, kB/s",
            lambda row: f"{row.robots * row.bytes_knowledge / 1e3:,.0f}",
        ),
        ("snapshots to each reader, kB/s", lambda row: f"{row.bytes_snapshot / 100.0:,.0f}"),
        ("a question to the task model, thousand characters", lambda row: _k(row.prompt_chars)),
        ("making it, ms", lambda row: _ms(row.prompt_ms)),
        ("simulated world and robots, ms a tick (theirs)", lambda row: _ms(row.world_ms)),
    )
    lines += ["", f"| beside it | {sizes} |", "|---|" + "---|" * len(rows)]
    lines += [f"| {words} | {' | '.join(map(tell, rows))} |" for words, tell in others]
    return "\n".join(lines)


def _ms(value: float) -> str:
    return f"{value:.2f}" if value < 10.0 else f"{value:.0f}"


def _k(value: float) -> str:
    return f"{value / 1e3:,.0f}"


def draw(path: Path, rows: list[Scale]) -> None:
    """Draw the stages over team size, stacked as they follow each other (SVG)."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "falconer"
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.5, 4.6), layout="constrained")
    sizes = [row.robots for row in rows]
    for name in STAGES:
        axes.plot(
            sizes, [row.median_ms[name] for row in rows], marker="o", markersize=3.5,
            linewidth=1.2, label=WORDS[name],
        )  # fmt: skip
    axes.plot(
        sizes, [row.tick_ms for row in rows], color="black", marker="o", markersize=3.5,
        linewidth=2.0, label="all of it",
    )  # fmt: skip
    axes.axhline(TICK_MS, color="#8c2f39", linewidth=0.8)
    axes.annotate("one tick", (sizes[0], 1.08 * TICK_MS), fontsize=8, color="#8c2f39")
    axes.set(xscale="log", yscale="log", xlabel="robots (twice as many targets)")
    axes.set_ylabel("ms of CPU per tick (median)")
    axes.grid(visible=True, which="major", linewidth=0.3)
    axes.legend(fontsize=7, ncols=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main(arguments: list[str]) -> int:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.scale",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="a few ticks of each size")
    parser.add_argument("--most-robots", type=int, default=1000)
    parser.add_argument("--picture", type=Path, help="where to draw it (SVG)")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    options = parser.parse_args(arguments)
    warmed = engines.create("fast")
    small = crowd(2, 4).mission_setup()
    warmed.solve(MissionCore(small).begin(0.0), LOCKSTEP_BUDGET)
    rows = []
    for robots, targets in SIZES:
        if robots <= options.most_robots:
            ticks = 10 if options.quick else 60 if robots <= _MANY else 20
            rows.append(asyncio.run(flown(robots, targets, ticks)))
            sys.stderr.write(f"{robots}, {targets}: {rows[-1].tick_ms:.1f} ms\n")
    sys.stdout.write(f"{table(rows)}\n\n{machine()}\n")
    if options.picture:
        draw(options.picture, rows)
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
